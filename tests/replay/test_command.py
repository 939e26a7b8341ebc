"""`pointit replay` on whole recordings, its result and its comparison."""

import asyncio
import contextlib
import errno
import functools
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result

from pointit.cli.recordings.replay import command
from pointit.recording.entries import Entry
from pointit.recording.reader import Recording
from pointit.recording.writer import RecordingWriter
from pointit.replay.playing import Collector
from pointit.replay.replayed_services import ReplayError
from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import RefusedError
from pointit.runtime.virtual_time import START_NS, VirtualClock
from pointit.schemas import NS_PER_S, Configuration, Selection, SetPose, SetTolerance, UndoSelection
from pointit.schemas.topics import (
    CURSOR,
    IMU,
    MAP,
    POSE,
    RAY,
    SELECTION,
    SET_POSE,
    SET_TOLERANCE,
    STRIPS_FRAME,
    UNDO_SELECTION,
    Delivery,
    Presence,
    Topic,
)
from pointit.services.led_driver.service import LedDriver
from tests.golden.sessions import Session, choices, play
from tests.replay.sessions import RECORDINGS
from tests.support.recorded import write_recording

CUT_NS = START_NS + 7 * NS_PER_S


@functools.cache
def whole_session() -> list[Entry]:
    """Return all messages of a person who selects, from the beginning."""
    entries: list[Entry] = []
    session = Session(scenario="scenario_3", duration_s=14.0, choices=choices(method="hold"), happens=())

    def listen(onlooker: Bus) -> None:
        Collector(onlooker, VirtualClock(), entries.append)

    play(session, listen)
    return [entry for entry in entries if entry.time_ns < START_NS + 13.9 * NS_PER_S]


def session_with_requests() -> list[Entry]:
    """Return all messages of a person, while a command asks the selector, pui and the localizer."""
    entries: list[Entry] = []
    asking: list[asyncio.Task[None]] = []

    async def ask(bus: Bus) -> None:
        await asyncio.sleep(3.0)
        await bus.call(SET_TOLERANCE, SetTolerance(tolerance_rad=0.05))
        with contextlib.suppress(RefusedError):
            await bus.call(UNDO_SELECTION, UndoSelection(), "anna")
        await bus.call(SET_POSE, SetPose(position_m=(2.0, 0.4, 0.0), yaw_rad=0.1), "anna")

    def listen(onlooker: Bus) -> None:
        Collector(onlooker, VirtualClock(), entries.append)
        asking.append(asyncio.get_running_loop().create_task(ask(onlooker)))

    play(Session(scenario="scenario_3", duration_s=6.0, happens=()), listen)
    assert asking[0].done()
    return [entry for entry in entries if entry.time_ns < START_NS + 5.9 * NS_PER_S]


def write(path: Path, entries: list[Entry], **head: Any) -> Path:
    return write_recording(path, entries, entries[0].time_ns, **head)


def since(entries: list[Entry], cut_ns: int) -> list[Entry]:
    """Return the entries of a recorder that began at `cut_ns`: states and presences that are there first."""
    there: dict[str, Entry] = {}
    for entry in entries:
        is_kept = isinstance(entry.row, Presence) or (
            isinstance(entry.row, Topic) and entry.row.delivery is Delivery.STATE
        )
        if entry.time_ns < cut_ns and is_kept:
            there[entry.key] = entry._replace(time_ns=cut_ns)
    return [*there.values(), *(entry for entry in entries if entry.time_ns >= cut_ns)]


def invoke(*arguments: str | Path) -> Result:
    return CliRunner().invoke(command, [str(each) for each in arguments], standalone_mode=False)


@pytest.mark.parametrize("level", ["edge", "rays", "cursors"])
def test_the_services_that_were_recorded_do_the_same_again(level: str, tmp_path: Path) -> None:
    file = write(tmp_path / "session.mcap", whole_session())
    result = invoke(file, "--from", level, "--compare", "--json")
    found = json.loads(result.stdout)
    assert found["is_same"], result.output
    assert result.return_value == 0
    keys = {topic["key"]: topic["replayed"] for topic in found["topics"]}
    assert keys[STRIPS_FRAME.key] > 100
    assert (RAY.at("anna") in keys) == (level == "edge")
    assert (CURSOR.at("anna") in keys) == (level != "cursors")


def test_external_requests_are_repeated_once_and_replies_compared(tmp_path: Path) -> None:
    entries = session_with_requests()
    result = invoke(write(tmp_path / "session.mcap", entries), "--compare", "--json")
    topics = {topic["key"]: topic for topic in json.loads(result.stdout)["topics"]}
    asked = [SET_TOLERANCE.key, UNDO_SELECTION.at("anna"), SET_POSE.at("anna")]
    assert [topics[key]["recorded"] for key in asked] == [1, 1, 1]
    assert [topics[key]["replayed"] for key in asked] == [1, 1, 1]
    assert [topics[key]["differ"] for key in asked] == [0, 0, 0], "replies are the same"
    pose = topics[POSE.at("anna")]
    assert (pose["recorded"], pose["replayed"], pose["differ"]) == (2, 2, 0)


def test_changed_sample_shows_in_table_and_first_divergence(tmp_path: Path) -> None:
    entries = whole_session()
    samples = [number for number, entry in enumerate(entries) if entry.row is IMU]
    lost = samples[300]
    result = invoke(write(tmp_path / "session.mcap", entries[:lost] + entries[lost + 1 :]), "--compare")
    assert result.return_value == 1
    assert "the first that differs is on " in result.output
    row = next(line for line in result.output.splitlines() if line.split()[:1] == [RAY.at("anna")])
    assert "6.000 s" in row


def test_recording_that_begins_in_mid_session_continues_as_recorded(tmp_path: Path) -> None:
    entries = whole_session()
    before = [entry.body for entry in entries if entry.row is SELECTION and entry.time_ns < CUT_NS][-1]
    assert isinstance(before, Selection)
    assert before.objects, "something is selected where the recording begins"
    output = tmp_path / "replayed.mcap"
    result = invoke(write(tmp_path / "late.mcap", since(entries, CUT_NS)), "--to", output)
    assert result.return_value == 0, result.output
    with Recording.open(output) as recording:
        replayed = [entry.body for entry in recording.entries() if entry.row is SELECTION]
    recorded = [entry.body for entry in entries if entry.row is SELECTION]
    assert len(recorded) > 3
    assert [each.objects for each in replayed[-2:]] == [each.objects for each in recorded[-2:]]  # pyrefly: ignore[missing-attribute]


def test_two_processes_write_the_same_bytes(tmp_path: Path) -> None:
    outputs = [tmp_path / f"{seed}.mcap" for seed in (1, 2)]
    for seed, output in enumerate(outputs, 1):
        subprocess.run(
            [sys.executable, "-m", "pointit", "replay", RECORDINGS / "lamps.mcap", "--to", output],
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
            check=True,
            capture_output=True,
        )
    assert outputs[0].read_bytes() == outputs[1].read_bytes()
    with Recording.open(outputs[0]) as recording, Recording.open(RECORDINGS / "lamps.mcap") as source:
        assert recording.head == source.head
        assert recording.counts[IMU.at("anna")] == source.counts[IMU.at("anna")]
        assert recording.counts[STRIPS_FRAME.key] > 0 or recording.counts[CURSOR.at("anna")] > 0


def test_nothing_is_overwritten_or_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    existing = tmp_path / "notes.mcap"
    existing.write_text("mine")
    result = invoke(RECORDINGS / "lamps.mcap", "--to", existing)
    assert "exists already; give another file, or --overwrite" in str(result.exception)
    assert existing.read_text() == "mine"
    assert invoke(RECORDINGS / "lamps.mcap").return_value == 0
    assert not list(scratch.iterdir())


def test_a_recording_without_services_is_refused_in_one_sentence(tmp_path: Path) -> None:
    samples = [entry for entry in whole_session() if entry.row is IMU]
    result = invoke(write(tmp_path / "samples.mcap", samples))
    assert "has no configuration of any service that --from edge replays" in str(result.exception)


def test_a_result_with_missing_messages_is_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Collector, "dropped", 7)
    result = invoke(RECORDINGS / "lamps.mcap")
    assert "7 messages of the result are missing" in str(result.exception)


def test_a_recording_whose_time_jumps_is_refused_in_one_sentence(tmp_path: Path) -> None:
    entries = whole_session()
    jumped = [
        entry._replace(time_ns=entry.time_ns + (0 if entry.time_ns < CUT_NS else 86_400 * NS_PER_S))
        for entry in entries
    ]
    result = invoke(write(tmp_path / "jumped.mcap", jumped))
    assert isinstance(result.exception, ReplayError)
    assert re.search(r"has nothing for 86400 s from 7.0 s after its beginning", str(result.exception))


def test_a_recording_without_a_map_opens_no_file_elsewhere(tmp_path: Path) -> None:
    entries = [
        entry._replace(body=entry.body.model_copy(update={"parameters": '{"map": "/etc/hostname"}'}))
        if isinstance(entry.body, Configuration) and entry.name == "pui"
        else entry
        for entry in whole_session()
        if entry.row is not MAP
    ]
    result = invoke(write(tmp_path / "no_map.mcap", entries))
    assert isinstance(result.exception, ReplayError)
    assert "refers to the map '/etc/hostname'" in str(result.exception)


def test_recorded_leds_are_listed_and_driven_on_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven: list[bool] = []

    async def play_live(*_: object, lights: bool) -> None:
        driven.append(lights)

    @contextlib.asynccontextmanager
    async def join_site(*_: object) -> AsyncGenerator[None]:
        yield

    monkeypatch.setattr("pointit.cli.recordings.replay.play_live", play_live)
    monkeypatch.setattr("pointit.cli.recordings.replay.join_site", join_site)
    entries = [
        entry._replace(
            body=entry.body.model_copy(
                update={"parameters": '{"outputs": [{"protocol": "expander", "port": "/dev/ttyS7"}]}'}
            )
        )
        if isinstance(entry.body, Configuration) and entry.name == "led-driver"
        else entry
        for entry in whole_session()
    ]
    file = write(tmp_path / "lit.mcap", entries)
    result = invoke(file, "--live")

    assert "/dev/ttyS7" in result.stderr
    assert "is left out" in result.stderr
    assert "is driven" in invoke(file, "--live", "--output", "recorded").stderr
    assert driven == [False, True]
    assert "give --live, too" in str(invoke(file, "--output", "recorded").exception)


def test_a_result_that_cannot_be_written_ends_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_self: RecordingWriter, _entry: Entry) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(RecordingWriter, "add", full)
    result = invoke(RECORDINGS / "lamps.mcap", "--to", tmp_path / "out.mcap")
    assert "out.mcap: cannot be written (no space left on device)" in str(result.exception)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("speed", [(), ("--speed", "1")])
def test_interrupted_replay_ends_its_services_without_leftovers(
    number: signal.Signals, speed: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    before = signal.getsignal(number)
    written: list[Entry] = []
    ended: list[bool] = []
    run_led_driver = LedDriver.run

    def interrupted(_self: RecordingWriter, entry: Entry) -> None:
        written.append(entry)
        if len(written) == 20:
            signal.raise_signal(number)

    async def run(driver: LedDriver) -> None:
        try:
            await run_led_driver(driver)
        finally:  # switches the lamps off
            ended.append(True)

    monkeypatch.setattr(RecordingWriter, "add", interrupted)
    monkeypatch.setattr(LedDriver, "run", run)
    result = invoke(RECORDINGS / "lamps.mcap", "--to", tmp_path / "out.mcap", *speed)
    assert isinstance(result.exception, click.exceptions.Abort)
    assert list(tmp_path.rglob("*")) == [scratch]
    assert ended == [True]
    assert signal.getsignal(number) == before


def test_recording_without_samples_is_refused_with_the_missing_topics(tmp_path: Path) -> None:
    entries = [entry for entry in whole_session() if entry.row is not IMU]
    path = write(tmp_path / "noimu.mcap", entries, without=("imu",))
    said = "recorded without imu: what services compute from it is missing"
    assert f"{said}; --from cursors needs no imu" in invoke(path).stderr
    result = invoke(path, "--from", "cursors", "--compare")
    assert said in result.stderr
    assert result.return_value == 0


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (
            {"parameters": '{"method": "telepathy"}'},
            "selector cannot be replayed with this version: .*telepathy",
        ),
        ({"parameters": "{"}, "selector cannot be replayed with this version"),
        ({"service": "web"}, "configuration/selector names another service"),
    ],
)
def test_a_bad_configuration_is_one_sentence(change: dict[str, str], complaint: str, tmp_path: Path) -> None:
    entries = [
        entry._replace(body=entry.body.model_copy(update=change))
        if isinstance(entry.body, Configuration) and entry.name == "selector"
        else entry
        for entry in whole_session()
    ]
    result = invoke(write(tmp_path / "changed.mcap", entries))
    assert isinstance(result.exception, ReplayError)
    assert re.search(complaint, str(result.exception))


def test_in_real_time_the_services_run_too() -> None:
    result = invoke(RECORDINGS / "lamps.mcap", "--speed", "50", "--json")
    assert result.return_value == 0, result.output
    assert json.loads(result.stdout)["replayed"][MAP.key] == 1
