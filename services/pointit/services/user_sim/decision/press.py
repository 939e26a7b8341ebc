"""Presses of the button: to start, if the cursor stays away, and twice to point at a lamp again."""

import math
from typing import Literal

from pointit.schemas import NS_PER_S, ButtonEvent
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.decision.perceived_state import PerceivedState

OFF_S = 2.0
"""Time for which the cursor is off before the person reacts, s."""
WAIT_S = 15.0
"""Time for a requested anchor to help before it is requested again, s."""
CUE_PERIOD_S = 3.0
"""Time without a profile after which the person presses anyway, s."""

Gesture = Literal["press", "double", "hold"]


class ButtonModel:
    """The person's thumb on the button."""

    def __init__(self, config: UserSimConfig) -> None:
        self._think_ns = round(config.think_s * NS_PER_S)
        self._pause_ns = round(config.press_pause_s * NS_PER_S)
        self._every_ns = round(config.anchor_every_s * NS_PER_S)
        self._lost_ns = round(config.lost_press_s * NS_PER_S)
        self._off_rad = math.radians(config.anchor_when_off_deg)
        self._born_ns: int | None = None
        self._pressed_ns: int | None = None
        self._anchored_ns: int | None = None
        self._on_ns = 0
        """Last time at which the cursor was on target, ns."""
        self._in_vain_ns = 0
        """Time of looking for the cursor since it was seen last, ns."""
        self._before_ns = 0
        self._presses = 0
        self._free_ns: int | None = None
        """Last time at which another client controlled the wrist. None: never."""

    def decided(self, now_ns: int, gesture: Gesture) -> ButtonEvent:
        """Return the gesture that the person's behaviour has decided on."""
        return self._event(now_ns, gesture)

    def wait(self, now_ns: int) -> None:
        """Press nothing, as another client controls the wrist. Resets all timers."""
        self._free_ns = self._on_ns = self._before_ns = now_ns
        self._in_vain_ns = 0

    def step(
        self,
        now_ns: int,
        perceived: PerceivedState,
        *,
        known_ns: int | None,
        off_rad: float = 0.0,
        sees: bool | None = None,
    ) -> ButtonEvent | None:
        """Return the gesture at this time, or None.

        Args:
            now_ns: time, ns.
            perceived: perceived state of the interaction.
            known_ns: time since which they know that the system has their profile. None: not yet.
            off_rad: angle from the cursor to the felt direction.
            sees: True if they see their cursor. None: they do not look for it.
        """
        if self._born_ns is None or now_ns < self._born_ns:
            self._born_ns = now_ns
        passed_ns, self._before_ns = now_ns - self._before_ns, now_ns
        if sees is not None:
            self._in_vain_ns = 0 if sees else self._in_vain_ns + max(0, min(passed_ns, NS_PER_S))
        if perceived.state == "pointing":
            return self._anchor(now_ns, perceived, off_rad) or self._look_for(now_ns, perceived)
        self._on_ns = now_ns
        if perceived.state == "idle":
            self._anchored_ns = None
            return self._begin(now_ns, perceived, known_ns)
        return None

    def _begin(self, now_ns: int, perceived: PerceivedState, known_ns: int | None) -> ButtonEvent | None:
        greeted_ns = (self._born_ns or 0) + round(CUE_PERIOD_S * NS_PER_S)
        ready_ns = max(perceived.since_ns, greeted_ns if known_ns is None else known_ns) + self._think_ns
        if self._free_ns is not None and self._free_ns <= now_ns:
            ready_ns = max(ready_ns, self._free_ns + self._think_ns)
        if self._pressed_ns is not None and self._pressed_ns <= now_ns:
            ready_ns = max(ready_ns, self._pressed_ns + self._pause_ns)
        if now_ns < ready_ns <= now_ns + self._think_ns + self._pause_ns + 10 * NS_PER_S:
            return None
        self._pressed_ns = now_ns
        return self._event(now_ns, "press")

    def _look_for(self, now_ns: int, perceived: PerceivedState) -> ButtonEvent | None:
        """Press if no cursor was seen for long: the system may not consider them pointing."""
        if self._lost_ns == 0 or self._in_vain_ns <= self._lost_ns:
            return None
        self._in_vain_ns = 0
        self._pressed_ns = now_ns
        perceived.reset(now_ns)
        return self._event(now_ns, "press")

    def _anchor(self, now_ns: int, perceived: PerceivedState, off_rad: float) -> ButtonEvent | None:
        """Press twice if the last anchor, or the start, is long ago, or the cursor is off for long."""
        if off_rad <= self._off_rad:
            self._on_ns = now_ns
        asked_ns = self._anchored_ns
        since_ns = perceived.since_ns if asked_ns is None else asked_ns
        is_old = 0 < self._every_ns <= now_ns - since_ns
        is_off = self._off_rad > 0.0 and now_ns - self._on_ns > OFF_S * NS_PER_S
        may_again = asked_ns is None or now_ns - asked_ns > WAIT_S * NS_PER_S
        if not is_old and not (is_off and may_again):
            return None
        self._anchored_ns = self._on_ns = now_ns
        self._in_vain_ns = 0
        return self._event(now_ns, "double")

    def _event(self, now_ns: int, gesture: Gesture) -> ButtonEvent:
        self._presses += 1
        return ButtonEvent(stamp_ns=now_ns, seq=self._presses, source="simulated", gesture=gesture)
