"""Latency from a wrist sample to the LED frame that shows it."""

import math
from collections import Counter

from pointit.schemas import NS_PER_S, Cursor, StripsFrame

RECENT = 64
"""Recent cursors kept to match a frame with its capture."""
STEP = 1.005
"""Ratio of neighbouring histogram bins, which bounds the memory of long runs."""
MIN_S = 1e-6


class Latency:
    """Time from capture at the wrist to the light that shows it, wall seconds. Other threads may read it."""

    def __init__(self) -> None:
        self._classes: Counter[int] = Counter()
        self._pending: dict[int, None] = {}

    def on_cursor(self, cursor: Cursor) -> None:
        """Store a capture that waits for its frame."""
        if cursor.surface == "none" and not cursor.solid:
            return
        self._pending[cursor.stamp_ns] = None
        while len(self._pending) > RECENT:
            del self._pending[next(iter(self._pending))]

    def on_frame(self, frame: StripsFrame, now_ns: int, speed: float) -> None:
        """Count the first frame of a stored capture; `now_ns` runs `speed` times as fast as wall time."""
        if frame.stamp_ns in self._pending:
            del self._pending[frame.stamp_ns]
            value_s = (now_ns - frame.stamp_ns) / NS_PER_S / speed + frame.light_s
            self._classes[round(math.log(max(value_s, MIN_S), STEP))] += 1

    @property
    def count(self) -> int:
        """Return the number of captures shown as light."""
        return sum(dict(self._classes).values())

    def quantiles_ms(self) -> dict[str, float | None]:
        """Return median and 99th percentile, ms, exact to 0.3 %; values are None if nothing was measured."""
        classes = sorted(dict(self._classes).items())
        total = sum(number for _, number in classes)
        if not total:
            return {"p50": None, "p99": None}

        def quantile(share: float) -> float:  # nearest rank
            rank = math.ceil(share * total)
            for exponent, number in classes:
                rank -= number
                if rank <= 0:
                    return round(STEP**exponent * 1e3, 3)
            raise AssertionError("unreachable: the ranks sum up to the total")

        return {"p50": quantile(0.5), "p99": quantile(0.99)}
