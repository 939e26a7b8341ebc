"""A WitMotion sensor with Bluetooth in software: it streams by itself and is asked for its battery."""

import math
import struct
from collections.abc import Mapping
from typing import ClassVar

from pointit.geometry.rotation import inverse, multiply, rotate
from pointit.plugins import Quaternion
from pointit_lab.devices.wrists.wrist import Property, Sent, SimulatedWrist

_NOTIFY = "0000ffe4-0000-1000-8000-00805f9a34fb"
_WRITE = "0000ffe9-0000-1000-8000-00805f9a34fb"
_ONE_G = 2048
_FULL_RATE_RADPS = math.radians(2000.0)
_RATES_HZ = {6: 10.0, 7: 20.0, 8: 50.0, 9: 100.0, 11: 200.0}


class SimulatedWitMotion(SimulatedWrist):
    """A sensor that turns between its samples."""

    name: ClassVar[str] = "WT901BLE68"
    service: ClassVar[str] = "0000ffe5-0000-1000-8000-00805f9a34fb"
    characteristics: ClassVar[Mapping[str, tuple[Property, ...]]] = {
        _WRITE: ("write", "write-without-response"),
        _NOTIFY: ("notify",),
    }
    stream: ClassVar[str] = _NOTIFY

    def __init__(self) -> None:
        super().__init__()
        self.is_streaming = True
        self.is_unlocked = False
        self.rate_code = 6
        """Its register of the rate: 6 is 10 Hz."""
        self._previous: Quaternion | None = None

    def write(self, characteristic: str, data: bytes) -> Sent:
        """Return its answers to a command."""
        if characteristic != _WRITE:
            return
        if data == bytes.fromhex("ffaa6988b5"):
            self.is_unlocked = True
        elif data[:3] == bytes.fromhex("ffaa03") and self.is_unlocked:
            self.rate_code = data[3]
        elif data == bytes.fromhex("ffaa276400"):
            battery = struct.pack("<8h", 393, 0, 0, 0, 0, 0, 0, 0)
            yield _NOTIFY, bytes.fromhex("55716400") + battery

    def frame(self, orientation_xyzw: Quaternion) -> bytes:
        """Return the frame of its next sample. Raises ValueError if this is no orientation."""
        norm = math.hypot(*orientation_xyzw)
        if not abs(norm - 1.0) < 1e-3:
            raise ValueError("no orientation")
        up = rotate(inverse(orientation_xyzw), (0.0, 0.0, 1.0))
        previous = self._previous or orientation_xyzw
        x, y, z, w = multiply(inverse(previous), orientation_xyzw)
        self._previous = orientation_xyzw

        # twice the half angle, by the rate: small turns
        rate_hz = _RATES_HZ[self.rate_code]
        scale = math.copysign(2.0, w) * rate_hz / _FULL_RATE_RADPS * 32768.0
        turn = [_int16(scale * half_sine) for half_sine in (x, y, z)]
        acceleration = [round(_ONE_G * component) for component in up]
        values = struct.pack("<9h", *acceleration, *turn, 0, 0, 0)
        return b"\x55\x61" + values


def _int16(value: float) -> int:
    """Return the nearest value that the register can have."""
    return max(-32768, min(32767, round(value)))
