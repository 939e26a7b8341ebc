"""How much a page may say, and how far behind the hand pages show it."""

import math
from collections import deque

LATENCIES_S = 5.0
"""What the quantile goes back to."""

MOST_LATENCIES = 4096


class Bucket:
    """Lets `rate_hz` a second pass in the long run, `burst` at once."""

    def __init__(self, rate_hz: float, burst: float) -> None:
        """Begin full."""
        self._rate_hz = rate_hz
        self._burst = burst
        self._level = burst
        self._at_s = -math.inf

    def take(self, now_s: float) -> bool:
        """Take one, if there is one."""
        if self.wait_s(now_s) > 0.0:
            return False
        self._level -= 1.0
        return True

    def wait_s(self, now_s: float, least: float = 1.0) -> float:
        """Return in how many seconds there are `least`, at most `burst`; 0: there are."""
        passed_s = max(0.0, now_s - self._at_s)
        self._level = min(self._burst, self._level + passed_s * self._rate_hz)
        self._at_s = max(self._at_s, now_s)
        return max(0.0, (least - self._level) / self._rate_hz)


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
