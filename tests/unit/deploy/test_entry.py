"""The container's entry: waits for credentials, begins again with growing pauses, ends when it is told to."""

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.unit.deploy.stack import DEPLOY

IMAGE = DEPLOY / "image"
PATIENCE_S = 20.0


@contextlib.contextmanager
def started(
    tmp_path: Path, script: str, *arguments: str, **environment: str
) -> Generator[subprocess.Popen[str]]:
    """Begin `entry ARGUMENTS` where `pointit` is `script`, which notes in `log` that it was run."""
    fake = tmp_path / "pointit"
    fake.write_text(f'#!/bin/sh\necho "$@" >> {tmp_path}/log\n{script}\n', encoding="utf-8")
    fake.chmod(0o755)
    with subprocess.Popen(
        ["/bin/sh", str(IMAGE / "entry"), *arguments],
        env={"PATH": f"{tmp_path}:{os.environ['PATH']}", **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def runs(tmp_path: Path) -> list[str]:
    log = tmp_path / "log"
    return log.read_text(encoding="utf-8").splitlines() if log.exists() else []


def wait_for_runs(tmp_path: Path, count: int) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while len(runs(tmp_path)) < count:
        assert time.monotonic() < end_s, runs(tmp_path)
        time.sleep(0.02)


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    process.send_signal(signal.SIGTERM)
    out, _ = process.communicate(timeout=PATIENCE_S)
    return process.returncode, out


def test_it_waits_for_its_credentials(tmp_path: Path) -> None:
    link = tmp_path / "link.json"
    with started(tmp_path, "exec sleep 60", "service", "run", "pui", WAIT_FOR=str(link)) as process:
        assert process.stdout is not None
        assert "waits for" in process.stdout.readline()
        assert runs(tmp_path) == []
        link.touch()
        wait_for_runs(tmp_path, 1)
        assert runs(tmp_path) == ["service run pui"]
        ended(process)


def test_it_ends_while_it_waits(tmp_path: Path) -> None:
    with started(tmp_path, "exit 0", "router", WAIT_FOR=str(tmp_path / "never")) as process:
        assert process.stdout is not None
        assert "waits for" in process.stdout.readline()
        assert ended(process)[0] == 0
        assert runs(tmp_path) == []


def test_service_that_ends_is_restarted_after_growing_pauses(tmp_path: Path) -> None:
    with started(tmp_path, "exit 3", "service", "run", "pui") as process:
        assert process.stdout is not None
        lines: list[str] = []
        while len(lines) < 3 and (line := process.stdout.readline()):
            if "ended by itself" in line:
                lines.append(line.rstrip())
        assert ended(process)[0] == 0  # it pauses: the service itself would end with 3
        assert [line.split("; ")[1] for line in lines] == ["again in 1 s", "again in 2 s", "again in 4 s"]
        assert "exit code 3" in lines[0]


def test_it_passes_the_signal_on_and_takes_the_exit_code(tmp_path: Path) -> None:
    script = f"trap 'kill $!; echo asked >> {tmp_path}/log; exit 5' TERM\nsleep 60 &\nwait"
    with started(tmp_path, script, "person", "add", "anna") as process:
        wait_for_runs(tmp_path, 1)
        time.sleep(0.2)  # the trap is set after the line in the log
        assert ended(process)[0] == 5
        assert runs(tmp_path) == ["person add anna", "asked"]


@pytest.mark.parametrize("arguments", [("doctor",), ("--help",), ("site", "show")])
def test_one_time_command_is_run_once(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    with started(tmp_path, "exit 4", *arguments, WAIT_FOR=str(tmp_path / "never")) as process:
        process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 4
        assert runs(tmp_path) == [" ".join(arguments)]
