"""When the person presses their button: to begin, and twice to point at a lamp anew."""

import math

from pointit.schemas import NS_PER_S, ButtonEvent
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.sight import Sight

OFF_S = 2.0
"""How long the cursor is off before the person does something about it."""

PATIENCE_S = 15.0
"""How long an anchor that was asked for may take to help before it is asked for again."""


class Press:
    """The thumb on the button."""

    def __init__(self, config: UserSimConfig) -> None:
        self._think_ns = round(config.think_s * NS_PER_S)
        self._pause_ns = round(config.press_pause_s * NS_PER_S)
        self._every_ns = round(config.anchor_every_s * NS_PER_S)
        self._off_rad = math.radians(config.anchor_when_off_deg)
        self._pressed_ns: int | None = None
        self._anchored_ns: int | None = None
        self._on_ns = 0
        """When the cursor was last where it should be."""
        self._presses = 0

    def step(self, now_ns: int, sight: Sight, off_rad: float) -> ButtonEvent | None:
        """Return what the person does now; the cursor is `off_rad` from where they feel to point."""
        interaction = sight.interaction
        if interaction is None:
            return None
        if interaction.state == "idle":
            self._anchored_ns = None
            return self._begin(now_ns, sight)
        if interaction.state == "pointing":
            return self._anchor(now_ns, sight, off_rad)
        return None

    def _begin(self, now_ns: int, sight: Sight) -> ButtonEvent | None:
        ready_ns = sight.interaction_since_ns + self._think_ns
        if self._pressed_ns is not None:
            ready_ns = max(ready_ns, self._pressed_ns + self._pause_ns)
        if now_ns < ready_ns:
            return None
        self._pressed_ns = now_ns
        self._presses += 1
        return ButtonEvent(stamp_ns=now_ns, seq=self._presses, source="simulated")

    def _anchor(self, now_ns: int, sight: Sight, off_rad: float) -> ButtonEvent | None:
        """Press twice when the last anchor, or the start, is long ago, or the cursor is off for long."""
        news = sight.localization
        is_anchoring = news is not None and news.phase == "sampling" and news.purpose == "anchor"
        if is_anchoring or off_rad <= self._off_rad:
            self._on_ns = now_ns
        if is_anchoring:
            return None
        asked_ns = self._anchored_ns
        since_ns = sight.interaction_since_ns if asked_ns is None else asked_ns
        is_old = 0 < self._every_ns <= now_ns - since_ns
        is_off = self._off_rad > 0.0 and now_ns - self._on_ns > OFF_S * NS_PER_S
        may_again = asked_ns is None or now_ns - asked_ns > PATIENCE_S * NS_PER_S
        if not is_old and not (is_off and may_again):
            return None
        self._anchored_ns = self._on_ns = now_ns
        self._presses += 1
        return ButtonEvent(stamp_ns=now_ns, seq=self._presses, source="simulated", gesture="double")
