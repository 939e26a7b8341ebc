"""Detection of new yaw origins of a device, from its own time and its connection."""

import itertools
from collections.abc import Iterator

from pointit.schemas import NS_PER_S

BACK_NS = NS_PER_S
"""Device time that falls by more is a restart; by less, samples came out of order."""

WRAP_NS = 2**32 * 1000
"""Boards that count microseconds in 32 bits restart at 0 after 71 minutes of operation."""


class YawEpoch:
    """Counts yaw origins, and unwraps the device time."""

    def __init__(self, numbers: Iterator[int] | None = None) -> None:
        """Use `numbers`, which may be shared, for new origins; or count from 1."""
        self._numbers = itertools.count(1) if numbers is None else numbers
        self.count = 0
        """Number of the present origin, unique among origins."""
        self._has_read = False
        self._newest_ns: int | None = None
        """Device time as received."""
        self._wrapped_ns = 0

    def start_new_epoch(self) -> None:
        """Start a new origin after the origin or the mounting was set."""
        self.count = next(self._numbers)

    def reconnected(self, *, keeps_yaw: bool = False) -> None:
        """Start a new origin unless the device kept its own: it may have been restarted, or be another."""
        if keeps_yaw:
            return
        if self._has_read:
            self.count = next(self._numbers)
        self._newest_ns = None
        self._wrapped_ns = 0

    def read(self, device_time_ns: int | None) -> int | None:
        """Return a sample's device time without wraps; a restart starts a new origin."""
        self._has_read = True
        newest_ns = self._newest_ns
        if device_time_ns is None:
            return None
        if newest_ns is None or device_time_ns >= newest_ns:
            self._newest_ns = device_time_ns
        elif newest_ns - device_time_ns > BACK_NS:
            if 0 <= WRAP_NS - newest_ns < BACK_NS and device_time_ns < BACK_NS:
                self._wrapped_ns += WRAP_NS
            else:
                self.count = next(self._numbers)
                self._wrapped_ns = 0
            self._newest_ns = device_time_ns
        return device_time_ns + self._wrapped_ns
