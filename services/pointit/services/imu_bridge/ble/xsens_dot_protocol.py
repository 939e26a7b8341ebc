"""Bytes of Xsens and Movella DOT wrists: the short payload, and commands.

payload = u32 time in µs, then f32 w, x, y, z; little-endian
"""

import struct
from dataclasses import dataclass

from pointit.geometry.rotation import Quaternion
from pointit.schemas.base import unit_quaternion

CONTROL = "15172001-4947-11e9-8646-d663bd873d93"
SHORT_PAYLOAD = "15172004-4947-11e9-8646-d663bd873d93"
BATTERY = "15173001-4947-11e9-8646-d663bd873d93"
START = bytes.fromhex("010105")
STOP = bytes.fromhex("010005")
"""Payload 5: orientation as a quaternion."""
WRAP_US = 2**32


@dataclass(frozen=True, slots=True)
class Payload:
    """Device time, which wraps after 71 minutes, and world_from_sensor with norm 1."""

    time_us: int
    orientation_xyzw: Quaternion


def parse(data: bytes) -> Payload | None:
    """Return the content of a short payload, or None if it is broken."""
    if len(data) < 20:
        return None
    time_us, w, x, y, z = struct.unpack_from("<I4f", data)
    try:
        return Payload(time_us, unit_quaternion((x, y, z, w)))
    except ValueError:
        return None


def parse_battery(data: bytes) -> float | None:
    """Return the charge, 0 to 1, in a value of `BATTERY`, or None if it is empty."""
    return min(data[0], 100) / 100.0 if data else None


class UnwrappedTime:
    """Continues a 32-bit count of microseconds beyond its end. A smaller step back remains one."""

    def __init__(self) -> None:
        self._newest_us = 0
        self._wrapped_us = 0

    def ns(self, time_us: int) -> int:
        """Return the continued time of a sample, ns."""
        if self._newest_us - time_us > WRAP_US // 2:
            self._wrapped_us += WRAP_US
        self._newest_us = time_us
        return (self._wrapped_us + time_us) * 1000
