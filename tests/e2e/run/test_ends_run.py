"""Ctrl-C and SIGTERM end every command within 2 s, at any moment, leaving nothing behind."""

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from tests.support.bench import until
from tests.support.commands import PATIENCE_S, Command, Commands, Ended, onlooker
from tests.support.pace import within

END_S = 2.0
ENDINGS = [
    (signal.SIGINT, ()),
    (signal.SIGTERM, ("--processes",)),
    pytest.param(signal.SIGTERM, (), marks=pytest.mark.long),
    pytest.param(signal.SIGINT, ("--processes",), marks=pytest.mark.long),
]
RUN = ("run", "scenario_3", "--no-view")
TOLD = "scenario_3 of site lab at"
"""Logged when the bus is open and the services are about to start."""


def nothing_is_left(family: list[psutil.Process]) -> None:
    _gone, alive = psutil.wait_procs(family, timeout=10)
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
    assert summary["duration_s"] < 60
    assert len(summary["services"]) == 9


@pytest.mark.parametrize("processes", [(), ("--processes",)])
async def test_ctrl_c_in_a_terminal_reaches_the_whole_group(
    commands: Commands, endpoint: str, processes: tuple[str, ...]
) -> None:
    run = commands.start_program(*RUN, *processes, "--listen", endpoint)
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
    ended = await run.stop(signal.SIGCONT)
    assert ended.code == -signal.SIGINT
    assert (ended.out, ended.err) == ("", "")


Arguments = Callable[[str], tuple[str, ...]]
OTHERS: dict[str, tuple[Arguments, str]] = {
    "user": (lambda at: ("person", "add", "anna", "--connect", at), "anna of site lab at"),
    "user in processes": (
        lambda at: ("person", "add", "cleo", "--processes", "--connect", at),
        "cleo of site",
    ),
    "service": (lambda at: ("service", "run", "pointing", "--user", "ben", "--connect", at), "runs"),
    "echo": (lambda at: ("topic", "echo", "users/*/imu", "--connect", at), "users/user1/imu"),
}


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
async def test_the_other_commands_end_as_well(commands: Commands, endpoint: str, number: int) -> None:
    run = commands.start_program(*RUN, "--listen", endpoint)
    await run.says(TOLD)  # `echo` does not wait long for a site
    started = {name: commands.start_program(*arguments(endpoint)) for name, (arguments, _) in OTHERS.items()}
    for name, command in started.items():
        await command.says(OTHERS[name][1])
        family = command.family()
        ended = await command.stop(number)
        well(ended)
        nothing_is_left(family)


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
async def test_doctor_ends_without_a_verdict(commands: Commands, endpoint: str, number: int) -> None:
    """Code 0 would mean that all is well, which it does not know: 130."""
    commands.start_program(*RUN, "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await until(lambda: "pui" in seen.present, 30, "a run")
        doctor = commands.start_program("doctor", "--connect", endpoint)
        await until(lambda: catches(doctor, signal.SIGTERM), 30, "doctor to listen")
        ended = await doctor.stop(number)
    assert ended.code == 130
    assert within(ended.took_s, END_S)
    assert "Traceback" not in ended.err
