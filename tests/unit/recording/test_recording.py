"""Recordings, and files that are none."""

import io
import resource
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Channel, Chunk
from mcap.writer import Writer
from zstandard import ZstdCompressor

import pointit.schemas as models
from pointit.recording import container, reader
from pointit.recording.entries import Entry, Exchange, RecordingError, body_kind, entry, entry_of
from pointit.recording.head import METADATA, make_head
from pointit.recording.reader import Recording
from pointit.recording.writer import RecordingWriter
from pointit.schemas import NS_PER_S, Cursor, ImuSample, Message, Query, encode, topics
from pointit.schemas.catalogue.catalogue import example
from tests.support.recorded import write_recording

START = 1_700_000_000 * NS_PER_S


def at(seconds: float) -> int:
    return START + round(seconds * NS_PER_S)


def cursor(seconds: float, user: str = "anna") -> Entry:
    return entry(
        at(seconds), topics.CURSOR, user, Cursor(stamp_ns=at(seconds), seq=round(seconds * 50), miss_rad=0.1)
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "session.mcap"


def write(path: Path, entries: list[Entry], **head: Any) -> None:
    write_recording(path, entries, START, **head)


def session(seconds: float = 10.0) -> list[Entry]:
    return [cursor(k / 50) for k in range(round(50 * seconds))]


@pytest.mark.parametrize("topic", [pytest.param(topic, id=topic.key) for topic in topics.TOPICS])
def test_every_message_is_read_as_it_was_written(topic: topics.Topic[Message], path: Path) -> None:
    message = example(topic.message)
    written = entry(at(1.0), topic, "anna" if topic.placeholder else "", message)
    write(path, [written])
    with Recording.open(path) as recording:
        (found,) = recording.entries()
        assert found == written
        assert isinstance(found.body, Message)
        assert encode(found.body) == encode(message)
        assert (recording.problem, recording.counts) == ("", {written.key: 1})


@pytest.mark.parametrize("request_row", [pytest.param(row, id=row.key) for row in topics.REQUESTS])
def test_every_request_is_read_with_reply_or_refusal(
    request_row: topics.Request[Any, Any], path: Path
) -> None:
    kind: Any = body_kind(request_row)
    query = example(request_row.query)
    name = "anna" if request_row.placeholder else ""
    answered = kind(stamp_ns=at(1.0), query=query, reply=example(request_row.reply))
    refused = kind(stamp_ns=at(2.0), query=query, refusal="not now")
    written = [entry(at(k), request_row, name, body) for k, body in enumerate((answered, refused))]
    write(path, written)
    with Recording.open(path) as recording:
        assert list(recording.entries()) == written
        assert recording.invalid == 0


def test_presence_head_times_and_counts_are_read_back(path: Path) -> None:
    there = [
        entry(at(0.0), topics.USER_ALIVE, "anna", True),
        entry(at(9.0), topics.USER_ALIVE, "anna", False),
    ]
    written = [there[0], *session(5.0), there[1]]
    write(path, written, seed=7, without=("imu",), pseudonyms=True)
    with Recording.open(path) as recording:
        assert list(recording.entries()) == written
        assert recording.head == make_head("lab", START, seed=7, without=("imu",), pseudonyms=True)
        assert (recording.began_ns, recording.ended_ns) == (at(0.0), at(9.0))
        assert recording.counts == {"alive/users/anna": 2, "users/anna/cursor": 250}


def test_entries_are_those_of_the_requested_keys_and_times(path: Path) -> None:
    write(path, [each for k in range(100) for each in (cursor(k / 10), cursor(k / 10, "ben"))])
    with Recording.open(path) as recording:
        found = list(recording.entries(lambda key: key == topics.CURSOR.at("ben"), at(2.0), at(3.0)))
        assert [(each.name, each.time_ns) for each in found] == [("ben", at(2.0 + k / 10)) for k in range(10)]
        assert len(list(recording.entries())) == 200


def test_time_never_falls_even_when_the_clock_was_set_back(path: Path) -> None:
    write(path, [cursor(5.0), cursor(1.0), cursor(6.0)])
    with Recording.open(path) as recording:
        assert [each.time_ns for each in recording.entries()] == [at(5.0), at(5.0), at(6.0)]


def test_other_readers_find_the_key_the_schema_and_the_stamp(path: Path) -> None:
    exchange = Exchange[models.SetSpeed, models.Done](
        stamp_ns=at(0.5), query=models.SetSpeed(speed_mps=0.2), reply=models.Done()
    )
    write(path, [cursor(1.0), entry(at(1.0), topics.SET_SPEED, "", exchange)])
    with path.open("rb") as file:
        messages = list(make_reader(file, validate_crcs=True).iter_messages())
    (schema, plain, message), (request_schema, request, _) = messages

    assert schema is not None
    assert request_schema is not None
    assert (schema.name, schema.encoding) == (Cursor.schema_name(), "jsonschema")
    assert (plain.message_encoding, plain.topic) == ("json", "/users/anna/cursor")
    assert plain.metadata == {"key": "users/anna/cursor", "row": "topic"}
    assert (message.publish_time, message.sequence) == (at(1.0), 50)
    assert request.topic == "/conveyor/set_speed"
    assert request_schema.name == f"{models.SetSpeed.schema_name()}+{models.Done.schema_name()}"


@pytest.mark.parametrize("share", [0.999, 0.7, 0.4])
def test_cut_file_is_read_but_for_the_last_half_second(path: Path, share: float) -> None:
    written = session()
    with path.open("wb") as file:
        writer = RecordingWriter(file, make_head("lab", START))
        sizes: list[int] = []
        for each in written:
            writer.add(each)
            file.flush()
            sizes.append(file.tell())
    whole = path.read_bytes()
    end = round(len(whole) * share)
    path.write_bytes(whole[:end])
    written_by_then = sum(size <= end for size in sizes)
    with Recording.open(path) as recording:
        found = list(recording.entries())
        assert found == written[: len(found)]
        assert len(found) >= written_by_then - 25 > 50
        assert "it ends in the middle" in recording.problem
        assert recording.problem.startswith(f"{path} is not whole")


def rewritten(path: Path, *, topic: str = "", **options: Any) -> None:
    """Write the recording at `path` again by the library `mcap`, with the `options` of its writer.

    `topic`: one channel more, which PointIt does not know, with a message.
    """
    with path.open("rb") as source:
        mcap_reader = make_reader(source)
        summary = mcap_reader.get_summary()
        assert summary is not None
        metadata = list(mcap_reader.iter_metadata())
        messages = list(mcap_reader.iter_messages())
    with path.open("wb") as target:
        writer = Writer(target, **options)
        writer.start(profile="", library="another")
        for record in metadata:
            writer.add_metadata(record.name, dict(record.metadata))
        schemas = {0: 0}
        for number, schema in summary.schemas.items():
            schemas[number] = writer.register_schema(schema.name, schema.encoding, schema.data)
        channels: dict[int, int] = {}
        for number, each in summary.channels.items():
            schema_id = schemas[each.schema_id]
            channels[number] = writer.register_channel(
                each.topic, each.message_encoding, schema_id, dict(each.metadata)
            )
        for _, each, message in messages:
            writer.add_message(channels[each.id], message.log_time, message.data, message.publish_time)
        if topic:
            unknown = writer.register_channel(topic, "json", 0)
            writer.add_message(unknown, at(1.0), b"{}", at(1.0))
        writer.finish()


def test_messages_outside_of_chunks_are_read(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(container, "UNCHUNKED_BYTES", 4096)
    written = session()
    write(path, written)
    rewritten(path, use_chunking=False)
    with Recording.open(path) as recording:
        assert list(recording.entries()) == written
        assert (recording.problem, recording.counts) == ("", {"users/anna/cursor": len(written)})
        some = list(recording.entries(since_ns=at(2.0), until_ns=at(3.0)))
    assert some == written[100:150]


def test_messages_outside_of_chunks_are_read_up_to_a_cut(path: Path) -> None:
    written = session()
    write(path, written)
    rewritten(path, use_chunking=False)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with Recording.open(path) as recording:
        found = list(recording.entries())
        assert found == written[: len(found)]
        assert len(found) > 150
        assert "it ends in the middle" in recording.problem


def test_recording_that_is_too_long_is_read_to_the_limit(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(path, session())
    monkeypatch.setattr(reader, "MAX_CHUNKS", 5)
    with Recording.open(path) as recording:
        assert "it has more than 5 chunks" in recording.problem
        assert list(recording.entries()) == session()[: sum(recording.counts.values())] != []


def test_damaged_chunk_is_left_out_and_reported(path: Path) -> None:
    write(path, session())
    damage(path, chunks(path)[4].offset + 200)
    with Recording.open(path) as recording:
        assert len(list(recording.entries())) == 500 - 25
        assert "a chunk of it" in recording.problem


def test_damage_anywhere_never_raises_anything_else(path: Path) -> None:
    """One byte after the other is changed; the file is read, or refused in a sentence."""
    write(path, [*session(1.0), entry(at(2.0), topics.BUTTON, "anna", example(topics.BUTTON.message))])
    whole = path.read_bytes()
    for place in range(0, len(whole), 101):
        data = bytearray(whole)
        data[place] ^= 0xA5
        path.write_bytes(data)
        try:
            with Recording.open(path) as recording:
                assert len(list(recording.entries())) <= 51
        except RecordingError:
            pass


def test_channels_of_a_damaged_chunk_are_read_from_the_end(path: Path) -> None:
    write(path, session())
    damage(path, chunks(path)[0].offset + 200)
    with Recording.open(path) as recording:
        assert len(list(recording.entries())) == 500 - 25
        assert recording.lost == 0
    path.write_bytes(path.read_bytes()[: chunks(path)[-1].offset])  # killed: the end is missing, too
    with Recording.open(path) as recording:
        assert list(recording.entries()) == []
        assert recording.lost == sum(recording.unknown.values()) > 400
        assert f"messages that have lost their description: {recording.lost}" in recording.problem


@pytest.mark.parametrize("place", [-9, -1, -8])
def test_reading_goes_on_behind_a_damaged_head_of_a_chunk(path: Path, place: int) -> None:
    write(path, session())
    third = chunks(path)[2]
    damage(path, third.offset + place)
    with Recording.open(path) as recording:
        assert len(list(recording.entries())) >= 500 - 50
        assert recording.ended_ns == session()[-1].time_ns
        assert "is not whole" in recording.problem


def test_reading_goes_on_behind_zeros(path: Path) -> None:
    write(path, session())
    data = bytearray(path.read_bytes())
    third = chunks(path)[2]
    data[third.offset - 9 : third.offset + third.length + 40] = bytes(third.length + 49)
    path.write_bytes(data)
    with Recording.open(path) as recording:
        assert len(list(recording.entries())) == 500 - 25
        assert "it is damaged between two chunks" in recording.problem


def chunks(path: Path) -> list[container.RecordLocation]:
    with path.open("rb") as file:
        return [place for place in container.records(file) if place.opcode == 6]


def damage(path: Path, offset: int) -> None:
    data = bytearray(path.read_bytes())
    data[offset] ^= 0xFF
    path.write_bytes(data)


SET_TO = models.SetPose(position_m=(1.0, 2.0, 0.0), yaw_rad=0.5)


def account(key: str, query: Query) -> models.ServedRequest:
    return models.ServedRequest(
        stamp_ns=7,
        service="led-driver",
        instance="led-driver",
        request=key,
        query=query.model_dump_json(),
        refusal="no",
    )


@pytest.mark.parametrize(
    ("instance", "key", "query"),
    [
        ("localizer.anna", topics.SET_POSE.at("anna"), SET_TO),
        ("selector", topics.UNDO_SELECTION.at("anna"), models.UndoSelection()),
        ("led-driver", topics.SET_BRIGHTNESS.key, models.SetBrightness(brightness=0.5)),
    ],
)
def test_account_of_the_service_that_answers_is_an_exchange(instance: str, key: str, query: Query) -> None:
    found = entry_of(account(key, query), instance, 9)
    assert found is not None
    assert (found.key, found.time_ns) == (key, 9)
    assert isinstance(found.body, Exchange)
    assert (found.body.query, found.body.refusal) == (query, "no")


@pytest.mark.parametrize(
    ("instance", "key", "query"),
    [
        ("pointing.anna", topics.SET_POSE.at("anna"), SET_TO),
        ("localizer.ben", topics.SET_POSE.at("anna"), SET_TO),
        ("plugin", topics.SET_BRIGHTNESS.key, models.SetBrightness(brightness=0.5)),
        ("led-driver", "nothing/of/ours", models.SetBrightness(brightness=0.5)),
        ("led-driver", topics.SET_BRIGHTNESS.key, models.UndoSelection()),
    ],
)
def test_account_of_another_services_answer_is_left_out(instance: str, key: str, query: Query) -> None:
    assert entry_of(account(key, query), instance, 9) is None


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
def test_invalid_message_is_counted_with_the_first_error(
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
    (Path.exists, "cannot be read: no such file"),
    (Path.mkdir, "cannot be read: is a directory"),
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
