"""Gestures of a button in the time of the event loop."""

import asyncio
from collections.abc import Callable

from pointit.services.imu_bridge.ble.button import ButtonGestures, Gesture


class TimedButton:
    """Gestures of a button in the time of the event loop."""

    def __init__(self, on_gesture: Callable[[Gesture], None]) -> None:
        """Call `on_gesture` for each gesture as soon as it is complete."""
        self._on_gesture = on_gesture
        self._gestures = ButtonGestures()
        self._timer: asyncio.TimerHandle | None = None

    def change(self, *, is_down: bool) -> None:
        """Handle a change of the button."""
        now_s = asyncio.get_running_loop().time()
        gesture = self._gestures.down(now_s) if is_down else self._gestures.up(now_s)
        self._tell(gesture)

    def release(self) -> None:
        """Forget what is pending, such as when the connection ends."""
        self._gestures = ButtonGestures()
        self._schedule()

    def _tell(self, gesture: Gesture | None) -> None:
        self._schedule()
        if gesture is not None:
            self._on_gesture(gesture)

    def _schedule(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        due_s = self._gestures.due_s
        loop = asyncio.get_running_loop()
        self._timer = None if due_s is None else loop.call_at(due_s, self._on_due)

    def _on_due(self) -> None:
        gesture = self._gestures.wait(asyncio.get_running_loop().time())
        self._tell(gesture)
