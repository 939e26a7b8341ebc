"""Files of ROS 2 bags that rosbags cannot read: cut off, without an index, or with a write-ahead log.

What is complete is read, in bounded memory.
"""

import contextlib
import sqlite3
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, NamedTuple

from rosbags.rosbag2.storage_mcap import DECOMPRESSORS

from pointit.recording.container import (
    DAMAGED,
    MAX_RECORD_BYTES,
    DamagedError,
    is_container,
    message_content,
    next_chunk,
    parse,
)
from pointit.recording.container import RecordLocation as RecordPlace
from pointit.recording.container import message_times as message_head
from pointit.recording.entries import METADATA
from pointit.recording.library import (
    MCAP0_MAGIC,
    Channel,
    Metadata,
    Opcode,
    Schema,
    ZstdDecompressor,
    ZstdError,
)
from pointit.runtime.errors import ConfigError

_RECORD = struct.Struct("<BQ")
"""Opcode and length before each record."""
_CHUNK = struct.Struct("<QQQII")
"""Times, unpacked size, checksum and length of the packing's name of a chunk."""
_MESSAGE_BYTES = 22
"""Bytes of a message record before its content."""


class BagConnection(NamedTuple):
    """A topic of a file."""

    id: int
    topic: str
    msgtype: str
    digest: str = ""
    """Hash of the type, or `""` if it is unknown."""


BagMessage = tuple[BagConnection, int, bytes]
"""Topic, time of recording (ns), and serialized message."""


def read_mcap(path: Path) -> Iterator[BagMessage]:
    """Yield the complete messages of an MCAP file in the order of the file.

    Raises:
        DamagedError: If it is none, or after the last message, what is wrong with the rest.
        ConfigError: If it is a recording of PointIt.
    """
    with path.open("rb") as file:
        if not is_container(file):
            raise DamagedError("does not begin as an MCAP file")
        size = path.stat().st_size
        topics = _Topics(path)
        with contextlib.suppress(DamagedError):  # a damaged chunk may have descriptions that the end repeats
            for opcode, content in _records(file, size):
                topics.add(opcode, content)
        try:
            for opcode, content in _records(file, size):
                if opcode == Opcode.MESSAGE and len(content) >= _MESSAGE_BYTES:
                    place = RecordPlace(opcode, 0, len(content))
                    number, time_ns = message_head(content, place)
                    if (connection := topics.connection(number)) is not None:
                        yield connection, time_ns, message_content(content, place)
        except DamagedError as error:
            raise DamagedError(f"{error}{topics.problem}") from error
        if topics.problem:
            raise DamagedError(topics.problem.removeprefix(", and "))


class _Topics:
    """The topics of a file by the number of their channel."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, BagConnection | None] = {}
        self._unknown = 0

    def add(self, opcode: int, content: bytes) -> None:
        """Add what a record describes. One that is damaged is ignored.

        Raises: ConfigError: If it is that of a recording of PointIt.
        """
        with contextlib.suppress(DamagedError):
            if opcode == Opcode.SCHEMA:
                schema = parse(content, Schema)
                self._schemas.setdefault(schema.id, schema.name)
            elif opcode == Opcode.CHANNEL:
                channel = parse(content, Channel)
                msgtype = self._schemas.get(channel.schema_id, "")
                connection = BagConnection(channel.id, channel.topic, msgtype)
                if channel.message_encoding != "cdr":
                    self._channels.setdefault(channel.id, None)
                elif msgtype:
                    self._channels[channel.id] = connection
            elif opcode == Opcode.METADATA and parse(content, Metadata).name == METADATA:
                raise ConfigError(
                    f"{self._path}: is a recording of PointIt; give it to `pointit export`, `page` or "
                    "`replay`"
                )

    def connection(self, number: int) -> BagConnection | None:
        """Return the topic of the channel `number`, or None if it is unknown or has no ROS messages."""
        self._unknown += number not in self._channels
        return self._channels.get(number)

    @property
    def problem(self) -> str:
        """Return a clause on the messages whose channel is not described, or `""`."""
        return f", and {self._unknown} messages have lost their description" if self._unknown else ""


def _records(file: IO[bytes], size: int) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and content of the records of a file of `size` bytes, also of those in chunks.

    Raises: DamagedError: After the last record, if some are damaged or missing.
    """
    offset, damage, is_ended = len(MCAP0_MAGIC), "", False
    while offset + _RECORD.size <= size:
        file.seek(offset)
        opcode, length = _RECORD.unpack(file.read(_RECORD.size))
        is_unknown = opcode == DAMAGED or opcode > Opcode.DATA_END
        if is_unknown or (opcode == Opcode.CHUNK and offset + _RECORD.size + length > size):
            if is_ended:
                break
            following = next_chunk(file, offset + 1)
            if following is not None or is_unknown:
                damage = damage or "is damaged between two chunks"
                offset = size if following is None else following
                continue
        offset += _RECORD.size
        file.seek(offset)
        content = file.read(min(length, size - offset, MAX_RECORD_BYTES))
        if opcode == Opcode.CHUNK:
            data, problem = _unpacked(content)
            damage = damage or (problem if offset + length <= size else f"is cut off after {size} bytes")
            yield from _inner_records(data)
        elif len(content) == length:
            yield opcode, content
        offset += length
        is_ended = is_ended or opcode in (Opcode.DATA_END, Opcode.FOOTER)
        if opcode == Opcode.FOOTER:
            break
    if not damage and not is_ended:
        damage = f"is cut off after {size} bytes"
    if damage:
        raise DamagedError(damage)


def _inner_records(data: bytes) -> Iterator[tuple[int, bytes]]:
    offset = 0
    while offset + _RECORD.size <= len(data):
        opcode, length = _RECORD.unpack_from(data, offset)
        offset += _RECORD.size
        if offset + length > len(data):
            return
        yield opcode, data[offset : offset + length]
        offset += length


def _unpacked(content: bytes) -> tuple[bytes, str]:
    """Return the records of a chunk, as many as are there, and what is wrong with it, or `""`."""
    if len(content) < _CHUNK.size:
        return b"", "has a chunk that is damaged"
    *_, size, checksum, length = _CHUNK.unpack_from(content)
    packing = content[_CHUNK.size : _CHUNK.size + length].decode(errors="replace")
    packed = content[_CHUNK.size + length + 8 :]
    data = b""
    try:
        if packing == "zstd":
            with ZstdDecompressor(max_window_size=MAX_RECORD_BYTES).stream_reader(packed) as reader:
                data = reader.read(min(size, MAX_RECORD_BYTES))
        else:
            data = DECOMPRESSORS[packing](packed, size)[:MAX_RECORD_BYTES]
    except KeyError:
        return b"", f"has a chunk that is packed with {packing[:16]!r}"
    except (ZstdError, MemoryError, RuntimeError):
        return b"", "has a chunk that cannot be unpacked"
    if len(data) < size:
        return data, "has a chunk that is damaged"
    if checksum and zlib.crc32(data) != checksum:
        return b"", "has a chunk whose checksum differs"
    return data, ""


def journals_of(path: Path) -> list[Path]:
    """Return the journals beside the SQLite file at `path`, with messages that its writer left there."""
    journals = (path.with_name(path.name + suffix) for suffix in ("-wal", "-journal"))
    return [each for each in journals if each.is_file() and each.stat().st_size]


def page_bytes(path: Path) -> int:
    """Return the size of the pages of the SQLite file at `path`."""
    with path.open("rb") as file:
        size = int.from_bytes(file.read(18)[16:], "big")
    return 65536 if size <= 1 else size


def read_sqlite(path: Path) -> Iterator[BagMessage]:
    """Yield the messages of an SQLite file in the order of the file, with those of its write-ahead log.

    Raises:
        DamagedError: If it is none, or after the last message, what is wrong with the rest.
    """
    try:
        options = "" if journals_of(path) else "?immutable=1"  # which replays journals, or writes nothing
        with contextlib.closing(sqlite3.connect(f"{path.resolve().as_uri()}{options}", uri=True)) as database:
            database.execute("PRAGMA writable_schema=ON")  # else SQLite opens no file that is cut off
            topics = database.execute("SELECT id, name, type FROM topics").fetchall()
            connections: Mapping[int, BagConnection] = {row[0]: BagConnection(*row) for row in topics}
            for number, time_ns, data in database.execute("SELECT topic_id, timestamp, data FROM messages"):
                if number in connections and isinstance(time_ns, int) and isinstance(data, bytes):
                    yield connections[number], time_ns, data
    except sqlite3.Error as error:
        raise DamagedError(f"is damaged ({error})") from error
