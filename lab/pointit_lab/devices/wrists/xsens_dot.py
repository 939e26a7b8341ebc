"""An Xsens DOT in software: it measures from its start command on."""

import struct
from collections.abc import Mapping
from typing import ClassVar

from pointit.plugins import Quaternion
from pointit_lab.devices.wrists.wrist import Property, Sent, SimulatedWrist

_CONTROL = "15172001-4947-11e9-8646-d663bd873d93"
_SHORT_PAYLOAD = "15172004-4947-11e9-8646-d663bd873d93"
_BATTERY = "15173001-4947-11e9-8646-d663bd873d93"
_PERIOD_US = 16_667


class SimulatedXsensDot(SimulatedWrist):
    """A sensor whose clock goes on by one sample with each."""

    name: ClassVar[str] = "Movella DOT"
    service: ClassVar[str] = "15172000-4947-11e9-8646-d663bd873d93"
    characteristics: ClassVar[Mapping[str, tuple[Property, ...]]] = {
        _CONTROL: ("read", "write"),
        _SHORT_PAYLOAD: ("notify",),
        _BATTERY: ("read", "notify"),
    }
    stream: ClassVar[str] = _SHORT_PAYLOAD

    def __init__(self, time_us: int = 0) -> None:
        super().__init__()
        self.time_us = time_us
        self.values = {_CONTROL: b"\0\0\0", _BATTERY: bytes((87, 0))}

    def write(self, characteristic: str, data: bytes) -> Sent:
        """Start or end the measurement."""
        if characteristic != _CONTROL:
            return ()
        if data[:1] == b"\1" and data[2:] == b"\5":
            self.is_streaming = data[1:2] == b"\1"
        return ()

    def frame(self, orientation_xyzw: Quaternion) -> bytes:
        """Return the next short payload."""
        x, y, z, w = orientation_xyzw
        self.time_us = (self.time_us + _PERIOD_US) % 2**32
        return struct.pack("<I4f", self.time_us, w, x, y, z)
