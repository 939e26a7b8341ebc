"""When the next frame is drawn: fresh cursors at once, everything else with the next cursor or soon after."""


class FrameLimiter:
    """Caps the rate of frames so that those there are show the freshest cursor.

    A cursor is drawn the moment it comes, unless the last frame is too young; then it waits, as everything
    else does, for the next cursor, for `patience_s` at most. A timer at the period's end instead would show
    every cursor of a stream faster than the cap up to one of its periods late.
    """

    def __init__(self, max_rate_hz: float, patience_s: float) -> None:
        self._period_s = 1.0 / max_rate_hz
        self._slack_s = self._period_s / 4.0
        """How much too early a frame may be, so that a stream at just the cap survives its jitter."""
        self._patience_s = patience_s
        self._next_s = float("-inf")
        self._due_s: float | None = None

    def request_frame(self, now_s: float, *, fresh: bool) -> float | None:
        """Return how long to wait until drawing, 0 for now; nothing when a frame is already due.

        Args:
            now_s: the time, on any steady clock.
            fresh: a cursor came; otherwise anything else changed.
        """
        wait_s = self._next_s - now_s
        if fresh and wait_s <= self._slack_s:
            return 0.0
        if self._due_s is not None:
            return None
        wait_s = max(wait_s, self._patience_s)
        if wait_s <= 0.0:
            return 0.0
        self._due_s = now_s + wait_s
        return wait_s

    def drawn(self, now_s: float) -> None:
        """Take note that a frame was drawn."""
        self._next_s = max(self._next_s, now_s) + self._period_s
        self._due_s = None
