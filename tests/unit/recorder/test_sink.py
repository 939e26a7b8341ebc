"""The thread that writes a recording: what is left out and why, faults, and further files."""

import threading
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio

from pointit.recording import writer
from pointit.recording.entries import Entry, make_head
from pointit.recording.reader import Recording
from pointit.recording.writer import RecordingWriter
from pointit.runtime.bus.contract import Sent
from pointit.schemas import NS_PER_S, Cursor, DecodeError, Message, UserProfile
from pointit.schemas.topics import CURSOR, PROFILE, USER_ALIVE
from pointit.services.recorder import sink as sink_module
from pointit.services.recorder.sink import ENDED, FAULTY, INVALID, TOO_SLOW, Arrival, Sink
from tests.support.bench import until

pytestmark = pytest.mark.wall_time

Patch = pytest.MonkeyPatch
Caplog = pytest.LogCaptureFixture

START = 1_700_000_000 * NS_PER_S


def at(seconds: float) -> int:
    return START + round(seconds * NS_PER_S)


def cursor(seconds: float) -> Arrival:
    message = Cursor(stamp_ns=at(seconds), seq=round(seconds * 10))
    return Arrival(at(seconds), CURSOR, "anna", message)


@pytest_asyncio.fixture
async def sink(tmp_path: Path) -> AsyncIterator[Sink]:
    sink = Sink(tmp_path / "session.mcap", make_head("lab", START))
    yield sink
    await sink.close()


def read(path: Path) -> list[Entry]:
    with Recording.open(path) as recording:
        assert recording.problem == ""
        return list(recording.entries())


def by_time(folder: Path) -> list[Path]:
    return sorted(folder.iterdir(), key=lambda path: read(path)[0].time_ns)


class Encoded:
    """A message of another process; it can be decoded when the test says so."""

    def __init__(self, *, is_valid: bool = True) -> None:
        self.size = 600
        self.sent: Sent | None = None
        self.asked, self.may_decode = threading.Event(), threading.Event()
        self._is_valid = is_valid

    def decode(self) -> Message:
        self.asked.set()
        self.may_decode.wait()
        if not self._is_valid:
            raise DecodeError("garbage")
        return Cursor(stamp_ns=1)


async def test_when_time_is_set_back_the_recording_goes_on_in_a_new_file(tmp_path: Path, sink: Sink) -> None:
    profile = UserProfile(stamp_ns=at(5.0), seq=1)
    sink.add(Arrival(at(5.0), PROFILE, "anna", profile))
    sink.add(Arrival(at(5.0), USER_ALIVE, "anna", True))
    sink.add(Arrival(at(5.0), USER_ALIVE, "ben", True))
    sink.add(Arrival(at(5.5), USER_ALIVE, "ben", False))
    sink.add(cursor(6.0))
    for seconds in (1.0, 2.0, 1.5):
        sink.add(cursor(seconds))
    await sink.close()
    assert sink.path == tmp_path / "session-2.mcap"
    assert [each.time_ns for each in read(tmp_path / "session.mcap")][-1] == at(6.0)
    found = [(each.time_ns, each.key) for each in read(sink.path)]
    assert found == [
        (at(1.0), PROFILE.at("anna")),
        (at(1.0), USER_ALIVE.at("anna")),
        (at(1.0), CURSOR.at("anna")),
        (at(2.0), CURSOR.at("anna")),
        (at(2.0), CURSOR.at("anna")),
    ]
    assert (sink.entries, sink.problem, sink.left_out) == (10, "", {})


async def test_long_recording_is_divided_into_files_that_together_have_everything(
    tmp_path: Path, sink: Sink, monkeypatch: Patch
) -> None:
    monkeypatch.setattr(writer, "MAX_CHUNKS", 4)
    arrivals = [cursor(number / 10) for number in range(200)]
    for each in arrivals:
        sink.add(each)
    await sink.close()
    files = by_time(tmp_path)
    assert len(files) >= 8
    assert [entry.body for path in files for entry in read(path)] == [each.body for each in arrivals]
    assert sink.size == sum(path.stat().st_size for path in files)


async def test_fault_in_one_message_costs_this_message_only(
    sink: Sink, monkeypatch: Patch, caplog: Caplog
) -> None:
    added = RecordingWriter.add

    def add(self: RecordingWriter, entry: Entry) -> None:
        if entry.time_ns == at(2.0):
            raise RuntimeError("a fault")
        added(self, entry)

    monkeypatch.setattr(RecordingWriter, "add", add)
    for seconds in (1.0, 2.0, 3.0):
        sink.add(cursor(seconds))
    await sink.close()
    assert [each.time_ns for each in read(sink.path)] == [at(1.0), at(3.0)]
    assert (sink.problem, sink.left_out) == ("", {FAULTY: 1})
    assert "a message cannot be recorded" in caplog.text


async def test_thread_that_fails_says_so_and_counts_what_waited(
    sink: Sink, monkeypatch: Patch, caplog: Caplog
) -> None:
    def flush(_self: RecordingWriter) -> None:
        raise RuntimeError("a fault")

    encoded = Encoded()
    sink.add(Arrival(at(1.0), CURSOR, "anna", encoded))
    await until(encoded.asked.is_set)
    monkeypatch.setattr(RecordingWriter, "flush", flush)
    encoded.may_decode.set()
    await until(lambda: bool(sink.problem))
    assert "a fault; nothing more is recorded" in sink.problem
    sink.add(cursor(2.0))
    assert sink.left_out == {ENDED: 1}
    assert "the recorder's thread has failed" in caplog.text


async def test_a_recording_that_ends_early_is_said_to_have_as_many_messages_as_a_reader_finds(
    sink: Sink, monkeypatch: Patch
) -> None:
    added = RecordingWriter.add

    def add(self: RecordingWriter, entry: Entry) -> None:
        if entry.time_ns == at(9.0):
            raise OSError(28, "No space left on device")
        added(self, entry)

    monkeypatch.setattr(RecordingWriter, "add", add)
    for seconds in range(10):  # a chunk each, within one batch
        sink.add(cursor(seconds))
    await until(lambda: bool(sink.problem))
    with Recording.open(sink.path) as recording:
        readable = sum(recording.counts.values())
    assert readable > 0
    assert f"the {readable} messages before are readable" in sink.problem


async def test_what_waits_is_limited_by_bytes(sink: Sink, monkeypatch: Patch) -> None:
    monkeypatch.setattr(sink_module, "MAX_WAITING_BYTES", 1000)
    first, second, third = Encoded(), Encoded(), Encoded()
    sink.add(Arrival(at(1.0), CURSOR, "anna", first))
    await until(first.asked.is_set)
    for each in (second, third):
        sink.add(Arrival(at(1.0), CURSOR, "anna", each))
    assert sink.left_out == {TOO_SLOW: 1}
    for each in (first, second):
        each.may_decode.set()
    await sink.close()
    assert len(read(sink.path)) == 2


async def test_messages_that_are_not_valid_are_counted_as_such(sink: Sink) -> None:
    encoded = Encoded(is_valid=False)
    encoded.may_decode.set()
    sink.add(Arrival(at(1.0), CURSOR, "anna", encoded))
    await sink.close()
    assert sink.left_out == {INVALID: 1}
