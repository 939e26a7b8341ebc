"""Time of the next frame: fresh cursors at once, everything else with the next cursor or soon after."""


class FrameLimiter:
    """Caps the rate of frames so that each shows the freshest cursor.

    A cursor is drawn when it arrives, unless the last frame is too recent. Then it waits, like all other
    changes, for the next cursor, for `timeout_s` at most. A timer at the period's end instead would show
    every cursor of a stream faster than the cap up to one of its periods late.
    """

    def __init__(self, max_rate_hz: float, timeout_s: float) -> None:
        self._period_s = 1.0 / max_rate_hz
        self._slack_s = self._period_s / 4.0
        """Time by which a frame may be early, so that a stream at exactly the cap tolerates jitter, s."""
        self._timeout_s = timeout_s
        self._next_s = float("-inf")
        self._due_s: float | None = None

    def request_frame(self, now_s: float, *, fresh: bool) -> float | None:
        """Return the time until drawing, s, 0 for now. None if a frame is already due.

        Args:
            now_s: time on any monotonic clock.
            fresh: True if a cursor came, False if anything else changed.
        """
        wait_s = self._next_s - now_s
        if fresh and wait_s <= self._slack_s:
            return 0.0
        if self._due_s is not None:
            return None
        wait_s = max(wait_s, self._timeout_s)
        if wait_s <= 0.0:
            return 0.0
        self._due_s = now_s + wait_s
        return wait_s

    def drawn(self, now_s: float) -> None:
        """Record that a frame was drawn."""
        self._next_s = max(self._next_s, now_s) + self._period_s
        self._due_s = None
