"""Framers: bytes of BNO08x (UART-RVC), WitMotion and x-IMU3 boards to readings.

They are pure. Whatever bytes they are fed, they do not raise, buffer at most one packet, and do not spin.

A packet has 19 bytes: 0xAA, 0xAA, an index, yaw, pitch and roll in 0.01°, acceleration along x, y and z in mg
(each 16 bits, little-endian), three reserved bytes, and the sum of all but the header.

The data sheet (1000-3927, 1.3.5.2) says that pitch turns about y and roll about x, in the order yaw, pitch,
roll. The acceleration in its own example fits only a pitch about x and a roll about y. So both are computed,
and the one is used whose direction of gravity is closer to the measured acceleration.

A packet has 11 bytes: 0x55, its type, four 16-bit numbers (little-endian), and the sum of all before.
A command has 5: 0xFF, 0xAA, a register, and its new value (little-endian).

A message ends with a line feed. ASCII: `Q,<time in µs>,w,x,y,z`. Binary: 0x80 + the same letter, 64 bits of
time, 32-bit floats (little-endian), where 0x0A within is sent as DB DC, and 0xDB as DB DD. A line that begins
with `{` answers a command, which is a line of JSON too.
"""

import math
import re
import string
import struct
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from typing import ClassVar, Final

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion, from_roll_pitch_yaw
from pointit.runtime.config.parameters import set_option
from pointit.schemas import Feedback
from pointit.schemas.base import unit_quaternion
from pointit.services.imu_bridge.sources import Battery, Item, Press, RawReading, Reading, Reconnected, Signal
from pointit.services.imu_bridge.streams import ContentError, unit_rotation

QUATERNION: Final = 0
EULER: Final = 1
RAW: Final = 2
"""Kinds of orientations that one device may send side by side, from the best to the worst."""
RESET_TIMEOUTS = 16
"""Number of packets without a better kind after which a worse one is used."""
MAX_COMMANDS = 16
FLASH_S = 0.3
"""Duration of a cue on a device with a lamp, s."""


class SerialFramer(ABC):
    """Converts bytes of a device to items."""

    UNIT: ClassVar[str] = "bytes"
    """Unit of `bad`."""
    HINT: ClassVar[str] = "check cable and baud"
    """Action against unreadable data, for a warning."""

    def __init__(self) -> None:
        self.good: int = 0
        """Number of valid packets or lines so far."""
        self.bad: int = 0
        """Number of unreadable lines or bytes after the first valid one. The owner may set it back to 0."""
        self.reason: str = ""
        """Error of the last of them."""
        self.commands: deque[bytes] = deque(maxlen=MAX_COMMANDS)
        """Commands to the device, to be sent one after another with a pause between them."""
        self.notice: str = ""
        """Message about what `commands` change, or `""`."""
        self.ran_on: bool = False
        """True if a counter showed after the last silence that the device had not been restarted."""

    @abstractmethod
    def feed(self, data: bytes, stamp_ns: int) -> list[Item]:
        """Return the items in the packets that `data`, arrived at `stamp_ns`, completes."""

    def on_silence(self) -> None:
        """Record a pause in the readings, after which the device may have been restarted."""
        self.ran_on = False

    def cue(self, cue: Feedback) -> tuple[bytes, bytes]:  # noqa: ARG002 - most devices have no signal
        """Return the commands that begin and end the signal for `cue`, empty if the device has none."""
        return b"", b""


class PacketCutter:
    """Cuts packets of a fixed length out of a stream, by header and checksum.

    After a wrong checksum it goes on with the next byte, since the header also occurs within packets.
    """

    def __init__(self, header: bytes, length: int, summed_from: int) -> None:
        r"""Set the regular expression of the header, also as far as it is complete at the end (`\Z`).

        Args:
            header: regular expression.
            length: of a packet, bytes.
            summed_from: index of the first byte that counts in the checksum, which is the last byte and the
                sum of all between, modulo 256.
        """
        self._header = re.compile(header, re.DOTALL)
        self._length = length
        self._summed_from = summed_from
        self._rest = b""
        self.skipped = 0
        """Number of bytes so far that belong to no packet."""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the packets that `data` completes."""
        stream = self._rest + data
        packets: list[bytes] = []
        at = taken = 0
        while (found := self._header.search(stream, at)) is not None:
            at = found.start()
            packet = stream[at : at + self._length]
            if len(packet) < self._length:
                break
            if sum(packet[self._summed_from : -1]) & 0xFF == packet[-1]:
                packets.append(packet)
                at += self._length
                taken += self._length
            else:
                at += 1
        else:
            at = len(stream)
        self.skipped += at - taken
        self._rest = stream[at:]
        return packets


class Preference:
    """Selects the best of several kinds of orientations that a device sends side by side."""

    def __init__(self) -> None:
        self._ages = [0] * (RAW + 1)

    def accepts(self, kind: int) -> bool:
        """Return True if a packet of `kind`, which has just arrived, is to be used."""
        self._ages = [age + 1 for age in self._ages]
        self._ages[kind] = 0
        return all(age > RESET_TIMEOUTS for age in self._ages[:kind])


BNO085_LENGTH = 19
BNO085_HEADER = rb"\xaa(?:\xaa|\Z)"
BAUD: Final = 115200
CENTIDEGREE = math.radians(0.01)
X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
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
        before = self._cutter.skipped
        packets = self._cutter.feed(data)
        if self.good and self._cutter.skipped > before:
            self.bad += self._cutter.skipped - before
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
        tilts = [
            rotation.multiply(
                rotation.from_axis_angle(pitch_axis, pitch * CENTIDEGREE),
                rotation.from_axis_angle(roll_axis, roll * CENTIDEGREE),
            )
            for pitch_axis, roll_axis in ((Y, X), (X, Y))
        ]
        amount = math.hypot(*acceleration_mg)
        if AT_REST_MG[0] < amount < AT_REST_MG[1]:
            for number, tilt in enumerate(tilts):
                up = rotation.rotate(rotation.inverse(tilt), (0.0, 0.0, 1.0))
                error = math.dist(up, [value / amount for value in acceleration_mg]) ** 2
                self._errors[number] = MEMORY * self._errors[number] + (1.0 - MEMORY) * error
            other = 1 - self._used
            if self._errors[other] < RATIO * self._errors[self._used]:
                self._used = other
        return rotation.multiply(heading, tilts[self._used])


BAUDS: Final = (115200, 9600, 921600, 230400, 460800, 57600, 38400, 19200, 4800)
"""Speeds of the devices, in the order in which they are tried."""
LENGTH = 11
HEADER = rb"\x55(?:[\x50-\x5a\x5f]|\Z)"
ACCELERATION: Final = 0x51
ANGULAR_VELOCITY: Final = 0x52
ANGLES: Final = 0x53
ORIENTATION: Final = 0x59
FULL_SCALE = 32768.0
G_MPS2 = 9.80665
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
        self._rate, self._rate_hz = (
            (RATE_100_HZ, 100) if baud >= BAUD_OF_100_HZ or not baud else (RATE_50_HZ, 50)
        )
        self._asked_at: int | None = None
        """Number of packets at which quaternions were asked for."""
        self._is_switched = self._is_suspect = False
        """It was switched to quaternions; since then, it may have lost that with its power."""

    def feed(self, data: bytes, stamp_ns: int) -> list[Item]:
        """Return the readings in the packets that `data` completes."""
        before = self._cutter.skipped
        packets = self._cutter.feed(data)
        if self.good and self._cutter.skipped > before:
            self.bad += self._cutter.skipped - before
            self.reason = "a wrong checksum"
        items: list[Item] = []
        for packet in packets:
            self.good += 1
            if self._configure and self._switch(packet[1]) and self._is_suspect:
                items.append(Reconnected())
            item = self._item(packet[1], _VALUES.unpack_from(packet, 2), stamp_ns)
            if item is not None:
                items.append(item)
        return items

    def on_silence(self) -> None:
        """Switch it again if it sends anything but quaternions."""
        super().on_silence()
        if self._is_switched:
            self._configure = self._is_suspect = True
            self._asked_at = None

    def _item(self, kind: int, values: tuple[int, int, int, int], stamp_ns: int) -> Item | None:
        a, b, c, d = values
        if kind == ORIENTATION:
            try:
                turned = unit_quaternion((b / FULL_SCALE, c / FULL_SCALE, d / FULL_SCALE, a / FULL_SCALE))
            except ValueError as error:
                self.bad += LENGTH
                self.reason = f"a packet has {error}"
                return None
            return Reading(stamp_ns, turned) if self._preference.accepts(QUATERNION) else None
        if kind == ANGLES and self._preference.accepts(EULER):
            return Reading(stamp_ns, from_roll_pitch_yaw(a * RAD, b * RAD, c * RAD))
        if kind == ACCELERATION:
            self._acceleration = (a * MPS2, b * MPS2, c * MPS2)
        elif kind == ANGULAR_VELOCITY and self._preference.accepts(RAW) and self._acceleration is not None:
            return RawReading(stamp_ns, (a * RADPS, b * RADPS, c * RADPS), self._acceleration)
        return None

    def _switch(self, kind: int) -> bool:
        """Queue the commands that the packet of `kind` calls for. Return True if there are any."""
        before = len(self.commands)
        if self._asked_at is None:
            if kind == ORIENTATION:  # somebody has configured it
                self._configure = False
            elif self.good > LENGTH:  # more than one turn of all packets
                self._asked_at = self.good
                self.commands.extend((UNLOCK, SIX_AXES, SEND_BOTH))
        elif kind == ORIENTATION:
            self.commands.extend((UNLOCK, SEND_QUATERNIONS, self._rate))
            self._is_switched = True
            self._end("quaternions")
        elif self.good - self._asked_at > ASKED_PACKETS:  # it has none
            self.commands.extend((UNLOCK, SEND_ANGLES, self._rate))
            self._end("Euler angles")
        return len(self.commands) > before

    def _end(self, what: str) -> None:
        self._configure = False
        self.notice = (
            f"switched to {what}, {self._rate_hz} Hz, 6 axes (no magnetometer) until its power is off; "
            f"{set_option('imu-bridge', 'serial.configure', 'false')} leaves it as it is"
        )


LONGEST = 512
"""Longest message that is waited for, bytes; the longest with numbers has 91."""
MAX_TIME_US = 2**53
NORMAL_COLOR = b'{"colour":null}\n'
"""Gives the LED back to the device."""
ARGUMENTS: Final = {"Q": 4, "A": 3, "I": 6, "B": 3, "W": 2, "O": 1}
"""Number of arguments of the messages that are read; lines of text may have more."""
_ESCAPES = re.compile(rb"\xdb(?![\xdc\xdd])")
_HEAD = struct.Struct("<Q")


def split(message: bytes) -> tuple[str, int, list[float]] | None:
    """Return letter, time in µs and arguments of `message` without its end, or None if nothing reads them.

    Raises:
        ContentError: If it is no message.
    """
    if message.startswith((b"{", b"^")):
        return None
    try:
        return _binary(message) if message[0] & 0x80 else _ascii(message)
    except (ValueError, IndexError, struct.error) as error:
        raise ContentError(str(error)) from error


def _binary(message: bytes) -> tuple[str, int, list[float]] | None:
    letter = chr(message[0] & 0x7F)
    count = ARGUMENTS.get(letter)
    if count is None:
        _check_letter(letter)
        return None
    if _ESCAPES.search(message):
        raise ContentError("has a wrong escape sequence")
    body = message[1:].replace(b"\xdb\xdc", b"\n").replace(b"\xdb\xdd", b"\xdb")
    if len(body) != _HEAD.size + 4 * count:
        raise ContentError(f"has {len(body)} bytes as {letter}, {_HEAD.size + 4 * count} were expected")
    (time_us,) = _HEAD.unpack_from(body)
    return letter, time_us, list(struct.unpack_from(f"<{count}f", body, _HEAD.size))


def _ascii(message: bytes) -> tuple[str, int, list[float]] | None:
    letter, *words = message.decode("ascii").rstrip("\r").split(",")
    count = ARGUMENTS.get(letter)
    if count is None:
        _check_letter(letter)
        return None
    if len(words) < count + 1:
        raise ContentError(f"has {len(words)} values as {letter}, {count + 1} were expected")
    return letter, int(words[0]), [float(word) for word in words[1 : count + 1]]


def _check_letter(letter: str) -> None:
    if letter not in string.ascii_uppercase:
        raise ContentError(f"begins with {letter[:20]!r}")


class Ximu3Framer(SerialFramer):
    """Reads quaternions, else Euler angles, else angular velocity and acceleration.

    Also battery, signal and button.
    """

    UNIT = "messages"
    HINT = "check cable and baud, and that the device's settings are those of an x-IMU3"

    def __init__(self) -> None:
        super().__init__()
        self._rest = b""
        self._skipping = False
        self._preference = Preference()

    def feed(self, data: bytes, stamp_ns: int) -> list[Item]:
        """Return the items in the messages that `data` completes."""
        *ended, rest = (self._rest + data).split(b"\n")
        if ended and self._skipping:
            del ended[0]
            self._skipping = False
        if len(rest) > LONGEST:
            self._count("has no end")
            self._skipping = True
        self._rest = b"" if self._skipping else rest
        items: list[Item] = []
        for message in ended:
            if not message.strip(b"\r"):
                continue
            try:
                found = split(message) if len(message) <= LONGEST else None
                if found is not None:
                    item = self._item(*found, stamp_ns)
                    self.good += 1
                    if item is not None:
                        items.append(item)
            except ContentError as error:
                self._count(str(error))
        return items

    def cue(self, cue: Feedback) -> tuple[bytes, bytes]:
        """Return the commands that begin and end a flash of the LED; there is no motor."""
        if cue.color is None and not cue.haptic_ms:
            return b"", b""
        color = "FFFFFF" if cue.color is None else "".join(f"{part:02X}" for part in cue.color)
        return f'{{"colour":"{color}"}}\n'.encode(), NORMAL_COLOR

    def _count(self, reason: str) -> None:
        if self.good:
            self.bad += 1
            self.reason = f"a message {reason}"

    def _item(self, letter: str, time_us: int, values: list[float], stamp_ns: int) -> Item | None:
        if not all(math.isfinite(value) for value in values):
            raise ContentError("has a number that is not finite")
        if not 0 <= time_us <= MAX_TIME_US:
            raise ContentError(f"has the time {time_us} µs")
        if letter == "B":
            return Battery(min(max(values[0] / 100.0, 0.0), 1.0), values[1])
        if letter == "W":
            return Signal(values[1])
        if letter == "O":
            return Press(stamp_ns) if values[0] else None
        return self._motion(letter, time_us * 1000, values, stamp_ns)

    def _motion(self, letter: str, time_ns: int, values: Sequence[float], stamp_ns: int) -> Item | None:
        if letter == "I":
            if not self._preference.accepts(RAW):
                return None
            x, y, z = (math.radians(value) for value in values[:3])
            ax, ay, az = (value * G_MPS2 for value in values[3:])
            return RawReading(stamp_ns, (x, y, z), (ax, ay, az), time_ns)
        if letter == "A":
            roll, pitch, yaw = (math.radians(value) for value in values)
            world_from_sensor = from_roll_pitch_yaw(roll, pitch, yaw)
            return Reading(stamp_ns, world_from_sensor, time_ns) if self._preference.accepts(EULER) else None
        world_from_sensor = unit_rotation(values[:4], "wxyz")
        self._preference.accepts(QUATERNION)
        return Reading(stamp_ns, world_from_sensor, time_ns)
