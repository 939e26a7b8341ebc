"""Detection of clock steps back, after which a deadline would come again only much later."""

from pointit.schemas import NS_PER_S

BACK_NS = NS_PER_S
"""Smaller steps back are ignored."""


class ClockStepDetector:
    """Compares each time with the newest one."""

    def __init__(self) -> None:
        self._newest_ns = -1

    def begin(self, now_ns: int) -> None:
        """Start at `now_ns`."""
        self._newest_ns = now_ns

    def by_ns(self, now_ns: int) -> int:
        """Return the size of a clock step back since the last call, ns; 0 if none or a small one."""
        back_ns = self._newest_ns - now_ns
        if 0 <= back_ns <= BACK_NS:
            return 0
        self._newest_ns = now_ns
        return max(0, back_ns)
