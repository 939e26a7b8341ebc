"""Foreign, newer and hostile files: one sentence, bounded memory."""

import io
import resource
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk
from mcap.writer import Writer
from zstandard import ZstdCompressor

from pointit.recording.entries import METADATA, RecordingError, make_head
from pointit.recording.reader import Recording
from pointit.recording.writer import RecordingWriter
from pointit.schemas import NS_PER_S, ImuSample
from pointit.schemas.catalogue.catalogue import example

START = 1_700_000_000 * NS_PER_S


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "session.mcap"


class Hostile(Writer):
    def __init__(self, file: io.BufferedWriter) -> None:
        super().__init__(file)
        self.file = file
        self.start(profile="", library="hostile")
        self.add_metadata(METADATA, {"head": make_head("lab", START).model_dump_json()})

    def chunk(self, data: bytes) -> None:
        self.packed_chunk(ZstdCompressor().compress(data), len(data))

    def packed_chunk(self, packed: bytes, size: int, compression: str = "zstd") -> None:
        times = {"message_start_time": START, "message_end_time": START}
        sizes = {"uncompressed_crc": 0, "uncompressed_size": size}
        self.file.write(records(Chunk(compression=compression, data=packed, **times, **sizes)))


@pytest.fixture
def hostile(path: Path) -> Iterator[Hostile]:
    with path.open("wb") as file:
        yield Hostile(file)


def records(*parts: Any) -> bytes:
    builder = RecordBuilder()
    for part in parts:
        part.write(builder)
    content: bytes = builder.end()
    return content


def zeros_packed(total: int) -> bytes:
    packer = ZstdCompressor(level=1).compressobj()
    block = bytes(1 << 20)
    return b"".join(packer.compress(block) for _ in range(total >> 20)) + packer.flush()


def channel(number: int, topic: str, key: str = "") -> Channel:
    return Channel(number, topic, "json", {"key": key, "row": "topic"}, 0)


def claimed_bomb(hostile: Hostile) -> None:
    """A frame whose own header promises 10 GB, which a decompressor may allocate at once."""
    header = b"\x28\xb5\x2f\xfd" + bytes([0b1100_0000, 0]) + struct.pack("<Q", 10 * 10**9)
    hostile.packed_chunk(header + b"\x01\x00\x00", 10 * 10**9)


def repeated_channels(hostile: Hostile) -> None:
    block = records(*(channel(k, f"/{k}") for k in range(10_000)))
    for _ in range(10):
        hostile.chunk(block)
    hostile.chunk(records(channel(1, "/other")))


def huge_channels(hostile: Hostile) -> None:
    for block in range(5):
        hostile.chunk(records(*(channel(block * 9 + k, "/a" * 512_000) for k in range(9))))


EMPTY_MESSAGE = struct.pack("<BQ", 5, 22) + bytes(22)
FAR_FUTURE = struct.pack("<BQ", 5, 22) + struct.pack("<HIQQ", 0, 0, 2**63, 0)


ATTACKS: list[tuple[Callable[[Hostile], None], str]] = [
    (lambda to: to.packed_chunk(zeros_packed(1 << 30), 10 * 10**9), "unpacks to more than"),
    (claimed_bomb, "another size than it says"),
    (repeated_channels, "one number to two channels"),
    (
        lambda to: to.chunk(records(*(channel(k, f"/{k}", f"users/u{k}/imu") for k in range(25_000)))),
        "more than 20000 channels",
    ),
    (huge_channels, "bytes about them"),
    (lambda to: to.chunk(records(channel(1, "/a"), channel(1, "/b"))), "one number to two channels"),
    (lambda to: to.packed_chunk(b"abc", 3, "lz4"), "packed with 'lz4'"),
    (lambda to: to.chunk(struct.pack("<BQ", 5, 2**60) + b"abc"), "a record is cut off"),
    (lambda to: to.chunk(struct.pack("<BQ", 3, 6) + b"\x01\x00\xff\xff\xff\xff"), "is damaged"),
    (lambda to: to.chunk(struct.pack("<BQ", 9, 0) * 100_000), "a record of the kind 9"),
    (
        lambda to: to.chunk(records(channel(0, "/a")) + EMPTY_MESSAGE * 20_000),
        "too many records for its size",
    ),
    (
        lambda to: to.packed_chunk(EMPTY_MESSAGE * 60_000, 60_000 * len(EMPTY_MESSAGE), ""),
        "too many records for its size",
    ),
    (lambda to: to.chunk(records(channel(0, "/a")) + FAR_FUTURE), "is beyond 64 bits"),
]


@pytest.mark.parametrize(("attack", "sentence"), ATTACKS)
def test_hostile_file_costs_one_sentence_and_little_memory(
    attack: Callable[[Hostile], None], sentence: str, hostile: Hostile, path: Path
) -> None:
    attack(hostile)
    hostile.file.flush()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with Recording.open(path) as recording:
        assert list(recording.entries()) == []
        assert sentence in recording.problem
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # KiB


def message_of(hostile: Hostile, schema: str, content: bytes, key: str = "users/anna/imu") -> None:
    number = hostile.register_schema(schema, "jsonschema", b"{}")
    channel = hostile.register_channel("/x", "json", number, {"key": key, "row": "topic"})
    hostile.add_message(channel, START, content, START)
    hostile.flush()


@pytest.mark.parametrize(
    ("schema", "content", "complaint"),
    [
        ("ImuSample.v1", b"not json", "Invalid JSON"),
        ("ImuSample.v1", b'{"stamp_ns": "soon"}', "stamp_ns"),
        ("Nonsense.v1", b"{}", "is missing"),
        ("ImuSample.v1", b"[" * 10_000, "ImuSample"),
        ("ImuSample.v1", b" " * 10**6, "at most"),
    ],
)
def test_message_that_is_none_is_counted_with_the_first_complaint(
    schema: str, content: bytes, complaint: str, hostile: Hostile, path: Path
) -> None:
    message_of(hostile, schema, content)
    hostile.finish()
    hostile.file.flush()
    with Recording.open(path) as recording:
        assert list(recording.entries()) == []
        assert recording.invalid == 1
        assert complaint in recording.first_error


def test_newer_message_is_read_without_its_unknown_fields(hostile: Hostile, path: Path) -> None:
    message = example(ImuSample)
    newer = message.model_dump_json().encode()[:-1] + b', "temperature_c": 20.5}'
    message_of(hostile, "ImuSample.v9", newer)
    hostile.finish()
    hostile.file.flush()
    with Recording.open(path) as recording:
        assert [each.body for each in recording.entries()] == [message]


def test_channel_of_an_unknown_topic_is_counted_and_not_read(hostile: Hostile, path: Path) -> None:
    message_of(hostile, "Smell.v1", b"{}", key="users/anna/smell")
    hostile.finish()
    hostile.file.flush()
    with Recording.open(path) as recording:
        assert (recording.counts, recording.unknown) == ({}, {"/x": 1})
        assert list(recording.entries()) == []


def foreign(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        message_of(writer, "ImuSample.v1", b"{}")  # pyrefly: ignore[bad-argument-type]
        writer.finish()


def newer_format(path: Path) -> None:
    with path.open("wb") as file:
        head = make_head("lab", START).model_copy(update={"format": 2, "version": "9.0"})
        RecordingWriter(file, head).close()


NO_RECORDINGS: list[tuple[Callable[[Path], object], str]] = [
    (Path.exists, "cannot be read: No such file"),
    (Path.mkdir, "cannot be read: Is a directory"),
    (Path.touch, "is no recording"),
    (lambda path: path.write_bytes(b"#ROSBAG V2.0\n" * 99), "is no recording"),
    (lambda path: path.write_bytes(b"\x89MCAP0\r\n" + bytes(range(256))), "is no recording of PointIt"),
    (lambda path: path.write_bytes(b"\x89MCAP0\r\n"), "it ends in the middle"),
    (foreign, "is no recording of PointIt"),
    (newer_format, "written by a newer PointIt (9.0)"),
]


@pytest.mark.parametrize(("make", "sentence"), NO_RECORDINGS)
def test_file_that_is_no_recording_is_refused(
    make: Callable[[Path], object], sentence: str, path: Path
) -> None:
    make(path)
    with pytest.raises(RecordingError) as error:
        Recording.open(path)
    assert sentence in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
