"""Load of this machine: durations in tests are those of a quiet one."""

import os
import subprocess
import sys
import time
from collections.abc import Callable

START_S = 0.1
"""Start time of Python on a quiet machine, s."""
MOST = 5.0
"""Upper limit of how many times as long a test is patient."""


def slowness() -> float:
    """Return the factor by which this machine is slower now than when quiet, at least 1."""
    began_s = time.monotonic()
    subprocess.run([sys.executable, "-c", "pass"], check=True, timeout=60)
    start = (time.monotonic() - began_s) / START_S
    load = os.getloadavg()[0] / (os.cpu_count() or 1)
    return max(1.0, start, load)


def within(took_s: float, limit_s: float) -> bool:
    """Return True if `took_s` is less than `limit_s`, the limit on a quiet machine."""
    if took_s < limit_s:
        return True
    return took_s < limit_s * min(MOST, slowness())


class Patience:
    """A duration that begins now and is longer on a busy machine."""

    def __init__(self, duration_s: float) -> None:
        """Begin; `duration_s` is enough on a quiet machine."""
        self._duration_s = duration_s
        self._began_s = time.monotonic()
        self._factor: float | None = None

    def is_over(self) -> bool:
        """Return True if the duration is over.

        How busy the machine is, is measured once, when a quiet machine's duration is over.
        """
        passed_s = time.monotonic() - self._began_s
        if passed_s <= self._duration_s:
            return False
        if self._factor is None:
            self._factor = min(MOST, slowness())
        return passed_s > self._duration_s * self._factor

    def __str__(self) -> str:
        text = f"{self._duration_s} s"
        if self._factor is None:
            return text
        return f"{text} x {self._factor:.1f} (busy)"


class VirtualPatience(Patience):
    """A duration in a loop's virtual time, which no machine makes longer."""

    def __init__(self, duration_s: float, now_s: Callable[[], float]) -> None:
        super().__init__(duration_s)
        self._now_s = now_s
        self._began_s = now_s()

    def is_over(self) -> bool:
        return self._now_s() - self._began_s > self._duration_s
