"""Framer of WitMotion boards.

A packet has 11 bytes: 0x55, its type, four 16-bit numbers (little-endian), and the sum of all before.
A command has 5: 0xFF, 0xAA, a register, and its new value (little-endian).
"""

import math
import struct
from typing import Final

from pointit.geometry.rotation import from_roll_pitch_yaw
from pointit.runtime.config.parameters import set_option
from pointit.schemas.base import unit_quaternion
from pointit.services.imu_bridge.serial.framers import (
    EULER,
    G_MPS2,
    QUATERNION,
    RAW,
    PacketCutter,
    Preference,
    SerialFramer,
)
from pointit.services.imu_bridge.sources import Item, RawReading, Reading, Reconnected

BAUDS: Final = (115200, 9600, 921600, 230400, 460800, 57600, 38400, 19200, 4800)
"""Speeds of the devices, in the order in which they are tried."""
LENGTH = 11
HEADER = rb"\x55(?:[\x50-\x5a\x5f]|\Z)"
ACCELERATION: Final = 0x51
ANGULAR_VELOCITY: Final = 0x52
ANGLES: Final = 0x53
ORIENTATION: Final = 0x59
FULL_SCALE = 32768.0

MPS2 = 16.0 * G_MPS2 / FULL_SCALE
RADPS = math.radians(2000.0) / FULL_SCALE
RAD = math.pi / FULL_SCALE
UNLOCK = bytes.fromhex("ff aa 69 88 b5")
SIX_AXES = bytes.fromhex("ff aa 24 01 00")
"""Orientation without the magnetometer, which steel and motors indoors disturb."""
SEND_BOTH = bytes.fromhex("ff aa 02 08 02")
SEND_QUATERNIONS = bytes.fromhex("ff aa 02 00 02")
SEND_ANGLES = bytes.fromhex("ff aa 02 08 00")
RATE_50_HZ = bytes.fromhex("ff aa 03 08 00")
RATE_100_HZ = bytes.fromhex("ff aa 03 09 00")
BAUD_OF_100_HZ = 19200
"""Speed from which 100 packets a second, 1100 bytes, fit."""
ASKED_PACKETS = 64
"""Number of packets to wait for the first quaternion after it was switched on."""
_VALUES = struct.Struct("<4h")


class WitMotionFramer(SerialFramer):
    """Reads quaternions, else Euler angles, else angular velocity and acceleration.

    A device that sends no quaternions is switched to them until it is switched off, if that is wanted.
    """

    def __init__(self, *, configure: bool, baud: int) -> None:
        """Set whether to `configure` the device, and the `baud` of its port, which limits the rate."""
        super().__init__()
        self._cutter = PacketCutter(HEADER, LENGTH, 0)
        self._preference = Preference()
        self._acceleration: tuple[float, float, float] | None = None
        self._configure = configure
        self._rate = RATE_50_HZ
        self._rate_hz = 50
        if baud >= BAUD_OF_100_HZ or not baud:
            self._rate = RATE_100_HZ
            self._rate_hz = 100
        self._asked_at: int | None = None
        """Number of packets at which quaternions were asked for."""
        self._is_switched = self._is_suspect = False
        """It was switched to quaternions; since then, it may have lost that with its power."""

    def feed(self, data: bytes, stamp_ns: int) -> list[Item]:
        """Return the readings in the packets that `data` completes."""
        skipped_before = self._cutter.skipped
        packets = self._cutter.feed(data)
        if self.good and self._cutter.skipped > skipped_before:
            self.bad += self._cutter.skipped - skipped_before
            self.reason = "a wrong checksum"
        items: list[Item] = []
        for packet in packets:
            self.good += 1
            if self._configure and self._queue_switch(packet[1]):
                if self._is_suspect:  # it was switched before: its power was off meanwhile
                    items.append(Reconnected())
            item = self._decode_packet(packet[1], _VALUES.unpack_from(packet, 2), stamp_ns)
            if item is not None:
                items.append(item)
        return items

    def on_silence(self) -> None:
        """Switch it again if it sends anything but quaternions."""
        super().on_silence()
        if self._is_switched:
            self._configure = self._is_suspect = True
            self._asked_at = None

    def _decode_packet(self, kind: int, values: tuple[int, int, int, int], stamp_ns: int) -> Item | None:
        a, b, c, d = values
        if kind == ORIENTATION:
            try:
                four = (b / FULL_SCALE, c / FULL_SCALE, d / FULL_SCALE, a / FULL_SCALE)
                orientation_xyzw = unit_quaternion(four)
            except ValueError as error:
                self.bad += LENGTH
                self.reason = f"a packet has {error}"
                return None
            return Reading(stamp_ns, orientation_xyzw) if self._preference.accepts(QUATERNION) else None
        if kind == ANGLES and self._preference.accepts(EULER):
            return Reading(stamp_ns, from_roll_pitch_yaw(a * RAD, b * RAD, c * RAD))
        if kind == ACCELERATION:
            self._acceleration = (a * MPS2, b * MPS2, c * MPS2)
        elif kind not in (ANGLES, ANGULAR_VELOCITY):
            self.passed_over.add(f"0x{kind:02x}")
        elif kind == ANGULAR_VELOCITY and self._preference.accepts(RAW):
            if self._acceleration is not None:
                return RawReading(stamp_ns, (a * RADPS, b * RADPS, c * RADPS), self._acceleration)
        return None

    def _queue_switch(self, kind: int) -> bool:
        """Queue the commands that the packet of `kind` calls for. Return True if there are any."""
        count_before = len(self.commands)
        if self._asked_at is None:
            if kind == ORIENTATION:  # somebody has configured it
                self._configure = False
            elif self.good > LENGTH:  # more than one turn of all packets
                self._asked_at = self.good
                self.commands.extend((UNLOCK, SIX_AXES, SEND_BOTH))
        elif kind == ORIENTATION:
            self.commands.extend((UNLOCK, SEND_QUATERNIONS, self._rate))
            self._is_switched = True
            self._end_configuration("quaternions")
        elif self.good - self._asked_at > ASKED_PACKETS:  # it has none
            self.commands.extend((UNLOCK, SEND_ANGLES, self._rate))
            self._end_configuration("Euler angles")
        return len(self.commands) > count_before

    def _end_configuration(self, output: str) -> None:
        self._configure = False
        self.notice = (
            f"switched to {output}, {self._rate_hz} Hz, 6 axes (no magnetometer) until its power is off; "
            f"{set_option('imu-bridge', 'serial.configure', 'false')} leaves it as it is"
        )
