"""A request to point at lamps that waits for its turn.

Pure: the users ahead and the time go in; messages come out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from pointit.schemas import NS_PER_S, Localization
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.outputs import Phase
from pointit.services.localizer.procedures.lamp_procedure import LampProcedure

Make = Callable[[int], LampProcedure | Refusal]
"""Creates the procedure when it is its turn, from the map and the pose of that time (ns), or a refusal."""


@dataclass(frozen=True, slots=True)
class PointingRequest:
    """A request to point at lamps."""

    make: Make
    since_ns: int
    """Time of the request, which is the order of the queue."""


class QueuedPointing:
    """A place in the queue; it lights no lamp."""

    def __init__(self, wish: PointingRequest, procedure: LampProcedure, now_ns: int, limit_s: float) -> None:
        self.wish = wish
        self.lamp_ids = procedure.lamp_ids
        self.ahead: tuple[str, ...] = ()
        """Users ahead as published last."""
        self.purpose: Literal["pose", "anchor"] = procedure.PURPOSE
        self._until_ns = now_ns + round(limit_s * NS_PER_S)

    def is_too_long(self, now_ns: int) -> bool:
        """Return True if the limit is reached."""
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
            since_ns=self.wish.since_ns,
            ahead=self.ahead,
            reason=reason,
        )
