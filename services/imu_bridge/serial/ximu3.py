"""Framer of x-IMU3 boards.

A message ends with a line feed. ASCII: `Q,<time in µs>,w,x,y,z`. Linear acceleration (L) and earth
acceleration (E) begin with the same quaternion. Binary: 0x80 + the same letter, 64 bits of
time, 32-bit floats (little-endian), where 0x0A within is sent as DB DC, and 0xDB as DB DD. A line that begins
with `{` answers a command, which is a line of JSON too.
"""

import math
import re
import string
import struct
from collections.abc import Sequence
from typing import Final

from pointit.geometry.rotation import from_roll_pitch_yaw
from pointit.schemas import Feedback
from pointit.services.imu_bridge.serial.framers import (
    EULER,
    G_MPS2,
    QUATERNION,
    RAW,
    Preference,
    SerialFramer,
)
from pointit.services.imu_bridge.sources import Battery, Item, Press, RawReading, Reading, Signal
from pointit.services.imu_bridge.streams import ContentError, unit_rotation

LONGEST = 512
"""Longest message that is waited for, bytes; the longest with numbers has 91."""
MAX_TIME_US = 2**53
NORMAL_COLOR = b'{"colour":null}\n'
"""Gives the LED back to the device."""
ARGUMENTS: Final = {"Q": 4, "L": 7, "E": 7, "A": 3, "I": 6, "B": 3, "W": 2, "O": 1}
"""Number of arguments of the messages that are read; lines of text may have more."""
ACCELERATIONS: Final = ("L", "E")
"""Messages that old firmware sends with three numbers, without the quaternion."""
_ESCAPES = re.compile(rb"\xdb(?![\xdc\xdd])")
_HEAD = struct.Struct("<Q")


class UnreadKindError(Exception):
    """A message is of a kind that is not read; the text is its letter."""


def split(message: bytes) -> tuple[str, int, list[float]] | None:
    """Return letter, time in µs and arguments of `message` without its end, or None for an answer.

    Raises:
        ContentError: If it is no message.
        UnreadKindError: If it is of a kind that is not read.
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
        raise UnreadKindError(letter)
    if _ESCAPES.search(message):
        raise ContentError("has a wrong escape sequence")
    body = message[1:].replace(b"\xdb\xdc", b"\n").replace(b"\xdb\xdd", b"\xdb")
    if letter in ACCELERATIONS and len(body) == _HEAD.size + 4 * 3:
        raise UnreadKindError(letter)
    if len(body) != _HEAD.size + 4 * count:
        raise ContentError(f"has {len(body)} bytes as {letter}, {_HEAD.size + 4 * count} were expected")
    (time_us,) = _HEAD.unpack_from(body)
    return letter, time_us, list(struct.unpack_from(f"<{count}f", body, _HEAD.size))


def _ascii(message: bytes) -> tuple[str, int, list[float]] | None:
    letter, *words = message.decode("ascii").rstrip("\r").split(",")
    count = ARGUMENTS.get(letter)
    if count is None:
        _check_letter(letter)
        raise UnreadKindError(letter)
    if letter in ACCELERATIONS and len(words) == 1 + 3:
        raise UnreadKindError(letter)
    if len(words) < count + 1:
        raise ContentError(f"has {len(words)} values as {letter}, {count + 1} were expected")
    arguments = [float(word) for word in words[1 : count + 1]]
    return letter, int(words[0]), arguments


def _check_letter(letter: str) -> None:
    if letter not in [*string.ascii_uppercase]:
        raise ContentError(f"begins with {letter[:20]!r}")


class Ximu3Framer(SerialFramer):
    """Reads quaternions, else Euler angles, else angular velocity and acceleration.

    Also battery, signal and button.
    """

    UNIT = "messages"
    HINT = "check cable and baud, and that the device's settings are those of an x-IMU3"
    MISSING = "set the AHRS message type of the x-IMU3 to quaternion"

    def __init__(self) -> None:
        super().__init__()
        self._rest = b""
        self._skipping = False
        self._preference = Preference()

    def feed(self, data: bytes, stamp_ns: int) -> list[Item]:
        """Return the items in the messages that `data` completes."""
        # Cut it into messages. Of one without an end, all is skipped up to the next end.
        *ended, rest = (self._rest + data).split(b"\n")
        if ended and self._skipping:
            del ended[0]
            self._skipping = False
        if len(rest) > LONGEST:
            self._count_bad("has no end")
            self._skipping = True
        self._rest = b"" if self._skipping else rest

        # A message that cannot be read is counted, and the others are used
        items: list[Item] = []
        for message in ended:
            if not message.strip(b"\r"):
                continue
            try:
                content = split(message) if len(message) <= LONGEST else None
                if content is not None:
                    item = self._decode_message(*content, stamp_ns)
                    self.good += 1
                    if item is not None:
                        items.append(item)
            except UnreadKindError as error:
                self.passed_over.add(str(error))
            except ContentError as error:
                self._count_bad(str(error))
        return items

    def cue(self, cue: Feedback) -> tuple[bytes, bytes]:
        """Return the commands that begin and end a flash of the LED; there is no motor."""
        if cue.color is None and not cue.haptic_ms:
            return b"", b""
        color = "FFFFFF"
        if cue.color is not None:
            color = "".join(f"{part:02X}" for part in cue.color)
        return f'{{"colour":"{color}"}}\n'.encode(), NORMAL_COLOR

    def _count_bad(self, reason: str) -> None:
        if self.good:
            self.bad += 1
            self.reason = f"a message {reason}"

    def _decode_message(self, letter: str, time_us: int, values: list[float], stamp_ns: int) -> Item | None:
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
        return self._decode_motion(letter, time_us * 1000, values, stamp_ns)

    def _decode_motion(
        self, letter: str, time_ns: int, values: Sequence[float], stamp_ns: int
    ) -> Item | None:
        if letter == "I":
            if not self._preference.accepts(RAW):
                return None
            x, y, z = (math.radians(value) for value in values[:3])
            ax, ay, az = (value * G_MPS2 for value in values[3:])
            return RawReading(stamp_ns, (x, y, z), (ax, ay, az), time_ns)
        if letter == "A":
            roll, pitch, yaw = (math.radians(value) for value in values)
            world_from_sensor = from_roll_pitch_yaw(roll, pitch, yaw)
            if not self._preference.accepts(EULER):
                return None
            return Reading(stamp_ns, world_from_sensor, time_ns)
        world_from_sensor = unit_rotation(values[:4], "wxyz")
        if letter != "Q":  # the same orientation: a device may send it beside its quaternions
            is_used = self._preference.accepts(EULER)
            return Reading(stamp_ns, world_from_sensor, time_ns) if is_used else None
        self._preference.accepts(QUATERNION)
        return Reading(stamp_ns, world_from_sensor, time_ns)
