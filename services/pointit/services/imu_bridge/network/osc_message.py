"""Messages of Open Sound Control: each message and each argument is read as far as it can be."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.contents import DatagramError

LONGEST_DATAGRAM = 8192
MAX_MESSAGES = 64
DEEPEST = 4
"""Bundles within bundles that are read."""
IMMEDIATELY = 1
"""Time tag of a bundle without a time."""
UNIX_S = 2_208_988_800
"""Seconds from OSC's epoch, 1900, to that of Unix."""
MIN_UNTYPED = 16
"""Fewest bytes of arguments without types that are read as floats, as old senders leave the types out."""
_BUNDLE = b"#bundle\0"
_NUMBERS = {
    "i": struct.Struct(">i"),
    "f": struct.Struct(">f"),
    "h": struct.Struct(">q"),
    "d": struct.Struct(">d"),
}
_SIZES = {"t": 8, "c": 4, "r": 4, "m": 4, "N": 0, "[": 0, "]": 0}
"""Sizes of arguments that are passed over, bytes."""
_CONSTANTS: dict[str, float] = {"T": 1.0, "F": 0.0, "I": 1.0}


@dataclass(frozen=True, slots=True)
class OscMessage:
    """An address, and the numbers and strings behind it; other arguments are left out."""

    address: str
    numbers: tuple[float, ...]
    """Also those in strings."""
    time_ns: int | None
    """Time of its bundle, or None: Unix ns of the sender, ns since its start if its clock was never set."""
    types: str = field(default="", compare=False)
    """Type of each of the `numbers`."""
    strings: tuple[str, ...] = field(default=(), compare=False)
    """Strings that are not numbers."""
    problem: str = field(default="", compare=False)
    """Clause about an argument from which on nothing could be read, or `""`."""


def parse(data: bytes) -> list[OscMessage]:
    """Return the messages of a datagram that can be read, also those of bundles in it.

    Raises:
        DatagramError: If none can be read.
    """
    messages, problem = parse_each(data)
    if problem and not messages:
        raise DatagramError(problem)
    return messages


def parse_each(data: bytes) -> tuple[list[OscMessage], str]:
    """Return the messages of a datagram that can be read, and a clause about those that cannot, or `""`."""
    if len(data) > LONGEST_DATAGRAM:
        return [], f"has {len(data)} bytes, more than {LONGEST_DATAGRAM}"
    messages: list[OscMessage] = []
    problem = ""
    for content, time_ns in _contents(data, None, 0):
        if len(messages) >= MAX_MESSAGES:
            break
        try:
            messages.append(_message(content, time_ns))
        except ValueError as error:
            problem = problem or f"is not OSC: {error}"
    return messages, problem


def _contents(data: bytes, time_ns: int | None, depth: int) -> Iterator[tuple[bytes, int | None]]:
    """Yield the bytes of each message and the time of its bundle; `b""` for a part that is cut off."""
    at = len(_BUNDLE) + 8
    if not data.startswith(_BUNDLE) or len(data) < at or depth >= DEEPEST:
        yield data, time_ns
        return
    tag = int.from_bytes(data[len(_BUNDLE) : at])
    if tag > IMMEDIATELY:
        seconds = tag >> 32
        seconds -= UNIX_S if seconds >= UNIX_S else 0
        time_ns = seconds * NS_PER_S + ((tag & 0xFFFFFFFF) * NS_PER_S >> 32)
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], signed=True)
        at += 4
        if size <= 0 or at + size > len(data):
            yield b"", None
            return
        yield from _contents(data[at : at + size], time_ns, depth + 1)
        at += size


def _message(data: bytes, time_ns: int | None) -> OscMessage:
    """Return the message in `data`.

    Raises:
        ValueError: If it has no address, or none of its arguments can be read.
    """
    if not data:
        raise ValueError("an element of a bundle is cut off")
    if data.startswith(_BUNDLE):
        raise ValueError("too many bundles in bundles, or one that is cut off")
    address, at = _text(data, 0)
    if not address.startswith("/"):
        raise ValueError("an address without /")
    if at >= len(data):  # old senders leave the types out if there is no argument
        return OscMessage(address, (), time_ns)
    rest = data[at:]
    if not rest.startswith(b","):
        if len(rest) < MIN_UNTYPED or len(rest) % 4:
            raise ValueError("no types of arguments")
        return OscMessage(
            address, struct.unpack(f">{len(rest) // 4}f", rest), time_ns, "f" * (len(rest) // 4)
        )
    types, at = _text(data, at)
    message = _typed_message(address, types[1:], data[at:], time_ns)
    if message.problem and not (message.numbers or message.strings):
        raise ValueError(f"{address} {message.problem}")
    return message


def _typed_message(address: str, types: str, data: bytes, time_ns: int | None) -> OscMessage:
    """Return the message of the arguments in `data`, up to the first that cannot be read."""
    numbers: list[tuple[str, float]] = []
    strings: list[str] = []
    problem, at = "", 0
    for kind in types:
        try:
            value, at = _argument(kind, data, at)
        except ValueError as error:
            problem = f"has {error}"
            break
        if isinstance(value, str):
            strings.append(value)
        elif value is not None:
            numbers.append((kind, value))
    values = tuple(number for _, number in numbers)
    return OscMessage(address, values, time_ns, "".join(kind for kind, _ in numbers), tuple(strings), problem)


def _argument(kind: str, data: bytes, at: int) -> tuple[float | str | None, int]:
    """Return the argument at `at`, None if it is passed over, and where it ends.

    Raises:
        ValueError: If it is cut off, or its type is not known.
    """
    value: float | str | None = _CONSTANTS.get(kind)
    if kind in _NUMBERS:
        number = data[at : at + _NUMBERS[kind].size]
        if len(number) < _NUMBERS[kind].size:
            raise ValueError("a cut-off argument")
        return float(_NUMBERS[kind].unpack(number)[0]), at + len(number)
    if kind in "sS":
        text, at = _text(data, at)
        try:
            value = float(text)
        except ValueError:
            value = text
    elif kind == "b":
        size = int.from_bytes(data[at : at + 4])
        at += 4 + size + -size % 4
    elif kind not in _CONSTANTS and kind not in _SIZES:
        raise ValueError(f"an argument of the unknown type {kind!r}")
    at += _SIZES.get(kind, 0)
    if at > len(data) + 3:  # padding may be left out at the end
        raise ValueError("a cut-off argument")
    return value, at


def _text(data: bytes, at: int) -> tuple[str, int]:
    """Return the string at `at`, UTF-8 or else Latin-1, and where it ends with its padding."""
    end = data.find(b"\0", at)
    if end < 0 or at > len(data):
        raise ValueError("a string without an end")
    raw = data[at:end]
    try:
        text = raw.decode()
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return text, end + 4 - (end - at) % 4
