"""Memory of one person's cursors, of the last seconds only."""

from bisect import bisect_left
from collections import deque

from pointit.schemas import NS_PER_S, Cursor

MAX_CURSORS = 4096
"""Limit of cursors that are kept, whatever their rate."""


class PointingMemory:
    """Cursors with a ray, in the order of their stamps, none older than `memory_s`."""

    def __init__(self, memory_s: float) -> None:
        self._memory_ns = round(memory_s * NS_PER_S)
        self._cursors: deque[Cursor] = deque(maxlen=MAX_CURSORS)

    @property
    def memory_s(self) -> float:
        """Return the time for which cursors are kept, s."""
        return self._memory_ns / NS_PER_S

    def add(self, cursor: Cursor) -> None:
        """Keep `cursor`. One that is older than the last is ignored, unless the clock was set back."""
        cursors = self._cursors
        if cursors and cursor.stamp_ns < cursors[-1].stamp_ns:
            if cursors[-1].stamp_ns - cursor.stamp_ns < NS_PER_S:
                return
            cursors.clear()
        if cursor.origin_m is not None and cursor.direction is not None:
            cursors.append(cursor)
        self.forget(cursor.stamp_ns)

    def forget(self, now_ns: int) -> None:
        """Remove what is too old at `now_ns`."""
        while self._cursors and self._cursors[0].stamp_ns < now_ns - self._memory_ns:
            self._cursors.popleft()

    def between(self, first_ns: int, last_ns: int) -> list[Cursor]:
        """Return the cursors from `first_ns` to `last_ns`."""
        cursors = list(self._cursors)
        first = bisect_left(cursors, first_ns, key=lambda cursor: cursor.stamp_ns)
        last = bisect_left(cursors, last_ns + 1, key=lambda cursor: cursor.stamp_ns)
        return cursors[first:last]
