"""A request to point at lamps that waits for its turn, which led-driver decides.

Pure: the users ahead and the time go in; messages come out.
"""

from collections.abc import Callable, Collection
from typing import Any

from pointit.schemas import NS_PER_S
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.outputs import Output, Phase
from pointit.services.localizer.procedures.lamp_procedure import LampProcedure
from pointit.services.localizer.procedures.procedure import Procedure

Make = Callable[[int], LampProcedure | Refusal]
"""Creates the procedure when it is its turn, from the map and the pose of that time (ns), or a refusal."""


class QueuedPointing(Procedure):
    """A place in the queue; it lights no lamp."""

    def __init__(self, make: Make, procedure: LampProcedure, config: LocalizerConfig) -> None:
        super().__init__(config)
        self.make = make
        self.lamp_ids = procedure.lamp_ids
        self.ahead: tuple[str, ...] = ()
        """Users ahead as published last."""
        self.purpose = procedure.purpose
        self._until_ns = 0

    def is_too_long(self, now_ns: int) -> bool:
        """Return True if the limit is reached."""
        return now_ns >= self._until_ns

    def say(self, ahead: tuple[str, ...], now_ns: int) -> list[Output]:
        """Return a message that the person waits for `ahead`."""
        self.ahead = ahead
        return [self._localization(now_ns, "sampling")]

    def refuse(self, now_ns: int, reason: str) -> list[Output]:
        """Return a message that the person waits no longer."""
        return self._end(now_ns, "refused", reason)

    def on_yaw_origin_changed(self, now_ns: int, reason: str) -> list[Output]:
        """Go on waiting, since no ray was used."""
        del now_ns, reason
        return []

    def _begin(self, now_ns: int) -> list[Output]:
        self._until_ns = now_ns + round(self._config.queue_timeout_s * NS_PER_S)
        return [self._localization(now_ns, "sampling")]

    def _continue(self, now_ns: int) -> list[Output]:
        del now_ns  # the runner knows whose turn it is
        return []

    def _details(self, phase: Phase) -> dict[str, Any]:
        return {"ahead": self.ahead, "lamps": self.lamp_ids} if phase == "sampling" else {}


def queue_timeout_message(user: str, ahead: Collection[str], limit_s: float) -> str:
    """Return the reason why `user` stops waiting."""
    who = ", ".join(ahead) or "nobody"
    return (
        f"{user} has waited {limit_s:g} s for the lamps; {who} came first: see that they come to an end, "
        "then start again"
    )
