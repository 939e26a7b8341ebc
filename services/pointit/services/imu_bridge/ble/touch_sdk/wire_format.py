"""Wire format of Protocol Buffers, version 3: the fields of one message, and their encoding.

Written by hand: the file of common types does not compile, and few fields are used. Groups, which
version 3 does not have, are refused.
"""

import struct
from collections.abc import Iterator

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
MAX_VARINT_BYTES = 10
"""Length of a negative number."""
MAX_FIELD = 2**29 - 1
"""Largest number of a field."""
_FLOAT = struct.Struct("<f")
Value = int | float | bytes
"""Varint without sign, float of 32 bits, or bytes of a message, a text or a packed list."""


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
        found = [each for each in self._values.get(number, ()) if isinstance(each, int)]
        return signed(found[-1], bits) if found else 0

    def real(self, number: int) -> float:
        """Return a float. The last one counts."""
        found = [each for each in self._values.get(number, ()) if isinstance(each, float)]
        return found[-1] if found else 0.0

    def messages(self, number: int) -> list[bytes]:
        """Return the bytes of each message of a list."""
        return [each for each in self._values.get(number, ()) if isinstance(each, bytes)]

    def message(self, number: int) -> bytes | None:
        """Return the bytes of one message, or None if it is absent. Parts of it are put together."""
        parts = self.messages(number)
        return b"".join(parts) if parts else None

    def integers(self, number: int) -> tuple[int, ...]:
        """Return a list of signed integers of 32 bits, packed or not."""
        found: list[int] = []
        for each in self._values.get(number, ()):
            if isinstance(each, int):
                found.append(each)
            elif isinstance(each, bytes):
                position = 0
                while position < len(each):
                    value, position = _read_varint(each, position)
                    found.append(value)
        return tuple(signed(each, 32) for each in found)


def signed(value: int, bits: int) -> int:
    """Return the lowest `bits` of `value` as a signed integer."""
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value


def _read_fields(data: bytes) -> Iterator[tuple[int, Value]]:
    """Yield number and value of each field; fixed numbers of 64 bits, which no message has, are skipped."""
    position = 0
    while position < len(data):
        tag, position = _read_varint(data, position)
        number, kind = tag >> 3, tag & 7
        if not 0 < number <= MAX_FIELD:
            raise ValueError(f"field {number} at byte {position}: numbers are 1 to {MAX_FIELD}")
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
