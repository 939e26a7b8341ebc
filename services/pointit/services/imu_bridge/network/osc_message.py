"""Open Sound Control 1.0: datagrams to messages."""

import struct
from dataclasses import dataclass

from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.contents import DatagramError

LONGEST_DATAGRAM = 8192
MOST_MESSAGES = 64
DEEPEST = 4
"""Bundles within bundles that are read."""
IMMEDIATELY = 1
"""Time tag of a bundle without a time."""
UNIX_S = 2_208_988_800
"""Seconds from OSC's epoch, 1900, to that of Unix."""

_BUNDLE = b"#bundle\0"
_NUMBERS = {
    "i": struct.Struct(">i"),
    "f": struct.Struct(">f"),
    "h": struct.Struct(">q"),
    "d": struct.Struct(">d"),
}
_SIZES = {"t": 8, "c": 4, "r": 4, "m": 4}
"""Sizes of arguments that are passed over, bytes."""
_CONSTANTS: dict[str, float] = {"T": 1.0, "F": 0.0, "I": 1.0}


@dataclass(frozen=True, slots=True)
class OscMessage:
    """An address and the numbers behind it; other arguments are left out."""

    address: str
    numbers: tuple[float, ...]
    time_ns: int | None
    """Time of its bundle, or None: Unix ns of the sender, ns since its start if its clock was never set."""


def parse(data: bytes) -> list[OscMessage]:
    """Return the messages of a datagram, also those of bundles in it.

    Raises:
        DatagramError: If it is not OSC.
    """
    if len(data) > LONGEST_DATAGRAM:
        raise DatagramError(f"has {len(data)} bytes, more than {LONGEST_DATAGRAM}")
    messages: list[OscMessage] = []
    try:
        _read(data, None, 0, messages)
    except (struct.error, ValueError, OverflowError) as error:
        raise DatagramError(f"is not OSC: {error}") from error
    return messages


def _read(data: bytes, time_ns: int | None, depth: int, messages: list[OscMessage]) -> None:
    if not data.startswith(_BUNDLE):
        if len(messages) < MOST_MESSAGES:
            messages.append(_message(data, time_ns))
        return
    if depth >= DEEPEST:
        raise ValueError("too many bundles in bundles")
    (tag,) = struct.unpack_from(">Q", data, len(_BUNDLE))
    if tag > IMMEDIATELY:
        seconds = tag >> 32
        seconds -= UNIX_S if seconds >= UNIX_S else 0
        time_ns = seconds * NS_PER_S + ((tag & 0xFFFFFFFF) * NS_PER_S >> 32)
    at = len(_BUNDLE) + 8
    while at < len(data):
        (size,) = struct.unpack_from(">i", data, at)
        at += 4
        if size <= 0 or at + size > len(data):
            raise ValueError(f"an element of {size} bytes")
        _read(data[at : at + size], time_ns, depth + 1, messages)
        at += size


def _message(data: bytes, time_ns: int | None) -> OscMessage:
    address, at = _text(data, 0)
    if not address.startswith("/"):
        raise ValueError("an address without /")
    if at >= len(data):  # old senders leave the types out if there is no argument
        return OscMessage(address, (), time_ns)
    types, at = _text(data, at)
    if not types.startswith(","):
        raise ValueError("no types of arguments")
    numbers: list[float] = []
    for kind in types[1:]:
        if kind in _NUMBERS:
            numbers.append(float(_NUMBERS[kind].unpack_from(data, at)[0]))
            at += _NUMBERS[kind].size
        elif kind in _CONSTANTS:
            numbers.append(_CONSTANTS[kind])
        else:
            at = _behind(kind, data, at)
    if at > len(data):
        raise ValueError("a cut-off argument")
    return OscMessage(address, tuple(numbers), time_ns)


def _behind(kind: str, data: bytes, at: int) -> int:
    """Return where the argument at `at`, which is no number, ends."""
    if kind in "sS":
        return _text(data, at)[1]
    if kind == "b":
        (size,) = struct.unpack_from(">I", data, at)
        return int(at + 4 + size + -size % 4)
    if kind in _SIZES:
        return at + _SIZES[kind]
    if kind in "N[]":
        return at
    raise ValueError(f"an argument of the unknown type {kind!r}")


def _text(data: bytes, at: int) -> tuple[str, int]:
    """Return the text at `at`, and where what follows it begins."""
    end = data.index(b"\0", at)  # raises ValueError
    return data[at:end].decode("ascii"), end + 4 - (end - at) % 4
