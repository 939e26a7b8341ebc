"""Child processes: commands anybody can type, last words, an end in order."""

import asyncio
import json
import logging
import os
import shlex
import signal
import sys
import tempfile
from pathlib import Path
from typing import Literal

import psutil
import pytest
from pydantic import BaseModel

from pointit.cli.summary import check_writable
from pointit.launch.run import processes as module
from pointit.launch.run.processes import (
    MAX_LOG_BYTES,
    Processes,
    end_sentence,
    last_log_error,
    read_warnings,
)
from pointit.runtime.config.environment_variables import LOG_FORMAT
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch
from pointit.services.pointing.service import Pointing
from pointit.services.selector.service import Selector
from tests.support.bench import until
from tests.support.buses import free_port

pytestmark = pytest.mark.wall_time

PATIENCE_S = 20.0


@pytest.fixture(autouse=True)
def folders_of_the_test(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def launches() -> list[Launch]:
    return [
        Launch(service=Selector, config=Selector.CONFIG()),
        Launch(service=Pointing, config=Pointing.CONFIG(), user="anna"),
    ]


def processes(clock: Literal["site", "wall"] = "site", *, is_supervised: bool = False) -> Processes:
    endpoint = f"tcp/127.0.0.1:{free_port()}"  # nobody is there: the children wait
    return Processes(launches(), site="lab", connect=endpoint, clock=clock, is_supervised=is_supervised)


def supervised() -> Processes:
    return processes(is_supervised=True)


def children(group: Processes) -> dict[str, asyncio.subprocess.Process]:
    return group._children


def test_a_command_names_everything_the_service_needs() -> None:
    group = processes()
    command = group.command(group._launches[1])
    assert command[:4] == (sys.executable, "-m", "pointit.services", "pointing")
    options = dict(zip(command[4::2], command[5::2], strict=True))
    assert options.pop("--connect").startswith("tcp/127.0.0.1:")
    assert options == {
        "--config": str(group.folder / "pointing.anna.yaml"),
        "--user": "anna",
        "--site": "lab",
        "--clock": "site",
    }
    site_command = processes("wall").command(group._launches[0])
    assert "--user" not in site_command
    assert site_command[-1] == "wall"


async def test_processes_live_and_end_with_the_block() -> None:
    group = processes()
    async with group:
        assert set(children(group)) == {"selector", "pointing.anna"}
        assert all(child.returncode is None for child in children(group).values())
        assert all(os.getpgid(child.pid) == child.pid for child in children(group).values())
        written = read_yaml(group.folder / "selector.yaml")
        assert written == Selector.CONFIG().model_dump(mode="json")
    assert all(child.returncode is not None for child in children(group).values())
    assert not group.folder.exists()


async def test_a_child_that_dies_is_reported_with_its_command(caplog: pytest.LogCaptureFixture) -> None:
    group = processes()
    async with group:
        children(group)["selector"].send_signal(signal.SIGKILL)
        await until(lambda: bool(caplog.records), PATIENCE_S, "a report")
        (record,) = caplog.records
        assert record.levelno == logging.ERROR
        sentence = record.getMessage()
        command = shlex.join(group.command(group._launches[0]))
        assert sentence.startswith(f"selector was ended by SIGKILL; start it again with: {command} ")
        assert str(group.folder / "selector.log") in sentence
        assert children(group)["pointing.anna"].returncode is None
    assert group.folder.exists()  # its log may be of interest


async def test_a_child_that_fails_says_why(caplog: pytest.LogCaptureFixture) -> None:
    group = processes()
    path = group.folder / "selector.yaml"

    def spoil(*_: object) -> str:
        return "window_s: soon\n"

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BaseModel, "model_dump_json", spoil)
        await group.__aenter__()
    try:
        await until(lambda: len(caplog.records) == 2, PATIENCE_S, "both reports")
        sentences = sorted(record.getMessage() for record in caplog.records)
        assert f"selector ended with exit code 2: {path}: window_s: " in sentences[1]
        assert "'soon'" in sentences[1]
    finally:
        await group.__aexit__(None, None, None)


async def test_supervised_child_is_started_again(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pointit.runtime.service.plugin_guard.FIRST_WAIT_S", 0.01)
    group = supervised()
    async with group:
        first = children(group)["selector"]
        first.send_signal(signal.SIGKILL)
        await until(lambda: children(group)["selector"] is not first, PATIENCE_S, "another child")
        second = children(group)["selector"]
        assert second.returncode is None
        path = group.folder / "selector.log"
        assert caplog.messages == [
            f"selector was ended by SIGKILL; it will be restarted in 0.01 s (its log: {path})"
        ]
    assert second.returncode is not None
    assert group.folder.exists()  # its log may be of interest


async def test_supervised_child_is_not_restarted_when_its_parameters_are_refused(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pointit.runtime.service.plugin_guard.FIRST_WAIT_S", 0.01)
    group = supervised()

    def spoil(*_: object) -> str:
        return "window_s: soon\n"

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BaseModel, "model_dump_json", spoil)
        await group.__aenter__()
    try:
        await until(lambda: all(watch.done() for watch in group._watches), PATIENCE_S, "an end")
        assert all("ended with exit code 2" in message for message in caplog.messages)
        assert len(caplog.messages) == 2
    finally:
        await group.__aexit__(None, None, None)


async def test_end_before_a_restart_leaves_no_child(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pointit.runtime.service.plugin_guard.FIRST_WAIT_S", 0.01)
    group = supervised()
    async with group:
        start = group._start_child
        starting = asyncio.Event()
        started: list[asyncio.subprocess.Process] = []

        async def start_slowly(launch: Launch) -> asyncio.subprocess.Process:
            starting.set()
            await asyncio.sleep(0.1)
            started.append(await start(launch))
            return started[-1]

        monkeypatch.setattr(group, "_start_child", start_slowly)
        children(group)["selector"].send_signal(signal.SIGKILL)
        await starting.wait()
    assert all(child.returncode is not None for child in (*started, *children(group).values()))


async def test_warnings_of_a_supervised_child_are_logged(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LOG_PERIOD_S", 0.01)
    group = supervised()
    async with group:
        with (group.folder / "selector.log").open("a") as log:
            log.write('{"level": "info", "message": "begins"}\n{"level": "error", "message": "no port"}\n')
        await until(lambda: "selector: no port" in caplog.messages, PATIENCE_S, "the error")
    assert "selector: begins" not in caplog.messages


async def test_supervised_child_logs_fields_whatever_the_format_of_its_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(LOG_FORMAT, "plain")
    group = supervised()
    log = group.folder / "selector.log"
    async with group:
        await until(lambda: log.exists() and b"\n" in log.read_bytes(), PATIENCE_S, "the first line")
        first = json.loads(log.read_text().splitlines()[0])
        assert {"level", "message"} <= first.keys()


def test_end_of_a_child_has_the_message_of_its_last_entry(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text('{"level": "info", "message": "begins"}\n{"level": "critical", "message": "no disk."}\n')
    assert end_sentence(3, path) == "ended with exit code 3: no disk"


def test_warnings_are_read_once_and_in_whole_lines(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text('{"level": "warning", "message": "first"}\n[1]\nTraceback\n{"level": "error", "mess')

    warnings, position = read_warnings(path, 0)
    assert list(warnings) == [(logging.WARNING, "first")]

    with path.open("a") as log:
        log.write('age": "second"}\n')
    warnings, position = read_warnings(path, position)
    assert list(warnings) == [(logging.ERROR, "second")]
    assert read_warnings(path, position) == ([], path.stat().st_size)


def test_flooded_log_is_searched_at_its_end_only(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    line = '{"level": "error", "message": "again"}\n'
    path.write_text(line * 10_000 + '{"level": "error", "message": "last"}\n')

    warnings, position = read_warnings(path, 0)

    assert len(warnings) <= MAX_LOG_BYTES / len(line) + 1
    assert warnings[-1] == (logging.ERROR, "last")
    assert position == path.stat().st_size
    assert read_warnings(tmp_path / "none.log", 3) == ((), 3)


async def test_a_start_that_is_cut_short_leaves_no_child(monkeypatch: pytest.MonkeyPatch) -> None:
    group = processes()
    start = group._start
    begun: list[str] = []

    async def slow(launch: Launch) -> None:
        if begun:
            await asyncio.Event().wait()
        begun.append(launch.instance)
        await start(launch)

    monkeypatch.setattr(group, "_start", slow)
    entering = asyncio.create_task(group.__aenter__())
    await until(lambda: bool(children(group)), PATIENCE_S, "the first child")
    entering.cancel()
    with pytest.raises(asyncio.CancelledError):
        await entering
    (child,) = children(group).values()
    assert child.returncode is not None


async def test_a_child_that_will_not_end_is_killed(caplog: pytest.LogCaptureFixture) -> None:
    group = processes()
    async with group:
        child = psutil.Process(children(group)["selector"].pid)
        child.suspend()
        await until(lambda: child.status() == psutil.STATUS_STOPPED, PATIENCE_S, "it to stop")
    assert children(group)["selector"].returncode == -signal.SIGKILL
    assert caplog.messages == ["selector did not end within 1.2 s and was killed"]


@pytest.mark.parametrize(
    ("log", "words"),
    [
        ("", ""),
        ('{"message": "begins"}\nError: a.yaml: broken.\n', "a.yaml: broken"),
        ("Error: first\nError: second\nand this\n", "second"),
        ("one\ntwo\n", "two"),
        ("x" * 5000 + "\nError: far behind\n", "far behind"),
        ("Error: \xff\n", "\xff"),
    ],
)
def test_last_words(tmp_path: Path, log: str, words: str) -> None:
    path = tmp_path / "a.log"
    path.write_text(log)
    assert last_log_error(path) == words
    assert last_log_error(tmp_path / "none.log") == ""


def test_summary_that_cannot_be_written_is_refused_before_the_run(tmp_path: Path) -> None:
    check_writable(tmp_path / "new.json")
    (tmp_path / "old.json").write_text("{}")
    check_writable(tmp_path / "old.json")
    assert (tmp_path / "old.json").read_text() == "{}"
    assert not (tmp_path / "new.json").exists()
    with pytest.raises(ConfigError, match=r"--summary .*: is a directory"):
        check_writable(tmp_path)
    with pytest.raises(ConfigError, match=r"--summary .*: there is no directory .*missing"):
        check_writable(tmp_path / "missing" / "new.json")
