"""Rate limit of messages and bytes, and the delay before a released name is reclaimed."""

import random

BACK_S = (0.5, 2.0)
"""Range of delays (s) before a name released by another node is reclaimed."""

EARLY = 0.25
"""Share of a period by which a message may come early: samplers jitter, and holding back adds delay."""


def reclaim_delay_s() -> float:
    """Return a random delay (s) before a released name is reclaimed.

    Of two bridges that have yielded to each other one returns first, and the other sees it in time. Otherwise
    both would return and yield again for ever.
    """
    return random.uniform(*BACK_S)  # noqa: S311 - no secret


class RateLimiter:
    """Decides when the next message may be sent, or the next bytes be read."""

    def __init__(self, rate_hz: float | None, *, early_s: float | None = None) -> None:
        """Set the rate, or None for unlimited, and the permitted earliness, `EARLY` periods by default."""
        self._period_s = 0.0 if rate_hz is None else 1.0 / rate_hz
        self._early_s = EARLY * self._period_s if early_s is None else early_s
        self._next_s = 0.0

    def wait_s(self, now_s: float) -> float:
        """Return the delay of a message that comes at `now_s`, s; 0: send it."""
        wait_s = self._next_s - now_s
        return 0.0 if wait_s <= self._early_s else wait_s

    def sent(self, now_s: float, count: int = 1) -> None:
        """Count messages sent at `now_s`."""
        earliest_s = max(self._next_s, now_s - self._early_s)
        self._next_s = earliest_s + count * self._period_s
