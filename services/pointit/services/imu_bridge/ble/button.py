"""Gestures of a button that tells only when it goes down and up; times as on a page's button."""

from dataclasses import dataclass
from typing import Literal

Gesture = Literal["press", "double", "hold"]
HOLD_S = 0.8
"""Minimum duration of a hold, s."""
DOUBLE_S = 0.32
"""Longest time between the releases of a double press, s."""


class ButtonGestures:
    """Makes gestures of changes. All times are seconds of one clock."""

    def __init__(self) -> None:
        self._down_s: float | None = None
        self._tapped_s: float | None = None

    @property
    def due_s(self) -> float | None:
        """Return the time at which `wait` must be called next, or None if nothing is pending."""
        if self._down_s is not None:
            return self._down_s + HOLD_S
        return None if self._tapped_s is None else self._tapped_s + DOUBLE_S

    def down(self, now_s: float) -> Gesture | None:
        """Start a press. Return the previous press if it was too long ago for a double press."""
        before = self.wait(now_s)
        if self._down_s is None:
            self._down_s = now_s
        return before

    def up(self, now_s: float) -> Gesture | None:
        """End a press. Return the gesture that this completes, a double press or a late hold, or None."""
        if self._down_s is None:
            return None
        if (held := self.wait(now_s)) is not None:
            return held
        self._down_s = None
        if self._tapped_s is not None and now_s <= self._tapped_s + DOUBLE_S:
            self._tapped_s = None
            return "double"
        self._tapped_s = now_s
        return None

    def wait(self, now_s: float) -> Gesture | None:
        """Return the gesture that is complete by `now_s` because nothing else happened, or None."""
        if self._down_s is not None:
            if now_s >= self._down_s + HOLD_S:  # as in `due_s`, to the last bit
                self._down_s = self._tapped_s = None
                return "hold"
        elif self._tapped_s is not None and now_s >= self._tapped_s + DOUBLE_S:
            self._tapped_s = None
            return "press"
        return None


@dataclass(frozen=True, slots=True)
class ButtonChange:
    """The button went down or up."""

    is_down: bool
