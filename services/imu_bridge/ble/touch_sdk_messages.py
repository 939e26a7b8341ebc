"""Messages of the Touch SDK to and from a watch, in the wire format of Protocol Buffers.

Written by hand: the file of common types does not compile, and few fields are used. Groups, which
version 3 does not have, are refused.

Numbers of the fields are those of the maker's public specification. Fields that are not used are skipped.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from pointit.geometry.vector import Vec3

Value = int | float | bytes
"""Varint without sign, float of 32 bits, or bytes of a message, a text or a packed list."""
Quat = tuple[float, float, float, float]

_VARINT = 0
_FIXED64 = 1
_BYTES = 2
_FIXED32 = 5
MAX_VARINT_BYTES = 10
"""Length of a negative number."""
MAX_FIELD = 2**29 - 1
"""Largest number of a field."""
_FLOAT = struct.Struct("<f")
ADVERTISED_SERVICE = "008e74d0-7bb3-4ac5-8baf-e5e372cced76"
OUTPUT = "f9d60371-5325-4c64-b874-a68c7c555bad"
INPUT = "f9d60372-5325-4c64-b874-a68c7c555bad"
PINCH = 1
"""Type of a gesture: thumb and forefinger tap each other."""
BEGIN = 1
"""Type of a touch, as are those below."""
END = 2
MOVE = 3
CANCEL = 4
DISCONNECT = 1
"""Signal: the person declines or forgets this program, or the watch's app ends."""
RIGHT = 1
"""Hand that wears the watch."""
LEFT = 2
"""The other hand."""
MAX_HAPTIC_MS = 5000
"""Longest vibration, ms."""


class MessageFields:
    """Values of one message by the number of their field. Absent ones are 0, as the format demands."""

    def __init__(self, data: bytes) -> None:
        """Read `data`.

        Raises:
            ValueError: If it is cut, or no message.
        """
        self._values: dict[int, list[Value]] = {}
        for number, value in _read_fields(data):
            self._values.setdefault(number, []).append(value)

    def integer(self, number: int, bits: int = 32) -> int:
        """Return a signed integer of some bits. The last one counts."""
        values = [value for value in self._values.get(number, ()) if isinstance(value, int)]
        return signed(values[-1], bits) if values else 0

    def real(self, number: int) -> float:
        """Return a float. The last one counts."""
        values = [value for value in self._values.get(number, ()) if isinstance(value, float)]
        return values[-1] if values else 0.0

    def messages(self, number: int) -> list[bytes]:
        """Return the bytes of each message of a list."""
        return [value for value in self._values.get(number, ()) if isinstance(value, bytes)]

    def message(self, number: int) -> bytes | None:
        """Return the bytes of one message, or None if it is absent. Parts of it are put together."""
        parts = self.messages(number)
        return b"".join(parts) if parts else None

    def integers(self, number: int) -> tuple[int, ...]:
        """Return a list of signed integers of 32 bits, packed or not."""
        integers: list[int] = []
        for value in self._values.get(number, ()):
            if isinstance(value, int):
                integers.append(value)
            elif isinstance(value, bytes):
                position = 0
                while position < len(value):
                    integer, position = _read_varint(value, position)
                    integers.append(integer)
        return tuple(signed(integer, 32) for integer in integers)


def signed(value: int, bits: int) -> int:
    """Return the lowest `bits` of `value` as a signed integer."""
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value


def _read_fields(data: bytes) -> Iterator[tuple[int, Value]]:
    """Yield number and value of each field; fixed numbers of 64 bits, which no message has, are skipped."""
    position = 0
    while position < len(data):
        # Number and wire type are in one varint
        tag, position = _read_varint(data, position)
        number = tag >> 3
        kind = tag & 7
        if not 0 < number <= MAX_FIELD:
            raise ValueError(f"field {number} at byte {position}: numbers are 1 to {MAX_FIELD}")

        # Integers have no length of their own. All others: the length, then the value.
        if kind == _VARINT:
            value, position = _read_varint(data, position)
            yield number, value
            continue
        if kind == _BYTES:
            size, position = _read_varint(data, position)
        elif kind in (_FIXED32, _FIXED64):
            size = 4 if kind == _FIXED32 else 8
        else:
            raise ValueError(f"field {number} at byte {position} has the unknown wire type {kind}")
        end = position + size
        if end > len(data):
            raise ValueError(f"field {number} ends at byte {end}, the message at {len(data)}: it is cut")
        if kind == _BYTES:
            yield number, data[position:end]
        elif kind == _FIXED32:
            yield number, _FLOAT.unpack_from(data, position)[0]
        position = end


def _read_varint(data: bytes, position: int) -> tuple[int, int]:
    """Return the varint at `position`, cut to 64 bits, and the position behind it."""
    value = 0
    for index, byte in enumerate(data[position : position + MAX_VARINT_BYTES]):
        value |= (byte & 0x7F) << (7 * index)
        if byte < 0x80:
            return value & (2**64 - 1), position + index + 1
    raise ValueError(f"the number at byte {position} of {len(data)} has no end: the message is cut")


def encode_varint(number: int, value: int) -> bytes:
    """Return the field `number` with an integer, at least 0. The default 0 is not sent."""
    return _varint(number << 3 | _VARINT) + _varint(value) if value else b""


def encode_float(number: int, value: float) -> bytes:
    """Return the field `number` with a float of 32 bits. The default 0 is not sent."""
    return _varint(number << 3 | _FIXED32) + _FLOAT.pack(value) if value else b""


def encode_text(number: int, value: str) -> bytes:
    """Return the field `number` with a text. The default `""` is not sent."""
    return encode_bytes(number, value.encode()) if value else b""


def encode_bytes(number: int, value: bytes) -> bytes:
    """Return the field `number` with the bytes of a message, which may be empty."""
    return _varint(number << 3 | _BYTES) + _varint(len(value)) + value


def _varint(value: int) -> bytes:
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


@dataclass(frozen=True, slots=True)
class SensorFrame:
    """Values of the motion sensors at one time, in Android's frame of the device."""

    angular_velocity_radps: Vec3
    acceleration_mps2: Vec3
    orientation_xyzw: Quat
    """world_from_sensor as sent: of any norm, and four zeros if absent."""
    delta_ms: int
    """Time since the frame before, ms."""


@dataclass(frozen=True, slots=True)
class TouchEvent:
    """A change of the fingers on the screen."""

    kind: int
    coordinates_px: tuple[tuple[float, float], ...]
    """Position of each finger: right and down from the upper left corner, px."""


@dataclass(frozen=True, slots=True)
class WatchInfo:
    """Description of the watch."""

    hand: int
    battery_percent: int
    """Charge in %. 0 if absent."""
    screen_width_px: float
    """Width of its screen, px. 0 if absent."""


@dataclass(frozen=True, slots=True)
class Update:
    """Content of one message of a watch. Numbers that an enumeration does not know are kept."""

    frames: tuple[SensorFrame, ...]
    gestures: tuple[int, ...]
    touches: tuple[TouchEvent, ...]
    rotary_steps: tuple[int, ...]
    signals: tuple[int, ...]
    delta_ms: int
    """Time since the message before, ms. 0 if absent."""
    unix_ms: int
    """The watch's clock, ms since 1970. 0 if absent."""
    info: WatchInfo | None


def decode_update(data: bytes) -> Update:
    """Return the content of a message of *output*.

    Raises:
        ValueError: If it is cut, or no message.
    """
    fields = MessageFields(data)
    frames = [_decode_frame(message) for message in fields.messages(1)]
    gestures = _decode_types(fields.messages(2))
    touches = [_decode_touch(message) for message in fields.messages(3)]
    rotary_steps = _decode_types(fields.messages(5))
    info = fields.message(9)
    return Update(
        frames=tuple(frames),
        gestures=gestures,
        touches=tuple(touches),
        rotary_steps=rotary_steps,
        signals=fields.integers(6),
        delta_ms=fields.integer(7),
        unix_ms=fields.integer(8, 64),
        info=None if info is None else _decode_info(info),
    )


def encode_haptic(intensity: float, duration_ms: int) -> bytes:
    """Return the `InputUpdate` of one vibration: `intensity` from 0 to 1, at most `MAX_HAPTIC_MS` long."""
    duration_ms = min(duration_ms, MAX_HAPTIC_MS)
    event = encode_varint(1, 1) + encode_float(2, intensity) + encode_varint(3, duration_ms)
    return encode_bytes(1, event)


def encode_client_info(app: str, device: str, system: str) -> bytes:
    """Return the `InputUpdate` by which a program introduces itself; the watch shows it to the person."""
    info = encode_text(1, app) + encode_text(2, device) + encode_text(4, system)
    return encode_bytes(2, info)


def _decode_types(messages: list[bytes]) -> tuple[int, ...]:
    """Return the first field of each message: the type of a gesture, or the step of the crown."""
    return tuple(MessageFields(message).integer(1) for message in messages)


def _decode_frame(data: bytes) -> SensorFrame:
    fields = MessageFields(data)
    quaternion = MessageFields(fields.message(4) or b"")
    orientation_xyzw = (quaternion.real(2), quaternion.real(3), quaternion.real(4), quaternion.real(1))
    return SensorFrame(
        angular_velocity_radps=_decode_vector(fields.message(1)),
        acceleration_mps2=_decode_vector(fields.message(2)),
        orientation_xyzw=orientation_xyzw,
        delta_ms=fields.integer(5),
    )


def _decode_vector(data: bytes | None) -> Vec3:
    fields = MessageFields(data or b"")
    return (fields.real(1), fields.real(2), fields.real(3))


def _decode_touch(data: bytes) -> TouchEvent:
    fields = MessageFields(data)
    positions = [MessageFields(position) for position in fields.messages(4)]
    coordinates_px = tuple((position.real(1), position.real(2)) for position in positions)
    return TouchEvent(fields.integer(1), coordinates_px)


def _decode_info(data: bytes) -> WatchInfo:
    fields = MessageFields(data)
    screen = MessageFields(fields.message(11) or b"")
    return WatchInfo(
        hand=fields.integer(1),
        battery_percent=fields.integer(9),
        screen_width_px=screen.real(1),
    )
