"""Latency from the hand to the page."""

import math
from collections import deque

LATENCIES_S = 5.0
"""Window of the quantile."""

MAX_LATENCIES = 4096


class Latencies:
    """Latencies that pages report, from the capture at a wrist to the frame that shows it."""

    def __init__(self) -> None:
        """Begin without latencies."""
        self._heard: deque[tuple[float, float]] = deque(maxlen=MAX_LATENCIES)

    def add(self, latency_ms: float, now_s: float) -> None:
        """Add one."""
        self._heard.append((now_s, latency_ms))

    def p95_ms(self, now_s: float) -> float | None:
        """Return the 95th percentile (nearest rank) of the window, or None without reports."""
        while self._heard and now_s - self._heard[0][0] > LATENCIES_S:
            self._heard.popleft()
        values = sorted(latency_ms for _, latency_ms in self._heard)
        return values[math.ceil(0.95 * len(values)) - 1] if values else None
