"""Framer of BNO08x boards (UART-RVC).

A packet has 19 bytes: 0xAA, 0xAA, an index, yaw, pitch and roll in 0.01°, acceleration along x, y and z in mg
(each 16 bits, little-endian), three reserved bytes, and the sum of all but the header.

The data sheet (1000-3927, 1.3.5.2) says that pitch turns about y and roll about x, in the order yaw, pitch,
roll. The acceleration in its own example fits only a pitch about x and a roll about y. So both are computed,
and the one is used whose direction of gravity is closer to the measured acceleration.
"""

import math
import struct
from typing import Final

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.services.imu_bridge.serial.framers import PacketCutter, SerialFramer
from pointit.services.imu_bridge.sources import Item, Reading

BNO085_LENGTH = 19
BNO085_HEADER = rb"\xaa(?:\xaa|\Z)"
BAUD: Final = 115200
CENTIDEGREE = math.radians(0.01)
X = (1.0, 0.0, 0.0)
Y = (0.0, 1.0, 0.0)
AT_REST_MG = (900.0, 1100.0)
"""Range of the acceleration's amount at which it shows the direction of gravity, mg."""
MEMORY = 0.98
"""Weight of the past in the error of a convention, per packet."""
RATIO = 0.5
"""Ratio of errors below which the other convention is used."""
EARLY = 32
"""Index from which a packet is not one of the first ones after a start."""
_BNO085_VALUES = struct.Struct("<6h")


class Bno085Framer(SerialFramer):
    """Reads yaw, pitch and roll."""

    def __init__(self) -> None:
        super().__init__()
        self._cutter = PacketCutter(BNO085_HEADER, BNO085_LENGTH, 2)
        self._errors = [0.0, 0.0]
        """Smoothed squared error of gravity: pitch about y, pitch about x."""
        self._used = 0
        self._is_first = False
        """True if the next packet is the first after a silence."""

    def feed(self, data: bytes, stamp_ns: int) -> list[Item]:
        """Return the readings in the packets that `data` completes."""
        skipped_before = self._cutter.skipped
        packets = self._cutter.feed(data)
        if self.good and self._cutter.skipped > skipped_before:
            self.bad += self._cutter.skipped - skipped_before
            self.reason = "a wrong checksum"
        self.good += len(packets)
        if packets and self._is_first:
            self._is_first = False
            self.ran_on = packets[0][len(b"\xaa\xaa")] >= EARLY
        return [Reading(stamp_ns, self._orientation(packet)) for packet in packets]

    def on_silence(self) -> None:
        """Compare the next counter with that of a start."""
        super().on_silence()
        self._is_first = True

    def _orientation(self, packet: bytes) -> Quaternion:
        yaw, pitch, roll, *acceleration_mg = _BNO085_VALUES.unpack_from(packet, 3)
        heading = rotation.from_yaw(yaw * CENTIDEGREE)
        pitch_rad = pitch * CENTIDEGREE
        roll_rad = roll * CENTIDEGREE

        # Tilt by both conventions, whose axes of pitch and roll are exchanged
        tilts: list[Quaternion] = []
        for pitch_axis, roll_axis in ((Y, X), (X, Y)):
            pitch_turn = rotation.from_axis_angle(pitch_axis, pitch_rad)
            roll_turn = rotation.from_axis_angle(roll_axis, roll_rad)
            tilts.append(rotation.multiply(pitch_turn, roll_turn))

        # Use the one whose up is nearer to that of the acceleration
        amount = math.hypot(*acceleration_mg)
        if AT_REST_MG[0] < amount < AT_REST_MG[1]:
            for number, tilt in enumerate(tilts):
                up = rotation.rotate(rotation.inverse(tilt), (0.0, 0.0, 1.0))
                measured_up = [value / amount for value in acceleration_mg]
                error = math.dist(up, measured_up) ** 2
                self._errors[number] = MEMORY * self._errors[number] + (1.0 - MEMORY) * error
            other = 1 - self._used
            if self._errors[other] < RATIO * self._errors[self._used]:
                self._used = other
        return rotation.multiply(heading, tilts[self._used])
