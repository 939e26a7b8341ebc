"""How much a page may say, or be sent, in a second."""

import math


class TokenBucket:
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
