"""The command line in processes forked from one that has loaded its modules: each starts in milliseconds."""

import multiprocessing
import os
import pkgutil
import runpy
import signal
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import pointit.bridges.web
import pointit.cli
import pointit.launch
import pointit.services

ROOMS = (pointit.cli, pointit.launch, pointit.services, pointit.bridges.web)
"""Packages whose modules are loaded."""

POLL_S = 0.005

_processes = multiprocessing.get_context("forkserver")
_modules = (each.name for room in ROOMS for each in pkgutil.walk_packages(room.__path__, f"{room.__name__}."))
_processes.set_forkserver_preload(
    ["tests.support.forked", *(name for name in _modules if not name.endswith(".__main__"))]
)


class ForkedProcess:
    """A running command, used like `subprocess.Popen`.

    It ends without the clean-up of the interpreter, and its command line is that of the process that it was
    forked from: tests of these need a process of their own.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        out: Path,
        err: Path,
        environment: Mapping[str, str],
        cwd: Path | None = None,
    ) -> None:
        """Start `pointit …` in a session of its own, with `environment` alone, by default in this folder."""
        self.out = out
        self.err = err
        self._process = _processes.Process(
            target=_command, args=(list(arguments), out, err, dict(environment), cwd or Path.cwd())
        )
        self._process.start()
        assert self._process.pid is not None
        self.pid = self._process.pid

    @property
    def returncode(self) -> int | None:
        """Return the exit code, -N if signal N has ended it, or `None` while it runs."""
        return self._process.exitcode

    def says(self, what: str) -> None:
        while not (self.out.exists() and what in self.out.read_text()):
            assert self.poll() is None, self.err.read_text()
            time.sleep(POLL_S)

    def poll(self) -> int | None:
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int | None:
        """Return the exit code as soon as it has ended, or None after `timeout`, s."""
        self._process.join(timeout)
        return self.returncode


def run(arguments: Sequence[str], patience_s: float) -> tuple[int, str, str]:
    """Run `pointit …`, for `patience_s` at most. Return the exit code, standard output and standard error."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "out")
        err = Path(folder, "err")
        process = ForkedProcess(arguments, out, err, os.environ)
        if process.wait(patience_s) is None:
            process.kill()
        code = process.wait()
        assert code is not None
        return code, out.read_text(), err.read_text()


def _command(
    arguments: list[str], out: Path, err: Path, environment: Mapping[str, str], folder: Path
) -> None:
    os.setsid()
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    time.tzset()
    tempfile.tempdir = None  # read TMPDIR again
    for path, flags, number in (
        (Path(os.devnull), os.O_RDONLY, 0),
        (out, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 1),
        (err, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 2),
    ):
        file = os.open(path, flags)
        os.dup2(file, number)
        os.close(file)
    sys.argv = ["pointit", *arguments]
    runpy.run_module("pointit", run_name="__main__", alter_sys=True)
