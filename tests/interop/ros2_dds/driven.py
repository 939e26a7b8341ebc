"""The environment with a genuine rclpy, and processes in it that do as they are told."""

import asyncio
import contextlib
import fcntl
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest

from pointit.bridges.ros2.types import Types
from tests.architecture.sources import ROOT

HERE = Path(__file__).parent
VENV = ROOT / ".venv-rclpy"
REQUIREMENTS = HERE / "requirements.txt"
INSTALL_S = 500.0
PATIENCE_S = 20.0
TYPES = Types("jazzy")
DOMAIN = 10 + os.getpid() % 90
"""Apart from others on this machine; up to 101, whose ports the system gives to nobody else."""


def python_of_rclpy(say: Callable[[str], None]) -> Path:
    """Return the Python that has rclpy; the first time, and when the list has changed, this takes a minute.

    `say` is told what goes on. Skips the test where pip cannot fetch it.
    """
    python, stamp = VENV / "bin" / "python", VENV / ".installed"
    wanted = f"{sys.version}\n{REQUIREMENTS.read_text(encoding='utf-8')}"
    with _alone(ROOT / ".venv-rclpy.lock"):
        if stamp.exists() and stamp.read_text(encoding="utf-8") == wanted:
            return python
        shutil.rmtree(VENV, ignore_errors=True)
        for sentence, command in (
            ("making .venv-rclpy", (sys.executable, "-m", "venv", f"{VENV}")),
            (
                "fetching ROS 2's rclpy into .venv-rclpy (100 MB, once)",
                (f"{python}", "-m", "pip", "install", "--disable-pip-version-check", "-r", f"{REQUIREMENTS}"),
            ),
        ):
            say(sentence)
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_S, check=False)
                said, failed = done.stdout + done.stderr, done.returncode != 0
            except (OSError, subprocess.TimeoutExpired) as error:
                said, failed = f"{error}", True
            if failed:
                shutil.rmtree(VENV, ignore_errors=True)
                pytest.skip(f"{sentence} failed: {' '.join(said.split()[-40:])}")
        stamp.write_text(wanted, encoding="utf-8")
        say("rclpy is there")
    return python


@contextlib.contextmanager
def _alone(lock: Path) -> Generator[None]:
    with lock.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield


def environment(folder: Path) -> dict[str, str]:
    """Return variables of a process that finds our sources and a ROS graph on this machine alone."""
    rooms = [f"{ROOT / room}" for room in ("schemas", "services", "bridges")]
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("ROS_", "RMW_"))}
    return kept | {
        "HOME": f"{folder}",
        "POINTIT_STATE": f"{folder / 'state'}",
        "PYTHONPATH": os.pathsep.join(rooms),
        "PYTHONWARNINGS": "ignore",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_HOME": f"{folder}",
    }


class Driven:
    """A node in a process of its own: `bridge_side.py` or `rclpy_peer.py`."""

    def __init__(self, python: Path, folder: Path, script: str, node: str) -> None:
        self.node = node
        self._said = folder / f"{node.rpartition('/')[2]}.stderr"
        with self._said.open("w") as said:
            self._process = subprocess.Popen(
                (f"{python}", f"{HERE / script}", node, f"{DOMAIN}"),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=said,
                text=True,
                env=environment(folder),
            )

    def wait(self) -> None:
        """Return when its node is there."""
        line = self._line()
        assert line == "{}\n", f"{self.node}: {line} {self._said.read_text()[-2000:]}"

    def kill(self) -> None:
        """End at once."""
        self._process.kill()
        self._process.communicate()

    def complaints(self) -> str:
        """Return what it has written to standard error."""
        return self._said.read_text()

    async def do(self, what: str, **order: Any) -> Any:
        """Tell it to do something; return what it answers."""
        if "type" in order:
            order = {"hash": TYPES.kind(order["type"]).hash, **order}
        return await asyncio.to_thread(self._do, {"do": what, **order})

    def _do(self, order: dict[str, Any]) -> Any:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        line = self._line()
        assert line, f"{self.node} has ended: {self._said.read_text()[-2000:]}"
        answer = json.loads(line)
        assert "error" not in answer, f"{self.node}: {order}: {answer['error'][:300]}"
        return answer["value"]

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    async def until(self, what: str, fits: Callable[[Any], object], **order: Any) -> Any:
        """Ask until the answer fits; return it."""
        deadline_s = asyncio.get_running_loop().time() + PATIENCE_S
        while not fits(answer := await self.do(what, **order)):
            late = asyncio.get_running_loop().time() > deadline_s
            assert not late, f"{self.node} {what} {order}: still {str(answer)[:500]} after {PATIENCE_S} s"
            await asyncio.sleep(0.02)
        return answer


def cdr(name: str, **fields: Any) -> str:
    """Return a message's CDR, hexadecimal."""
    return TYPES.encode(name, TYPES.make(name, **fields)).hex()


def value(name: str, text: str) -> Any:
    """Return what is in a message's CDR, hexadecimal."""
    return TYPES.decode(name, bytes.fromhex(text))
