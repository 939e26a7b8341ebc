"""Ctrl-C and SIGTERM end every command within 2 s, at any moment, leaving nothing behind."""

import contextlib
import json
import os
import signal
import socket
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from tests.support.bench import until
from tests.support.commands import PATIENCE_S, Command, Commands, Ended, onlooker
from tests.support.pace import within

END_S = 2.0
ENDINGS = [(signal.SIGINT, ()), (signal.SIGTERM, ("--processes",))]
RUN = ("run", "scenario_3", "--no-view", "--duration", "600")
TOLD = "scenario_3 starts on site lab at"
"""Logged when the bus is open and the services are about to start."""


def nothing_is_left(family: list[psutil.Process]) -> None:
    _gone, alive = psutil.wait_procs(family, timeout=60)
    left = [process.cmdline() for process in alive if process.status() != psutil.STATUS_ZOMBIE]
    assert not left


def well(ended: Ended) -> None:
    assert ended.code == 0, ended.err
    assert within(ended.took_s, END_S)
    assert "Traceback" not in ended.err
    assert "Error" not in ended.err


@pytest.mark.parametrize(("number", "processes"), ENDINGS)
async def test_a_run_ends_with_its_summary(
    commands: Commands, endpoint: str, tmp_path: Path, number: int, processes: tuple[str, ...]
) -> None:
    path = tmp_path / "summary.json"
    run = commands.start_program(*RUN, *processes, "--listen", endpoint, "--summary", str(path))
    async with onlooker(endpoint) as seen:
        await seen.sees_cursors("user1")
    family = run.family()
    assert len(family) == (10 if processes else 1)

    ended = await run.stop(number)
    print(f"run {processes} ended after {ended.took_s:.2f} s")  # noqa: T201 - shown with -s
    well(ended)
    nothing_is_left(family)
    assert "scenario_3 ran" in ended.out

    summary = json.loads(path.read_text())
    assert summary["cursors"] > 0
    assert summary["duration_s"] < 600
    assert len(summary["services"]) == 9


async def test_ctrl_c_reaches_a_group(commands: Commands, endpoint: str) -> None:
    run = commands.start_program(*RUN, "--processes", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await until(lambda: "user-sim.user1" in seen.health, 30, "a run")
    family = run.family()
    os.killpg(run.process.pid, signal.SIGINT)
    os.killpg(run.process.pid, signal.SIGINT)
    well(await run.stop())  # people press it more than once
    nothing_is_left(family)
    assert not [line for line in run.logged() if "ended with" in line or "killed" in line]


@pytest.mark.parametrize(("number", "processes"), ENDINGS)
async def test_a_run_ends_while_it_starts(
    commands: Commands, endpoint: str, tmp_path: Path, number: int, processes: tuple[str, ...]
) -> None:
    path = tmp_path / "summary.json"
    run = commands.start_program(*RUN, *processes, "--listen", endpoint, "--summary", str(path))
    await run.says(TOLD)
    if processes:
        await until(lambda: len(run.family()) >= 3, 30, "the first children")
    family = run.family()
    ended = await run.stop(number)
    well(ended)
    nothing_is_left(family)
    assert json.loads(path.read_text())["selected"] == 0


TRIES = 10


def catches(command: Command, number: int, mask: str = "SigCgt") -> bool:
    """Return True if the process has a handler of its own for a signal, or has it in another `mask`."""
    for line in Path(f"/proc/{command.process.pid}/status").read_text().splitlines():
        if line.startswith(f"{mask}:"):
            return bool(int(line.split()[1], 16) >> (number - 1) & 1)
    raise AssertionError("no such line")


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux tells which signals are caught")
async def test_ctrl_c_while_modules_load_is_silent(commands: Commands, endpoint: str) -> None:
    """Nothing has begun yet: the process may die of the signal, but not with a traceback."""
    run = commands.start_program(*RUN, "--listen", endpoint)
    for _ in range(TRIES):

        def has_begun(run: Command = run) -> bool:
            """Python ignores SIGPIPE from its start, and catches SIGINT from then until our first line."""
            return catches(run, signal.SIGPIPE, "SigIgn") and not catches(run, signal.SIGINT)

        await until(has_begun, PATIENCE_S, "our first line")
        run.process.send_signal(signal.SIGSTOP)
        if has_begun():
            break
        run.kill()  # this test was held up until the modules were loaded
        run = commands.start_program(*RUN, "--listen", endpoint)
    run.process.send_signal(signal.SIGINT)
    ended = await run.stop(signal.SIGCONT, code=-signal.SIGINT)
    assert (ended.out, ended.err) == ("", "")


Arguments = Callable[[str], tuple[str, ...]]
OTHERS: dict[str, tuple[Arguments, str]] = {
    "user": (lambda at: ("person", "add", "anna", "--connect", at), "anna starts on site lab at"),
    "user in processes": (
        lambda at: ("person", "add", "cleo", "--processes", "--connect", at),
        "cleo starts on site",
    ),
    "service": (lambda at: ("service", "run", "pointing", "--user", "ben", "--connect", at), "runs"),
    "echo": (lambda at: ("topic", "echo", "users/*/imu", "--connect", at), "users/user1/imu"),
}


async def test_the_other_commands_end_as_well(commands: Commands, endpoint: str) -> None:
    run = commands.start_program(*RUN, "--listen", endpoint)
    await run.says(TOLD)  # `echo` does not wait long for a site
    started = {name: commands.start_program(*arguments(endpoint)) for name, (arguments, _) in OTHERS.items()}
    for name, command in started.items():
        await command.says(OTHERS[name][1])
        family = command.family()
        ended = await command.stop(signal.SIGINT)
        well(ended)
        nothing_is_left(family)


async def test_doctor_ends_without_a_verdict(commands: Commands, endpoint: str) -> None:
    """Code 0 would mean that all is well, which it does not know: 130."""
    commands.start_program(*RUN, "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await until(lambda: "pui" in seen.present, 30, "a run")
        doctor = commands.start_program("doctor", "--connect", endpoint)
        await until(lambda: catches(doctor, signal.SIGTERM), 30, "doctor to listen")
        ended = await doctor.stop(signal.SIGTERM)
    assert ended.code == 130
    assert within(ended.took_s, END_S)
    assert "Traceback" not in ended.err


MISTAKEN = ("run", "--no-view", "--duration", "60")


def one_sentence(ended: Ended, *parts: str, code: int = 2) -> None:
    assert ended.code == code, ended.err
    assert within(ended.took_s, 15.0)  # found before or at the start, not at the end
    assert "Traceback" not in ended.err
    assert ended.out == ""
    for part in parts:
        assert part in ended.sentence, ended.sentence
    assert "\n" not in ended.sentence


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("--config", "{folder}/section.yaml"), ["section.yaml: 'puj' is no service", "did you mean pui?"]),
        (("--set", "pui.map={folder}/none.yaml"), ["{folder}/none.yaml: cannot be read"]),
        (("--imu", "sim", "--imu", "sim"), ["--imu is given for 2 people", "--users"]),
        (("--connect", "tcp/h:1", "--listen", "tcp/h:2"), ["--listen and --connect exclude each other"]),
        (("--site", "a/b"), ["site 'a/b'"]),
    ],
)
async def test_mistakes_in_options_and_files_are_named(
    commands: Commands, endpoint: str, tmp_path: Path, arguments: tuple[str, ...], parts: list[str]
) -> None:
    (tmp_path / "section.yaml").write_text("puj: {}\n")
    filled = [argument.replace("{folder}", str(tmp_path)) for argument in arguments]
    where = () if {"--listen", "--connect"} & set(arguments) else ("--listen", endpoint)
    ended = await commands.pointit(*MISTAKEN, *filled, *where)
    one_sentence(ended, *(part.replace("{folder}", str(tmp_path)) for part in parts))


async def test_users_have_mistakes_of_their_own(commands: Commands, endpoint: str) -> None:
    where = ("--connect", endpoint)
    one_sentence(await commands.pointit("person", "add", "a b", *where), "user 'a b'")
    two = await commands.pointit("person", "add", "anna", "--imu", "sim", "--imu", "sim", *where)
    one_sentence(two, "--imu is given 2 times for one person")
    setting = await commands.pointit("person", "add", "anna", "--set", "pui.map=lab", *where)
    one_sentence(setting, "pui is not among what this starts")


async def test_a_taken_address(commands: Commands) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        ended = await commands.pointit(*MISTAKEN, "--listen", address)
    one_sentence(ended, f"cannot listen on {address}", "--connect", "--listen", code=1)


@pytest.mark.parametrize("arguments", [MISTAKEN, ("person", "add", "anna")])
async def test_nobody_is_there_to_join(commands: Commands, endpoint: str, arguments: tuple[str, ...]) -> None:
    command = commands.start(*arguments, "--connect", endpoint)
    await command.says(f"nobody answers at {endpoint} yet; trying again until somebody does")
    ended = await command.stop(signal.SIGINT, code=0)
    assert within(ended.took_s, 4.0)
    assert "Traceback" not in ended.err
    assert ended.out == ""  # nothing has run


async def test_the_default_address_gives_way(commands: Commands) -> None:
    """Without an explicit address the next free one is used, and the run prints how others find it."""
    with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", 7447)):  # or another process has it
        run = commands.start("run", "scenario_2", "--no-view", "--duration", "600")
        await run.says(
            "tcp/127.0.0.1:7447 is in use, probably by another run, so this run listens at tcp/127.0.0.1:"
        )
        await run.says("start one of two runs on the same machine with --site NAME")
        await run.says("scenario_2 starts on site lab at tcp/127.0.0.1:")
        assert (await run.stop()).code == 0
