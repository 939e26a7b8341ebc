"""How often and how regularly messages come; pure."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Rate:
    """One key over one window."""

    key: str
    messages: int
    rate_hz: float | None
    """From the first to the last message; none for fewer than two."""
    nominal_hz: float | None
    """As in the topic table; none where messages come on change."""
    period_min_s: float | None
    period_max_s: float | None
    """The silence at the end counts, when it is the longest."""
    jitter_s: float | None
    """Standard deviation of the periods."""
    bytes_per_s: float


class RateMeter:
    """Counts one key; keeps sums, not messages."""

    def __init__(self, key: str, nominal_hz: float | None = None) -> None:
        self._key = key
        self._nominal_hz = nominal_hz
        self._last_s: float | None = None
        self._reset()

    def _reset(self) -> None:
        self._messages = self._bytes = self._periods = 0
        self._mean_s = self._squares_s2 = 0.0
        self._min_s, self._max_s = math.inf, 0.0

    def add(self, now_s: float, size: int) -> None:
        """Count a message of `size` bytes that came at `now_s`."""
        if self._last_s is not None:
            period_s = now_s - self._last_s
            self._periods += 1
            self._min_s = min(self._min_s, period_s)
            self._max_s = max(self._max_s, period_s)
            step_s = period_s - self._mean_s  # Welford's running variance
            self._mean_s += step_s / self._periods
            self._squares_s2 += step_s * (period_s - self._mean_s)
        self._last_s = now_s
        self._messages += 1
        self._bytes += size

    def take(self, now_s: float, window_s: float) -> Rate:
        """Return the account of the last `window_s` until `now_s`, and begin the next."""
        known = self._periods > 0
        silence_s = 0.0 if self._last_s is None else now_s - self._last_s
        rate = Rate(
            key=self._key,
            messages=self._messages,
            rate_hz=1.0 / self._mean_s if known and self._mean_s > 0 else None,
            nominal_hz=self._nominal_hz,
            period_min_s=self._min_s if known else None,
            period_max_s=max(self._max_s, silence_s) if known else None,
            jitter_s=math.sqrt(self._squares_s2 / self._periods) if known else None,
            bytes_per_s=self._bytes / window_s,
        )
        self._reset()
        return rate
