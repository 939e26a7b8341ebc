"""Packets of NatNet 2.0 to 4.1, and of later versions while their layout is the same. Pure.

Integers and floats are little-endian, lengths metres. Since 4.1 each section states its size, so that all
but the rigid bodies are skipped unread. Coordinates are those of the stream: Motive's settings say which axis
is up.
"""

import struct
from collections.abc import Iterable
from typing import NamedTuple

from pointit.bridges.mocap.bodies import BodySample, body_sample, decode_name
from pointit.bridges.mocap.config import MAX_BODIES

Version = tuple[int, int]

COMMAND_PORT = 1510
DATA_PORT = 1511
GROUP = "239.255.42.99"
"""Multicast group of servers before 3.0, which do not state it."""
CONNECT = 0
SERVER_INFO = 1
MODEL_REQUEST = 4
MODEL = 5
FRAME = 7
KEEP_ALIVE = 10
ECHO_REQUEST = 12
ECHO = 13
DISCOVERY = 14
MODEL_CHANGED = 2
"""Bit of a frame's flags: bodies have other names."""
IS_EDITING = 4
"""Bit of a frame's flags: the take is edited."""
BITSTREAM_CHANGED = 8
"""Bit of a frame's flags: the version of the stream is another."""
OCCLUDED = 1
"""Bit of a labelled marker's flags: no camera sees it."""
MODEL_FILLED = 4
"""Bit of a labelled marker's flags: it is computed by the model."""
MAX_VERSION = (4, 1)
"""Version that is requested of unicast servers. Later ones were never seen."""
SIZED = (4, 1)
"""Version since which sections state their sizes."""
SUFFIX_BYTES = 54
"""Length of the times and flags at the end of a frame since 4.1."""
MAX_COUNT = 65535
"""Limit of the items of a section: a datagram has no room for more."""
_HEADER = struct.Struct("<HH")
_BODY = struct.Struct("<i3f4f")
_INFO = struct.Struct("<256s4B4B")
_CONNECTION = struct.Struct("<QHB4s")
_TICKS = struct.Struct("<3Q")

_MARKER_SET, _RIGID_BODY, _SKELETON, _PLATE, _DEVICE, _CAMERA = range(6)
"""Kinds of models."""


class MalformedPacketError(ValueError):
    """A packet that is damaged, or of no known layout."""


class ServerInfo(NamedTuple):
    """Answer of a server to a connection or a search."""

    application: str
    version: Version
    """Version of NatNet."""
    clock_hz: int
    """Ticks per second of the server's clock, or 0 before 3.0."""
    data_port: int
    is_multicast: bool
    group: str


class MocapFrame(NamedTuple):
    """One frame of all bodies."""

    number: int
    bodies: tuple[BodySample, ...]
    exposure_ticks: int
    """Middle of the exposure by the server's clock, or 0 if unknown."""
    sent_ticks: int
    """Time of sending by the server's clock, or 0 before 3.0."""
    flags: int


class PacketReader:
    """Reads values one after another."""

    def __init__(self, data: bytes, at: int = 0) -> None:
        """Start at byte `at`."""
        self.data = data
        self.at = at

    def skip(self, size: int) -> None:
        """Pass over `size` bytes."""
        if not 0 <= size <= len(self.data) - self.at:
            size_here = len(self.data)
            raise MalformedPacketError(f"{size} bytes are missing at byte {self.at} of {size_here}")
        self.at += size

    def count(self, item_bytes: int = 1) -> int:
        """Return a number of items of at least `item_bytes`."""
        (count,) = struct.unpack_from("<i", self.data, self.at)
        self.at += 4
        size = count * item_bytes
        if not 0 <= size <= len(self.data) - self.at or count > MAX_COUNT:
            total = len(self.data)
            raise MalformedPacketError(f"{count} items at byte {self.at} of {total}")
        return int(count)

    def text(self) -> str:
        """Return a text that a zero ends."""
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise MalformedPacketError(f"a text does not end after byte {self.at}")
        begin = self.at
        self.at = end + 1
        return decode_name(self.data[begin:end])


def packet(message: int, payload: bytes = b"") -> bytes:
    """Return a packet."""
    return _HEADER.pack(message, len(payload)) + payload


def connect_packet(message: int = CONNECT) -> bytes:
    """Return a request to connect by unicast with `MAX_VERSION`, or another one of the same layout."""
    version = (*MAX_VERSION, 0, 0)
    info = _INFO.pack(b"PointIt", *version, *version)
    request = struct.pack("<B4B", 0, *version)
    return packet(message, info + request)


def echo_packet(time_ns: int) -> bytes:
    """Return a request for the server's time."""
    return packet(ECHO_REQUEST, struct.pack("<Q", time_ns))


def split_packet(data: bytes) -> tuple[int, bytes]:
    """Return the message and the payload of a packet.

    Raises:
        MalformedPacketError: If it is cut off.
    """
    if len(data) < _HEADER.size:
        raise MalformedPacketError(f"{len(data)} bytes are no packet")
    message, size = _HEADER.unpack_from(data)
    if size > len(data) - _HEADER.size:
        expected = size + _HEADER.size
        raise MalformedPacketError(f"{len(data)} bytes instead of {expected}")
    return message, data[_HEADER.size : _HEADER.size + size]


def read_echo(payload: bytes) -> tuple[int, int]:
    """Return the sent time, ns, and the server's ticks at its arrival.

    Raises:
        MalformedPacketError: If it is too short.
    """
    if len(payload) < 16:
        raise MalformedPacketError(f"{len(payload)} bytes are no echo")
    time_ns, ticks = struct.unpack_from("<QQ", payload)
    return time_ns, ticks


def read_server_info(payload: bytes) -> ServerInfo:
    """Return the description that a server sends.

    Raises:
        MalformedPacketError: If it is too short.
    """
    if len(payload) < _INFO.size:
        raise MalformedPacketError(f"{len(payload)} bytes are no description of a server")
    name, *_, major, minor, _build, _revision = _INFO.unpack_from(payload)
    clock_hz = 0
    port = DATA_PORT
    is_multicast = 1
    group = bytes(map(int, GROUP.split(".")))
    if len(payload) >= _INFO.size + _CONNECTION.size:
        clock_hz, port, is_multicast, group = _CONNECTION.unpack_from(payload, _INFO.size)
    application = name.partition(b"\0")[0].decode("utf-8", "replace")
    address = ".".join(map(str, group))
    version = (major, minor)
    return ServerInfo(application, version, clock_hz, port or DATA_PORT, bool(is_multicast), address)


def read_frame(payload: bytes, version: Version) -> MocapFrame:
    """Return the bodies and times of a frame.

    Raises:
        MalformedPacketError: If it is damaged.
    """
    try:
        return _frame(PacketReader(payload), version)
    except struct.error as error:
        raise MalformedPacketError(f"a frame of {len(payload)} bytes ends early") from error


def _frame(reader: PacketReader, version: Version) -> MocapFrame:
    data = reader.data
    is_sized = version >= SIZED
    (number,) = struct.unpack_from("<i", data)
    reader.at = 4

    # Marker sets and unlabelled markers are not used
    for skip in (_skip_marker_sets, _skip_markers):
        count, end = _section(reader, is_sized=is_sized)
        if end is None:
            skip(reader, count)
        else:
            reader.skip(end - reader.at)

    # Rigid bodies
    count, end = _section(reader, is_sized=is_sized, limit=MAX_BODIES)
    bodies: list[BodySample] = []
    if end is None:
        for _ in range(count):
            bodies.append(_body(reader, version))
    else:
        for offset in _strides(reader.at, end, count, _BODY.size + 6):
            bodies.append(_body(PacketReader(data, offset), version))
        reader.skip(end - reader.at)

    # Skeletons and assets (4.1) are not used
    if version >= (2, 1):
        _skip_skeletons(reader, version, is_sized=is_sized)
    if is_sized:
        _, end = _section(reader, is_sized=True)
        reader.skip((end or reader.at) - reader.at)

    # Labelled markers: how many of each body cameras see
    if version >= (2, 6):
        measured = _measured_markers(reader, version, is_sized=is_sized)
        bodies = [body._replace(measured=measured.get(body.id)) for body in bodies]

    # Times and flags are counted from the end: force plates and devices before them are not read
    exposure = 0
    sent = 0
    if version >= (3, 0):
        suffix_bytes = SUFFIX_BYTES if is_sized else 46
        exposure, _, sent = _TICKS.unpack_from(data, len(data) - suffix_bytes + 16)
    (flags,) = struct.unpack_from("<H", data, len(data) - 6)
    return MocapFrame(number, tuple(bodies), exposure, sent, flags)


def _skip_skeletons(reader: PacketReader, version: Version, *, is_sized: bool) -> None:
    count, end = _section(reader, is_sized=is_sized)
    if end is not None:
        reader.skip(end - reader.at)
        return
    for _ in range(count):
        reader.skip(4)
        for _bone in range(reader.count(_BODY.size)):
            _body(reader, version)


def _measured_markers(reader: PacketReader, version: Version, *, is_sized: bool) -> dict[int, int]:
    """Return the number of markers that cameras see, by the id of their body."""
    measured: dict[int, int] = {}
    count, end = _section(reader, is_sized=is_sized)
    item_bytes = 26 if version >= (3, 0) else 22
    if end is None:
        end = reader.at + count * item_bytes
    for offset in _strides(reader.at, end, count, item_bytes):
        (marker,) = struct.unpack_from("<i", reader.data, offset)
        (flags,) = struct.unpack_from("<H", reader.data, offset + 20)
        body_id = marker >> 16
        is_seen = not flags & (OCCLUDED | MODEL_FILLED)
        measured[body_id] = measured.get(body_id, 0) + is_seen
    return measured


def _section(reader: PacketReader, *, is_sized: bool, limit: int = MAX_COUNT) -> tuple[int, int | None]:
    """Return the number of items of a section, and the byte after it if it is stated."""
    count = reader.count()
    if count > limit:
        raise MalformedPacketError(f"{count} items, limit {limit}")
    if not is_sized:
        return count, None
    size = reader.count()
    return count, reader.at + size


def _strides(begin: int, end: int, count: int, item_bytes: int) -> Iterable[int]:
    """Return where the items of a section begin. Newer versions may have longer ones."""
    stride = (end - begin) // count if count else item_bytes
    if stride < item_bytes:
        raise MalformedPacketError(f"items of {stride} bytes instead of {item_bytes}")
    return range(begin, begin + count * stride, stride)


def _skip_marker_sets(reader: PacketReader, count: int) -> None:
    for _ in range(count):
        reader.text()
        reader.skip(12 * reader.count(12))


def _skip_markers(reader: PacketReader, count: int) -> None:
    reader.skip(12 * count)


def _body(reader: PacketReader, version: Version) -> BodySample:
    number, *values = _BODY.unpack_from(reader.data, reader.at)
    reader.at += _BODY.size
    if version < (3, 0):
        reader.skip(20 * reader.count(20))
    (error_m,) = struct.unpack_from("<f", reader.data, reader.at)
    reader.skip(4)
    is_tracked = True
    if version >= (2, 6):
        (flags,) = struct.unpack_from("<H", reader.data, reader.at)
        is_tracked = bool(flags & 1)
        reader.skip(2)
    return body_sample(number, values[:3], values[3:], error_m, is_tracked=is_tracked)


def read_models(payload: bytes, version: Version) -> dict[int, tuple[str, ...]]:
    """Return the names of the rigid bodies by their ids. Several of one id cannot be told apart.

    Raises:
        MalformedPacketError: If the list is damaged.
    """
    reader = PacketReader(payload)
    names = dict[int, tuple[str, ...]]()
    try:
        for _ in range(reader.count()):
            kind = reader.count(0)
            end = None
            if version >= SIZED:
                size = reader.count()
                end = reader.at + size
            if kind == _RIGID_BODY:
                name, number = _body_model(reader, version)
                names[number] = (*names.get(number, ()), name)
            elif end is None:
                _skip_model(reader, kind, version)
            if end is not None:
                reader.at = end
    except struct.error as error:
        raise MalformedPacketError(f"a list of models of {len(payload)} bytes ends early") from error
    return names


def _body_model(reader: PacketReader, version: Version) -> tuple[str, int]:
    name = reader.text()
    (number,) = struct.unpack_from("<i", reader.data, reader.at)
    reader.skip(20)
    is_listed = version >= (3, 0) and version < SIZED
    if is_listed:
        count = reader.count(16)
        reader.skip(16 * count)
        if version >= (4, 0):
            for _ in range(count):
                reader.text()
    return name, number


def _skip_model(reader: PacketReader, kind: int, version: Version) -> None:
    """Skip a model that is no body. Before 4.1 the layout of each kind must be known."""
    # Sets of markers, by name
    if kind == _MARKER_SET:
        reader.text()
        for _ in range(reader.count()):
            reader.text()
    # Skeletons: the bones are like bodies
    elif kind == _SKELETON:
        reader.text()
        reader.skip(4)
        for _ in range(reader.count(20)):
            _body_model(reader, version)
    # Analog devices, which have channels
    elif kind in (_PLATE, _DEVICE):
        reader.skip(4)
        reader.text()
        if kind == _PLATE:
            reader.skip(4 * (2 + 3 + 144 + 12))
        else:
            reader.text()
        reader.skip(8)
        for _ in range(reader.count()):
            reader.text()
    elif kind == _CAMERA:
        reader.text()
        reader.skip(28)
    else:
        raise MalformedPacketError(f"models of kind {kind} are unknown")
