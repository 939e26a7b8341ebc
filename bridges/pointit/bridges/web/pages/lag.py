"""How far behind the hand pages show it."""

import math
from collections import deque

LATENCIES_S = 5.0
"""What the quantile goes back to."""

MOST_LATENCIES = 4096


class Latencies:
    """What pages say of the time from the capture at a wrist to the frame that shows it."""

    def __init__(self) -> None:
        """Begin with none."""
        self._heard: deque[tuple[float, float]] = deque(maxlen=MOST_LATENCIES)

    def add(self, latency_ms: float, now_s: float) -> None:
        """Take one."""
        self._heard.append((now_s, latency_ms))

    def p95_ms(self, now_s: float) -> float | None:
        """Return the 95th percentile of the last seconds, by nearest rank; none when nothing was heard."""
        while self._heard and now_s - self._heard[0][0] > LATENCIES_S:
            self._heard.popleft()
        values = sorted(latency_ms for _, latency_ms in self._heard)
        return values[math.ceil(0.95 * len(values)) - 1] if values else None
