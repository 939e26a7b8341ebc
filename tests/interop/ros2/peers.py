"""Peers of others: the environment they are in, and how tests tell one what to do."""

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

from pointit.bridges.ros2.definitions import STANDARD_SERVICES
from pointit.bridges.ros2.routes import routes
from pointit.bridges.ros2.types import Types
from tests.architecture.sources import ROOT
from tests.interop.ros2.ament import AT_LEAST, install, shape
from tests.support.bench import until

HERE = Path(__file__).parent
VENV = ROOT / ".venv-peers"
REQUIREMENTS = HERE.parent / "requirements.txt"
INSTALL_S = 500.0
DOMAIN = 7
ALIVE_S = 30.0
TYPES = Types("jazzy")
EMPTY = {AT_LEAST.split()[1]: 0}


def python_of_peers(say: Callable[[str], None]) -> Path:
    """Return the Python that has the peers; the first time, and when their list has changed, this takes long.

    `say` is told what goes on. Skips the test where pip cannot fetch them.
    """
    python, stamp = VENV / "bin" / "python", VENV / ".installed"
    wanted = f"{sys.version}\n{REQUIREMENTS.read_text(encoding='utf-8')}"
    with _alone(ROOT / ".venv-peers.lock"):
        if stamp.exists() and stamp.read_text(encoding="utf-8") == wanted:
            return python
        shutil.rmtree(VENV, ignore_errors=True)
        for sentence, command in (
            ("making .venv-peers", (sys.executable, "-m", "venv", f"{VENV}")),
            (
                "fetching independent ROS 2 peers into .venv-peers (100 MB, once)",
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
        say("the peers are there")
    return python


@contextlib.contextmanager
def _alone(lock: Path) -> Generator[None]:
    with lock.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield


class Dora:
    """A node of dora-rs in a process of its own."""

    def __init__(self, python: Path, folder: Path, endpoint: str, name: str) -> None:
        configuration = folder / f"{name}.json5"
        settings = {
            "mode": "client",
            "connect": {"endpoints": [endpoint], "timeout_ms": -1},
            "scouting": {"multicast": {"enabled": False}},
            "timestamping": {"enabled": True},
        }
        configuration.write_text(json.dumps(settings))
        prefix = folder / "ament"
        if not prefix.exists():
            install(prefix, TYPES, {*(route.type for route in routes().all), *STANDARD_SERVICES})
        self.name = name
        self._trace = folder / f"{name}.trace"
        self._command = (f"{python}", "-W", "ignore", f"{HERE / 'dora_peer.py'}", name, f"{configuration}")
        self._environment = {
            **os.environ,
            "AMENT_PREFIX_PATH": f"{prefix}",
            "DORA_ROS2_ZENOH_TRACE": "1",
            "HOME": f"{folder}",
            "RMW_IMPLEMENTATION": "rmw_zenoh_cpp",
            "ROS_DISTRO": "jazzy",
            "ROS_DOMAIN_ID": f"{DOMAIN}",
        }
        self._process: subprocess.Popen[str] | None = None
        self._types: dict[str, str] = {}
        """Of what it publishes."""

    def start(self) -> None:
        """Start; its node is there afterwards."""
        with self._trace.open("w") as trace:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=trace,
                text=True,
                env=self._environment,
            )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "{}\n", self._trace.read_text()[-2000:]

    def kill(self) -> None:
        """End at once."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()

    @property
    def is_alive(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def tokens(self) -> set[str]:
        """Return those that it sees in the graph now."""
        present: set[str] = set()
        for line in self._trace.read_text().splitlines():
            before, found, token = line.partition(": @ros2_lv/")
            if found and "liveliness" in before and "declare" not in before:
                change = present.discard if before.endswith("Delete") else present.add
                change(f"@ros2_lv/{token}")
        return present

    async def do(self, what: str, **order: Any) -> Any:
        """Tell it to do something; return what it answers."""
        return await asyncio.to_thread(self._do, {"do": what, **order})

    def _do(self, order: dict[str, Any]) -> Any:
        assert self._process is not None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        assert line, f"{self.name} has ended: {self._trace.read_text()[-2000:]}"
        answer = json.loads(line)
        assert "error" not in answer, f"{self.name}: {order}: {answer['error'][:300]}"
        return answer["value"]

    async def says(self, topic: str, value: Any) -> None:
        """Publish on a topic that it has advertised before."""
        await self.do("say", topic=topic, value=value, shape=shape(TYPES, self._types[topic]))

    async def advertises(self, topic: str, kind: str, **qos: Any) -> None:
        """Appear as publisher of `topic`."""
        self._types[topic] = kind
        await self.do("advertise", topic=topic, type=kind, **qos)

    async def hears(self, topic: str, fits: Callable[[Any], bool] = lambda _value: True) -> Any:
        """Return the first message on `topic` from now on, or waiting, that fits."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + ALIVE_S
        last = None
        while loop.time() < deadline_s:
            for last in await self.do("heard", topic=topic):
                if fits(last):
                    return last
            await asyncio.sleep(0.02)
        raise AssertionError(f"{topic}: nothing that fits within {ALIVE_S} s; the last one was {last}")

    async def calls(self, service: str, kind: str, /, **request: Any) -> Any:
        """Return the response."""
        sent = shape(TYPES, TYPES.request_of(kind))
        response = await self.do("call", service=service, type=kind, request=request or EMPTY, shape=sent)
        return {name: value for name, value in response.items() if name not in EMPTY}

    async def serves(self, service: str, kind: str, /, **response: Any) -> None:
        """Answer every request to `service` with `response`."""
        sent = shape(TYPES, TYPES.response_of(kind))
        await self.do("serve", service=service, type=kind, response=response or EMPTY, shape=sent)

    async def sees(self, *parts: str, gone: bool = False) -> None:
        """Wait until a token with all `parts` is in the graph that it sees, or gone from it."""

        def found() -> bool:
            return any(all(part in token for part in parts) for token in self.tokens())

        await until(lambda: found() != gone, ALIVE_S, f"{parts} {gone=}")
