"""Rate limit of messages from or to a page."""

import math


class TokenBucket:
    """Token bucket: `rate_hz` a second in the long run, `burst` at once."""

    def __init__(self, rate_hz: float, burst: float) -> None:
        self._rate_hz = rate_hz
        self._burst = burst
        self._level = burst
        self._at_s = -math.inf

    def take(self, now_s: float) -> bool:
        """Remove a token. Return False if there is none."""
        if self.wait_s(now_s) > 0.0:
            return False
        self._level -= 1.0
        return True

    def wait_s(self, now_s: float, min_tokens: float = 1.0) -> float:
        """Return the delay until `min_tokens` tokens (at most `burst`) are there, s."""
        passed_s = max(0.0, now_s - self._at_s)
        self._level = min(self._burst, self._level + passed_s * self._rate_hz)
        self._at_s = max(self._at_s, now_s)
        return max(0.0, (min_tokens - self._level) / self._rate_hz)
