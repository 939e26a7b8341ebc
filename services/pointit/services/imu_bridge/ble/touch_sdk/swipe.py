"""Swipes across the screen of a watch."""

from pointit.services.imu_bridge.ble.touch_sdk.messages import BEGIN, CANCEL, END, TouchEvent

MIN_SHARE = 0.2
"""Shortest swipe, as a share of the screen's width."""
USUAL_WIDTH_PX = 450.0
"""Width of the screen of a watch that does not state it, px."""


class SwipeDetector:
    """Detects swipes of one finger to the right or left."""

    def __init__(self) -> None:
        self.width_px = USUAL_WIDTH_PX
        self._began_px: tuple[float, float] | None = None

    def step(self, event: TouchEvent) -> int:
        """Return 1 if `event` ends a swipe to the right, -1 if to the left, else 0."""
        if event.kind == BEGIN:
            self._began_px = event.coordinates_px[0] if len(event.coordinates_px) == 1 else None
            return 0
        if len(event.coordinates_px) > 1 or event.kind == CANCEL:
            self._began_px = None
            return 0
        if event.kind != END or self._began_px is None or not event.coordinates_px:
            return 0
        began_px, self._began_px = self._began_px, None
        right_px, down_px = (b - a for a, b in zip(began_px, event.coordinates_px[0], strict=True))
        if not abs(right_px) >= max(MIN_SHARE * self.width_px, abs(down_px)):  # also if it is not a number
            return 0
        return 1 if right_px > 0.0 else -1
