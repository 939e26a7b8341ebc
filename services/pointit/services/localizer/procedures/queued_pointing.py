"""A request to point at lamps that waits for its turn, which led-driver decides.

Pure: the users ahead and the time go in; messages come out.
"""

from collections.abc import Callable, Collection
from typing import Literal

from pointit.schemas import NS_PER_S, Localization
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.outputs import Phase
from pointit.services.localizer.procedures.clock_step import ClockStepDetector
from pointit.services.localizer.procedures.lamp_procedure import LampProcedure

Make = Callable[[int], LampProcedure | Refusal]
"""Creates the procedure when it is its turn, from the map and the pose of that time (ns), or a refusal."""


class QueuedPointing:
    """A place in the queue; it lights no lamp."""

    def __init__(
        self, make: Make, since_ns: int, procedure: LampProcedure, now_ns: int, limit_s: float
    ) -> None:
        self.make = make
        self.since_ns = since_ns
        """Time of the request, which is the order of the queue."""
        self.lamp_ids = procedure.lamp_ids
        self.ahead: tuple[str, ...] = ()
        """Users ahead as published last."""
        self.purpose: Literal["pose", "anchor"] = procedure.PURPOSE
        self._until_ns = now_ns + round(limit_s * NS_PER_S)
        self._clock = ClockStepDetector()
        self._clock.begin(now_ns)

    def is_too_long(self, now_ns: int) -> bool:
        """Return True if the limit is reached. Call it often, to notice clock steps back."""
        if back_ns := self._clock.by_ns(now_ns):
            self._until_ns -= back_ns
            self.since_ns = max(0, self.since_ns - back_ns)
        return now_ns >= self._until_ns

    def say(self, ahead: tuple[str, ...], now_ns: int) -> Localization:
        """Return a message that the person waits for `ahead`."""
        self.ahead = ahead
        return self._localization(now_ns, "sampling")

    def end(self, phase: Phase, now_ns: int, reason: str = "") -> Localization:
        """Return a message that the person waits no longer."""
        self.ahead = ()
        return self._localization(now_ns, phase, reason)

    def _localization(self, now_ns: int, phase: Phase, reason: str = "") -> Localization:
        return Localization(
            stamp_ns=now_ns,
            phase=phase,
            purpose=self.purpose,
            since_ns=self.since_ns,
            ahead=self.ahead,
            reason=reason,
            lamps=self.lamp_ids if phase == "sampling" else (),
        )


def queue_timeout_message(user: str, ahead: Collection[str], limit_s: float) -> str:
    """Return the reason why `user` stops waiting."""
    who = ", ".join(ahead) or "nobody"
    return (
        f"{user} has waited {limit_s:g} s for the lamps; {who} came first: see that they come to an end, "
        "then start again"
    )


def in_turn(user: str, ahead: Collection[str]) -> str:
    """Return a message that `user` waits for others."""
    return f"{user} waits in turn: {', '.join(ahead)} first"
