"""How often a route sends or takes: at most at its rate, the newest, never later than it must."""

import random

BACK_S = (0.5, 2.0)
"""After so long we take up again what somebody else has let go."""

EARLY = 0.25
"""Share of a period by which a message may come too soon: samplers jitter, and holding back adds delay."""


def reclaim_delay_s() -> float:
    """Return after how long to take up what somebody else has let go, s; another time for each who asks.

    Of two bridges that have made room for each other one comes back first, and the other sees it in time:
    else both would come back, and make room again, for ever.
    """
    return random.uniform(*BACK_S)  # noqa: S311 - no secret


class RateLimiter:
    """Tells when the next message may be sent, or the next bytes be read."""

    def __init__(self, rate_hz: float | None, *, early_s: float | None = None) -> None:
        """Allow everything where `rate_hz` is none, and to be so much too soon; `EARLY` unless it is said."""
        self._period_s = 0.0 if rate_hz is None else 1.0 / rate_hz
        self._early_s = EARLY * self._period_s if early_s is None else early_s
        self._next_s = 0.0

    def wait_s(self, now_s: float) -> float:
        """Return for how long what comes at `now_s` has to wait, s; 0: it is sent."""
        wait_s = self._next_s - now_s
        return 0.0 if wait_s <= self._early_s else wait_s

    def sent(self, now_s: float, count: int = 1) -> None:
        """Count what was sent at `now_s`."""
        self._next_s = max(self._next_s, now_s - self._early_s) + count * self._period_s
