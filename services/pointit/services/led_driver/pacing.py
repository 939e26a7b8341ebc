"""When the next frame may be drawn: at once if the last one is long enough ago, else when it will be."""


class Pacer:
    """Caps a rate; many wishes in one period make one frame, at its end."""

    def __init__(self, max_rate_hz: float) -> None:
        self._period_s = 1.0 / max_rate_hz
        self._last_s = float("-inf")
        self._waiting = False

    def wish(self, now_s: float) -> float | None:
        """Return how long to wait until drawing, 0 for now; nothing when a frame is already due."""
        if self._waiting:
            return None
        wait_s = self._last_s + self._period_s - now_s
        if wait_s <= 0.0:
            return 0.0
        self._waiting = True
        return wait_s

    def drawn(self, now_s: float) -> None:
        """Take note that a frame was drawn."""
        self._last_s = now_s
        self._waiting = False
