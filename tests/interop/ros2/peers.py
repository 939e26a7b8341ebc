"""A node of others, how tests tell it what to do, and a site with its bridge beside it."""

import asyncio
import contextlib
import json
import os
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

from pointit.bridges.ros2.routing.routes import routes
from pointit.bridges.ros2.types.definitions import STANDARD_SERVICES, actions
from tests.interop.ros2.ament import AT_LEAST, install, install_action, shape
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import Command, Commands
from tests.support.pace import Patience
from tests.support.told import Told
from tests.unit.ros2.scenes import jazzy

HERE = Path(__file__).parent
DOMAIN = 7
ALIVE_S = 30.0
TYPES = jazzy()
EMPTY = {AT_LEAST.split()[1]: 0}


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
            for action, text in actions("jazzy").items():
                install_action(prefix, TYPES, action, text)
            install(prefix, TYPES, {*(route.type for route in routes(ros4hri=True).all), *STANDARD_SERVICES})
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
        self._told: Told | None = None
        self._types: dict[str, str] = {}
        """Types of the published topics."""

    def start(self) -> None:
        """Start; its node is there afterwards."""
        self._told = Told(self.name, self._command, self._trace, self._environment)
        self._told.wait()

    def kill(self) -> None:
        """End at once."""
        told = self._told
        self._told = None
        if told is not None:
            told.kill()

    @property
    def is_alive(self) -> bool:
        return self._told is not None and self._told.is_alive

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
        assert self._told is not None
        return await self._told.do(what, **order)

    async def says(self, topic: str, value: Any) -> None:
        """Publish on a topic that it has advertised before."""
        await self.do("say", topic=topic, value=value, shape=shape(TYPES, self._types[topic]))

    async def advertises(self, topic: str, kind: str, **qos: Any) -> None:
        """Appear as publisher of `topic`."""
        self._types[topic] = kind
        await self.do("advertise", topic=topic, type=kind, **qos)

    async def hears(self, topic: str, fits: Callable[[Any], bool] = lambda _value: True) -> Any:
        """Return the first message on `topic` from now on, or waiting, that fits."""
        patience = Patience(ALIVE_S)
        last = None
        while not patience.is_over():
            for last in await self.do("heard", topic=topic):
                if fits(last):
                    return last
            await asyncio.sleep(0.02)
        raise AssertionError(f"{topic}: nothing that fits within {patience}; the last one was {last}")

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


BOTH = ("--users", "2", "--imu", "sim", "--imu", "page")
"""Options for two users: user1 is simulated, and user2's arm orientation comes from the peer."""


class Site:
    """Running processes of the site. Each can be ended and started again."""

    def __init__(self, folder: Path, python: Path) -> None:
        self.ours = f"tcp/127.0.0.1:{free_port()}"
        self.ros = f"tcp/127.0.0.1:{free_port()}"
        self.folder = folder
        self.dora = Dora(python, folder, self.ros, "robot")
        self._commands = Commands(folder)
        self._environment = {"POINTIT_STATE": str(folder / "state")}

    def run(self, *arguments: str) -> Command:
        """Start `pointit run scenario_4`."""
        whole = ("run", "scenario_4", "--no-view", *BOTH, "--listen", self.ours, *arguments)
        return self._commands.start(*whole, environment=self._environment)

    def run_with_bridge(self, *arguments: str) -> Command:
        """Start it with the bridge in it, which is the ROS router."""
        settings = (f"endpoint={self.ros}", "mode=router", f"domain_id={DOMAIN}")
        pairs = [("--set", f"ros2.backend.{setting}") for setting in settings]
        return self.run("--ros2", *(argument for pair in pairs for argument in pair), *arguments)

    def bridge(self, mode: str) -> Command:
        """Start the bridge as a process of its own."""
        settings = {"endpoint": self.ros, "mode": mode, "domain-id": f"{DOMAIN}"}
        pairs = [(f"--backend.{name}", value) for name, value in settings.items()]
        command = [sys.executable, "-m", "pointit.services", "ros2", "--connect", self.ours]
        command += [argument for pair in pairs for argument in pair]
        return self._commands.run(command, self._environment)

    def end(self) -> None:
        """End everything."""
        self.dora.kill()
        self._commands.kill_all()


@contextlib.contextmanager
def site(folder: Path, python: Path) -> Generator[Site]:
    """Yield a site of which nothing runs yet, and end what was started."""
    made = Site(folder, python)
    try:
        yield made
    finally:
        made.end()
