"""The MCAP container under limits: records of a file, and the records in a chunk.

A hostile file costs bounded memory. Sizes are checked before anything is read or unpacked, and nothing that
a file says about itself (its index, its statistics) is trusted.
"""

import io
import os
import re
import struct
import zlib
from collections.abc import Collection, Iterator
from typing import IO, NamedTuple, TypeVar

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.runtime.host.unpacking import MAX_BYTES, UNPACKERS, TooLargeError, UnpackError

try:
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError
    from mcap.opcode import Opcode
    from mcap.records import Channel, Chunk, Metadata, Schema
    from mcap.writer import MCAP0_MAGIC, CompressionType, Writer  # noqa: F401 - those of writer.py
except ImportError as error:
    raise ConfigError(f"recordings need {remedy('record')}") from error


Record = TypeVar("Record", Channel, Chunk, Metadata, Schema)

MAX_RECORD_BYTES = MAX_BYTES
"""Maximum bytes of a record, and of an unpacked chunk."""

MAX_RECORDS = 50_000
"""Maximum number of records in a chunk: twice what fits into the megabyte at which a writer closes one."""

FREE_RECORDS = 1000
"""Records that a chunk may hold whatever its size. More need a byte of the file each, as no two messages of a
recorder are alike: a small file must not cost hours."""

_HEAD = struct.Struct("<BQ")
"""Opcode and length before each record."""
_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time before each message's content."""

_CHUNK_START = re.compile(rb"\x06(?=(.{8}).{28}(\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0)(.{8}))", re.DOTALL)
"""Opcode of a chunk, and behind it the length of the record, the packing, and the number of packed bytes."""
_CHUNK_BYTES = 28 + 8
"""Bytes of a chunk's record, without its head, beside its packing and the packed bytes."""
_MAX_CHUNK_START = 64
"""Maximum number of bytes up to the packed bytes."""

BLOCK_BYTES = 1024 * 1024
"""Bytes in which a chunk is looked for at once."""

DAMAGED = 0
"""Opcode of a place that holds no records."""

UNCHUNKED = 256
"""Opcode of a place that holds successive records outside of chunks, as small writers leave them."""
UNCHUNKED_BYTES = 64 * 1024
"""Bytes of such records that are read at once; a longer record is read alone."""

_INNER = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
"""Records that stand in chunks, or in their place."""


class DamagedError(Exception):
    """Bytes are no MCAP; says what is wrong with them."""


class RecordLocation(NamedTuple):
    """Position of a record's content in the file or chunk."""

    opcode: int
    offset: int
    length: int


def is_container(file: IO[bytes]) -> bool:
    """Return True if `file` begins as an MCAP file."""
    file.seek(0)
    return file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC


def records(file: IO[bytes]) -> Iterator[RecordLocation]:
    """Yield the records of the file, and a place of the kind `DAMAGED` for bytes before the next whole chunk.

    Reads no contents. What is wrong behind the data, where channels are repeated, just ends it.

    Raises:
        DamagedError: The data end before `DATA_END`, or are damaged from some place on.
    """
    if hasattr(file, "fileno"):
        size = os.fstat(file.fileno()).st_size
    else:
        size = file.seek(0, os.SEEK_END)
    offset = len(MCAP0_MAGIC)
    is_data = True
    while is_data or offset < size:
        file.seek(offset)
        head = file.read(_HEAD.size)
        opcode: int = Opcode.DATA_END
        length = size
        if len(head) == _HEAD.size:
            opcode, length = _HEAD.unpack(head)
        place = RecordLocation(opcode, offset + _HEAD.size, length)

        # Damaged, or cut off: the data continue at the next chunk. Behind the data nothing is searched
        is_damaged = opcode == DAMAGED or opcode > Opcode.DATA_END
        if is_damaged or place.offset + length > size:
            if not is_data:
                return
            chunk_offset = next_chunk(file, offset + 1)
            if chunk_offset is None:
                raise DamagedError(f"it {'is damaged' if is_damaged else 'ends'} in the middle")
            place = RecordLocation(DAMAGED, offset, chunk_offset - offset)
        yield place
        offset = place.offset + place.length
        is_data = is_data and opcode != Opcode.DATA_END


def data_blocks(places: Iterator[RecordLocation]) -> Iterator[RecordLocation]:
    """Yield `places`, those from `records`; successive messages, channels and schemas in the data as one.

    Such a block is a place of the kind `UNCHUNKED`. What follows `DATA_END` stays as it is.

    Raises:
        DamagedError: As `records` does, after the blocks before the damage.
    """
    block: RecordLocation | None = None
    is_data = True
    try:
        for place in places:
            is_data = is_data and place.opcode != Opcode.DATA_END
            if not is_data or place.opcode not in _INNER:
                if block is not None:
                    yield block
                    block = None
                yield place
                continue

            # Join it to the block, with its head, unless the block gets too long
            begin = place.offset - _HEAD.size
            end = place.offset + place.length
            if block is None:
                block = RecordLocation(UNCHUNKED, begin, end - begin)
            elif end - block.offset <= UNCHUNKED_BYTES:
                block = RecordLocation(UNCHUNKED, block.offset, end - block.offset)
            else:
                yield block
                block = RecordLocation(UNCHUNKED, begin, end - begin)
    except DamagedError:
        if block is not None:
            yield block
        raise
    if block is not None:
        yield block


def next_chunk(file: IO[bytes], offset: int) -> int | None:
    """Return the offset of the first record from `offset` on that has the form of a whole chunk, or None."""
    size = file.seek(0, os.SEEK_END)
    while offset < size:
        file.seek(offset)
        data = file.read(BLOCK_BYTES + _MAX_CHUNK_START)
        for match in _CHUNK_START.finditer(data, 0, BLOCK_BYTES + _MAX_CHUNK_START):
            length = int.from_bytes(match[1], "little")
            packed = int.from_bytes(match[3], "little")
            start = offset + match.start()
            is_whole = start + _HEAD.size + length <= size
            if is_whole and length == _CHUNK_BYTES + len(match[2]) + packed:
                return start
        offset += BLOCK_BYTES
    return None


def content(file: IO[bytes], place: RecordLocation) -> bytes:
    """Return the content of the record at `place`.

    Raises:
        DamagedError: It is too large.
    """
    if place.length > MAX_RECORD_BYTES:
        raise DamagedError(f"a record has {place.length} bytes, at most {MAX_RECORD_BYTES} are read")
    file.seek(place.offset)
    return file.read(place.length)


def read(file: IO[bytes], place: RecordLocation, kind: type[Record]) -> Record:
    """Return the record at `place`.

    Raises:
        DamagedError: It is too large, or is none.
    """
    return parse(content(file, place), kind)


def parse(content: bytes, kind: type[Record]) -> Record:
    """Return the record of `kind` in `content`.

    Raises:
        DamagedError: There is none.
    """
    stream = ReadDataStream(io.BytesIO(content))
    try:
        record: Record = kind.read(stream)  # pyrefly: ignore[bad-assignment]
    except (McapError, struct.error, ValueError, OverflowError, MemoryError) as error:
        raise DamagedError(f"a record of it is damaged ({type(error).__name__})") from error
    return record


def unpack(chunk: Chunk, packings: Collection[str] = ("zstd",)) -> bytes:
    """Return the records in `chunk`, which is not packed, or by one of `packings`.

    Raises:
        DamagedError: They are too large, damaged, or packed in another way.
    """
    data = chunk.data
    if chunk.compression:
        if chunk.compression not in packings:
            known = " or ".join(packings)
            packing = repr(chunk.compression[:16])
            raise DamagedError(f"a chunk of it is packed with {packing}, and only {known} is read")
        try:
            data = UNPACKERS[chunk.compression](chunk.data, MAX_RECORD_BYTES)
        except TooLargeError as error:
            raise DamagedError(f"a chunk of it {error}") from error
        except UnpackError as error:
            raise DamagedError("a chunk of it cannot be unpacked") from error

    # What the chunk says about itself must be true: its writer may have been killed, or be hostile
    if len(data) > MAX_RECORD_BYTES:
        raise DamagedError(f"a chunk of it has more than {MAX_RECORD_BYTES} bytes")
    if len(data) != chunk.uncompressed_size:
        raise DamagedError("a chunk of it is damaged: it unpacks to another size than it says")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise DamagedError("a chunk of it is damaged: its checksum differs")
    return data


def inner_records(chunk: Chunk, data: bytes) -> Iterator[RecordLocation]:
    """Yield where the records in `data` are, which is `chunk` unpacked.

    Raises:
        DamagedError: There are none from some place on, too many, or some that no chunk holds.
    """
    max_records = min(MAX_RECORDS, FREE_RECORDS + len(chunk.data))
    return _records_in(data, max_records)


def unchunked_records(data: bytes) -> Iterator[RecordLocation]:
    """Yield where the records in `data` are, the content of a place of the kind `UNCHUNKED`.

    Raises:
        DamagedError: A message is too short.
    """
    return _records_in(data, MAX_RECORDS)


def _records_in(data: bytes, max_records: int) -> Iterator[RecordLocation]:
    offset = 0
    count = 0
    while offset < len(data):
        if count >= max_records:
            raise DamagedError("a chunk of it is damaged: it holds too many records for its size")
        count += 1
        if offset + _HEAD.size > len(data):
            raise DamagedError("a chunk of it is damaged: a record is cut off")
        opcode, length = _HEAD.unpack_from(data, offset)
        offset += _HEAD.size
        is_short = opcode == Opcode.MESSAGE and length < _MESSAGE.size
        if is_short or offset + length > len(data):
            raise DamagedError("a chunk of it is damaged: a record is cut off")
        if opcode not in _INNER:
            raise DamagedError(f"a chunk of it is damaged: it holds a record of the kind {opcode}")
        yield RecordLocation(opcode, offset, length)
        offset += length


def message_times(data: bytes, place: RecordLocation) -> tuple[int, int]:
    """Return channel and log time (ns) of the message at `place`."""
    channel, _, time_ns, _ = _MESSAGE.unpack_from(data, place.offset)
    return channel, time_ns


def message_content(data: bytes, place: RecordLocation) -> bytes:
    """Return the content of the message at `place`."""
    begin = place.offset + _MESSAGE.size
    return data[begin : place.offset + place.length]
