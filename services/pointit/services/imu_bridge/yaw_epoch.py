"""When the device's yaw origin is another one than before, as far as its own time and its connection tell."""

import itertools
from collections.abc import Iterator

from pointit.schemas import NS_PER_S

BACK_NS = NS_PER_S
"""A device's time that falls by more has begun anew; by less, samples came out of order."""

WRAP_NS = 2**32 * 1000
"""Boards that count microseconds in 32 bits begin again at 0 after 71 minutes without being restarted."""


class YawEpoch:
    """Counts yaw origins, and makes one line of a device time that wraps."""

    def __init__(self, numbers: Iterator[int] | None = None) -> None:
        """Take the number of each new origin from `numbers`, which others may take from, too; or count."""
        self._numbers = itertools.count(1) if numbers is None else numbers
        self.count = 0
        """The number of the origin; another origin never has the same."""
        self._has_read = False
        self._newest_ns: int | None = None
        """Device time as it was sent."""
        self._wrapped_ns = 0

    def start_new_epoch(self) -> None:
        """Take that whoever sets origin or mounting has set it."""
        self.count = next(self._numbers)

    def reconnected(self) -> None:
        """Take that the device came back: nobody knows what happened to it meanwhile."""
        if self._has_read:
            self.count = next(self._numbers)
        self._newest_ns = None
        self._wrapped_ns = 0

    def read(self, device_time_ns: int | None) -> int | None:
        """Take a sample's device time and return it without wraps; a restart counts."""
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
