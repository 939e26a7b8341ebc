"""The recorder, and the file that it writes."""

import asyncio
import itertools
import os
import random
import threading
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import IO, Any, Self

import pytest
import pytest_asyncio

import pointit.schemas as models
from pointit.bridges.web.config import Place, WebConfig
from pointit.recording import container, writer
from pointit.recording.container import Chunk, Opcode
from pointit.recording.entries import Entry, body_kind
from pointit.recording.head import make_head
from pointit.recording.reader import Recording
from pointit.recording.writer import RecordingWriter
from pointit.runtime.bus.contract import Sent
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import WallClock
from pointit.runtime.config.config import published_parameters
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import NS_PER_S, Cursor, DecodeError, Message, UserProfile, topics
from pointit.schemas.catalogue.catalogue import example
from pointit.schemas.problems import ROUTER_LOST, Problem
from pointit.schemas.topics import CURSOR, PROFILE, USER_ALIVE
from pointit.services.recorder import sink as sink_module
from pointit.services.recorder.config import RecorderConfig
from pointit.services.recorder.service import Recorder
from pointit.services.recorder.sink import ENDED, FAULTY, INVALID, TOO_SLOW, Arrival, Sink
from tests.support.bench import background, until

pytestmark = pytest.mark.wall_time


Patch = pytest.MonkeyPatch
Caplog = pytest.LogCaptureFixture

LEVEL = (0.0, 0.0, 0.0, 1.0)


class Site:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.exchange = LocalBroker()
        self.bus = MemoryBus(self.exchange)
        self.health: list[models.Health] = []
        self.bus.subscribe(topics.HEALTH, lambda message, _name: self.health.append(message), "recorder")

    @asynccontextmanager
    async def recorded(self, **parameters: Any) -> AsyncGenerator[None]:
        own = MemoryBus(self.exchange)
        config = RecorderConfig(file=str(self.path), **parameters)
        async with background(run_service(Launch(service=Recorder, config=config), own, WallClock())):
            await until(lambda: "recorder" in self.exchange.present.get(topics.SERVICE_ALIVE.key, {}))
            yield
        await own.close()

    def read(self, keys: Callable[[str], bool] | None = None) -> list[Entry]:
        with Recording.open(self.path) as recording:
            found = list(recording.entries(keys))
            assert (recording.problem, recording.invalid, recording.unknown) == ("", 0, {})
            return found

    def bodies(self, key: str) -> list[Any]:
        return [each.body for each in self.read(lambda other: other == key)]


@pytest.fixture
async def site(tmp_path: Path) -> AsyncIterator[Site]:
    site = Site(tmp_path / "session.mcap")
    yield site
    await site.bus.close()


def sample(number: int) -> models.ImuSample:
    return models.ImuSample(stamp_ns=1000 + number, seq=number, orientation_xyzw=LEVEL)


async def test_every_message_is_recorded_also_late_ones(site: Site) -> None:
    messages = [sample(number) for number in (*range(200), 150)]  # the last is out of order
    async with site.recorded():
        publisher = site.bus.publisher(topics.IMU, "anna")
        for message in messages:
            publisher.put(message)
        await asyncio.sleep(0)
    assert site.bodies(topics.IMU.at("anna")) == messages


async def test_states_from_before_are_at_the_beginning(site: Site) -> None:
    profile = models.UserProfile(stamp_ns=1, seq=1)
    site.bus.publisher(topics.PROFILE, "anna").put(profile)
    async with site.recorded():
        await asyncio.sleep(0)
    assert site.bodies(topics.PROFILE.at("anna")) == [profile]
    assert [body.service for body in site.bodies(topics.CONFIGURATION.at("recorder"))] == ["recorder"]


async def test_requests_are_recorded_with_reply_or_refusal(site: Site) -> None:
    async def serve(query: models.SetBrightness, _name: str) -> Any:
        if query.brightness < 0.5:
            raise RefusedError("too dark")
        return topics.SET_BRIGHTNESS.reply(message="dimmed")

    server = ServiceBus(site.bus, WallClock(), "led-driver", "led-driver")
    async with site.recorded():
        server.serve(topics.SET_BRIGHTNESS, serve)
        await site.bus.call(topics.SET_BRIGHTNESS, models.SetBrightness(brightness=0.75))
        with pytest.raises(RefusedError):
            await site.bus.call(topics.SET_BRIGHTNESS, models.SetBrightness(brightness=0.25))
        await asyncio.sleep(0)
    done, refused = site.bodies("leds/brightness")
    kind: Any = body_kind(topics.SET_BRIGHTNESS)
    reply = topics.SET_BRIGHTNESS.reply(message="dimmed")
    assert done == kind(stamp_ns=done.stamp_ns, query=models.SetBrightness(brightness=0.75), reply=reply)
    assert refused == kind(
        stamp_ns=refused.stamp_ns, query=models.SetBrightness(brightness=0.25), refusal="too dark"
    )


async def test_topics_are_left_out_on_request(site: Site) -> None:
    async with site.recorded(without=("imu",)):
        site.bus.publisher(topics.IMU, "anna").put(sample(1))
        site.bus.publisher(topics.BUTTON, "anna").put(example(topics.BUTTON.message))
        await asyncio.sleep(0)
    keys = {each.key for each in site.read()}
    assert "users/anna/button" in keys
    assert "users/anna/imu" not in keys
    with Recording.open(site.path) as recording:
        assert recording.head.without == ("imu",)


async def test_pseudonyms_stand_for_people_everywhere(site: Site) -> None:
    async with site.recorded(pseudonyms=True):
        for user in ("anna", "anna-lena", "user"):
            site.bus.announce(topics.USER_ALIVE, user)
        await asyncio.sleep(0)
        feedback = models.Feedback(
            stamp_ns=1, cue="selected", chime="tick", text="anna: give it to anna-lena, user"
        )
        site.bus.publisher(topics.FEEDBACK, "anna").put(feedback)
        report = models.Health(stamp_ns=1, service="pointing", instance="pointing.anna", user="anna", pid=1)
        site.bus.publisher(topics.HEALTH, "pointing.anna").put(report)
        await asyncio.sleep(0)
    numbers = {each.name for each in site.read() if each.row is topics.USER_ALIVE}
    assert numbers == {"person-1", "person-2", "person-3"}

    (said,) = (each for each in site.read() if each.row is topics.FEEDBACK)
    assert (said.name, said.body) == (
        "person-1",
        feedback.model_copy(update={"text": "person-1: give it to person-2, person-3"}),
    )
    assert site.bodies("health/pointing.person-1") == [
        report.model_copy(update={"instance": "pointing.person-1", "user": "person-1"})
    ]
    assert b"anna" not in b"".join(str(each).encode() for each in site.read())


async def test_names_are_nowhere_in_the_file_even_when_learnt_late(site: Site) -> None:
    command = ("pointit", "service", "run", "pointing", "--user", "anna")
    expected = models.ExpectedService(service="pointing", user="anna", command=command)
    web = WebConfig(places={"Chris": Place(position_m=(1.0, 0.0, 0.0))})
    parameters = published_parameters(web)
    async with site.recorded(pseudonyms=True):
        told = models.Health(
            stamp_ns=1, service="web", instance="web", pid=1, host="Anna-laptop", warnings=("ben_2",)
        )
        site.bus.publisher(topics.HEALTH, "web").put(told)
        run = models.Deployment(stamp_ns=1, name="scenario_1", services=(expected,))
        site.bus.publisher(topics.DEPLOYMENT, "run.1").put(run)
        configuration = models.Configuration(stamp_ns=1, service="web", instance="web", parameters=parameters)
        site.bus.publisher(topics.CONFIGURATION, "web").put(configuration)
        site.bus.publisher(topics.DEPLOYMENT, "ben").put(models.Deployment(stamp_ns=1, name="ben"))
        await asyncio.sleep(0)

    content = unpacked(site.path).lower()
    assert b"person-1-laptop" in content
    for name in (b"anna", b"ben", b"chris"):
        assert name not in content

    (replaced,) = site.bodies(topics.CONFIGURATION.at("web"))
    (place,) = WebConfig.model_validate_json(replaced.parameters).places.items()
    assert place[0].startswith("person-")
    assert place[1] == web.places["Chris"]


async def test_names_equal_to_numbers_or_message_words_lose_no_message(site: Site) -> None:
    names = ("1", "0", "red", "selected", "true", "stamp_ns")
    feedback = models.Feedback(stamp_ns=1, cue="selected", chime="tick", text="1 has 0.1 m, led_1")
    async with site.recorded(pseudonyms=True):
        for user in names:
            site.bus.announce(topics.USER_ALIVE, user)
        publisher = site.bus.publisher(topics.CURSOR, "1")
        for number in range(100):
            publisher.put(models.Cursor(stamp_ns=number, seq=number, miss_rad=0.1))
        site.bus.publisher(topics.FEEDBACK, "1").put(feedback)
        site.bus.publisher(topics.LAMP_COLOR, "led_1").put(example(topics.LAMP_COLOR.message))
        await asyncio.sleep(0)
    cursors = [each.body for each in site.read() if each.row is topics.CURSOR]

    assert cursors == [models.Cursor(stamp_ns=number, seq=number, miss_rad=0.1) for number in range(100)]
    (said,) = (each for each in site.read() if each.row is topics.FEEDBACK)
    one = said.name
    assert said.body == feedback.model_copy(update={"text": f"{one} has 0.1 m, led_1"})
    assert site.bodies(topics.LAMP_COLOR.at("led_1")) == [example(topics.LAMP_COLOR.message)]


def unpacked(path: Path) -> bytes:
    found = b""
    with path.open("rb") as file:
        for place in container.records(file):
            if place.opcode == Opcode.CHUNK:
                found += container.unpack(container.read(file, place, Chunk))
    return found


async def test_lost_router_is_logged_once(site: Site, monkeypatch: Patch, caplog: Caplog) -> None:
    seconds = itertools.count()

    def problems(_bus: MemoryBus) -> tuple[Problem, ...]:
        sentence = f"router at tcp/127.0.0.1:7447 lost {next(seconds)} s ago; trying again"
        return (Problem(code=ROUTER_LOST, sentence=sentence, subject="tcp/127.0.0.1:7447"),)

    monkeypatch.setattr(MemoryBus, "problems", property(problems))
    monkeypatch.setattr("pointit.services.recorder.service.REPORT_S", 0.001)
    async with site.recorded():
        await until(lambda: next(seconds) > 50)
    assert caplog.text.count("not everything is recorded: router at tcp/127.0.0.1:7447 lost") == 1


async def test_file_that_exists_is_never_overwritten(site: Site) -> None:
    site.path.write_bytes(b"precious")
    async with site.recorded():
        await asyncio.sleep(0)
    assert site.path.read_bytes() == b"precious"
    site.path = site.path.with_name("session-2.mcap")
    assert site.read()


class FullDisk:
    def __init__(self, file: IO[bytes], room: int) -> None:
        self._file = file
        self._room = room

    def write(self, data: bytes) -> int:
        self._room -= len(data)
        if self._room < 0:
            raise OSError(28, os.strerror(28))
        return self._file.write(data)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


async def test_full_disk_is_reported_and_earlier_messages_are_readable(
    site: Site, monkeypatch: Patch, caplog: Caplog
) -> None:
    opened = Path.open

    def full(path: Path, mode: str = "r", **options: Any) -> Any:
        file = opened(path, mode, **options)
        return FullDisk(file, 100_000) if mode == "xb" else file

    monkeypatch.setattr(Path, "open", full)
    async with site.recorded():
        publisher = site.bus.publisher(topics.STRIPS_FRAME)
        noise = random.Random(1)
        number = 0

        def is_told() -> bool:
            nonlocal number
            if number < len(site.health):
                number += 1
                strip = models.StripFrame(id="s", rgb=noise.randbytes(3000))
                publisher.put(models.StripsFrame(stamp_ns=number, seq=number, strips=(strip,)))
            return any("no space left" in each for report in site.health for each in report.warnings)

        await until(is_told)
    assert "no space left on device; nothing more is recorded" in caplog.text
    with Recording.open(site.path) as recording:
        frames = [each.body for each in recording.entries() if each.row is topics.STRIPS_FRAME]
        assert [frame.seq for frame in frames if isinstance(frame, models.StripsFrame)] == [
            *range(1, len(frames) + 1)
        ]
        assert frames
        assert "it ends in the middle" in recording.problem
        readable = sum(recording.counts.values())
    assert f"the {readable} messages before are readable" in caplog.text


async def test_health_has_the_number_and_cause_of_missing_messages(site: Site, monkeypatch: Patch) -> None:
    added = RecordingWriter.add

    def add(self: RecordingWriter, entry: Entry) -> None:
        if entry.row is topics.BUTTON:
            raise RuntimeError("a fault")
        added(self, entry)

    monkeypatch.setattr(RecordingWriter, "add", add)
    sentence = "2 messages are not in the recording: a fault of PointIt, see the log"
    async with site.recorded():
        for _ in range(2):
            site.bus.publisher(topics.BUTTON, "anna").put(example(topics.BUTTON.message))
        await until(lambda: any(sentence in report.warnings for report in site.health))


async def test_movements_of_others_are_left_out_of_a_persons_recording(site: Site) -> None:
    async with site.recorded(person="anna"):
        for user in ("anna", "ben"):
            site.bus.publisher(topics.IMU, user).put(sample(1))
            site.bus.publisher(topics.BUTTON, user).put(example(topics.BUTTON.message))
        await asyncio.sleep(0)
    keys = {each.key for each in site.read()}
    assert {"users/anna/imu", "users/anna/button", "users/ben/button"} <= keys
    assert "users/ben/imu" not in keys


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


async def test_recording_continues_in_a_new_file_after_a_clock_step(tmp_path: Path, sink: Sink) -> None:
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


async def test_long_recording_is_divided_into_complete_files(
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


async def test_failing_thread_is_reported_and_waiting_messages_are_counted(
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


async def test_waiting_messages_are_limited_by_bytes(sink: Sink, monkeypatch: Patch) -> None:
    monkeypatch.setattr(sink_module, "MAX_WAITING_BYTES", 1000)
    first = Encoded()
    second = Encoded()
    third = Encoded()
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
