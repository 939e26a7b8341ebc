"""A clock that was set back: what waits for a time would wait until it comes again."""

from pointit.schemas import NS_PER_S

BACK_NS = NS_PER_S
"""Steps back that are smaller are waited for."""


class ClockStepDetector:
    """Sees the time pass."""

    def __init__(self) -> None:
        self._newest_ns = -1

    def begin(self, now_ns: int) -> None:
        """Take that it is `now_ns`, whatever it was before."""
        self._newest_ns = now_ns

    def by_ns(self, now_ns: int) -> int:
        """Return by how much the clock was set back since it was asked last; 0: not, or by little."""
        back_ns = self._newest_ns - now_ns
        if 0 <= back_ns <= BACK_NS:
            return 0
        self._newest_ns = now_ns
        return max(0, back_ns)
