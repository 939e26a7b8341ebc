"""A person who is to point at lamps and waits until it is their turn.

Pure: who is before them and the time go in; what is to be said comes out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from pointit.schemas import NS_PER_S, Localization
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.outputs import Phase
from pointit.services.localizer.procedures.clock_step import ClockStepDetector
from pointit.services.localizer.procedures.lamp_procedure import LampProcedure

Make = Callable[[int], LampProcedure | Refusal]
"""Returns what is to be done when it is their turn, with the room and the pose of that time (ns), or why it
cannot be."""


@dataclass(frozen=True, slots=True)
class PointingRequest:
    """To point at lamps."""

    make: Make
    since_ns: int
    """When it was asked for: the order of the queue."""


class QueuedPointing:
    """A place in the queue; it lights nothing."""

    def __init__(self, wish: PointingRequest, procedure: LampProcedure, now_ns: int, limit_s: float) -> None:
        self.wish = wish
        self.lamp_ids = procedure.lamp_ids
        self.ahead: tuple[str, ...] = ()
        """Who was before them when that was said last."""
        self.purpose: Literal["pose", "anchor"] = procedure.PURPOSE
        self._until_ns = now_ns + round(limit_s * NS_PER_S)
        self._clock = ClockStepDetector()
        self._clock.begin(now_ns)

    def is_too_long(self, now_ns: int) -> bool:
        """Return True if the limit is reached; call it often, as clocks may be set back."""
        if back_ns := self._clock.by_ns(now_ns):
            self._until_ns -= back_ns
            self.wish = PointingRequest(self.wish.make, max(0, self.wish.since_ns - back_ns))
        return now_ns >= self._until_ns

    def say(self, ahead: tuple[str, ...], now_ns: int) -> Localization:
        """Return that they wait for `ahead`."""
        self.ahead = ahead
        return self._localization(now_ns, "sampling")

    def end(self, phase: Phase, now_ns: int, reason: str = "") -> Localization:
        """Return that they wait no longer."""
        self.ahead = ()
        return self._localization(now_ns, phase, reason)

    def _localization(self, now_ns: int, phase: Phase, reason: str = "") -> Localization:
        return Localization(
            stamp_ns=now_ns,
            phase=phase,
            purpose=self.purpose,
            since_ns=self.wish.since_ns,
            ahead=self.ahead,
            reason=reason,
        )
