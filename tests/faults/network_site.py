"""A secured site on host A with one person there, and another person at host B who points at it."""

import asyncio
import contextlib
import json
import sys
from collections.abc import AsyncGenerator, Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pointit.runtime.link.credentials import read_credentials
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from tests.faults.network import Host, Network, network, network_or_skip
from tests.faults.network_view import PATIENCE_S, View
from tests.integration.access.secured import now
from tests.support.buses import free_port
from tests.support.commands import Command, Commands

SITE = "plant"
HERE, THERE = "ben", "anna"
"""People pointing at host A, and at host B."""


class Spectator:
    def __init__(self, command: Command) -> None:
        self.command = command

    def lines(self, what: str = "") -> list[dict[str, Any]]:
        """Return all received messages in order, or those of one kind, `what`."""
        whole = self.command.out.rpartition("\n")[0]
        return [json.loads(line) for line in whole.splitlines() if what in line]

    def events(self) -> list[str]:
        """Return all received selection events in order, each as `told` names it."""
        return [line["told"] for line in self.lines('"told"')]

    def ages_s(self, topic: str, since_ns: int = 0, until_ns: int = 2**63) -> list[float]:
        """Return the ages at arrival of messages on a topic between two times (Unix)."""
        lines = [
            line for line in self.lines() if line["topic"] == topic and since_ns <= line["came"] <= until_ns
        ]
        return [(line["came"] - line["stamp"]) / 1e9 for line in lines]


def python(program: str, *arguments: str) -> list[str]:
    return [sys.executable, "-m", f"tests.faults.{program}", *arguments]


@dataclass
class Plant:
    """Router, services and one person at host A; another person and an observer at host B."""

    network: Network
    commands: Commands
    path: Path
    a: Host = field(init=False)
    b: Host = field(init=False)
    folder: Path = field(init=False)
    router: Command = field(init=False)
    run: Command = field(init=False)
    here: Command = field(init=False)
    there: Command = field(init=False)

    async def begin(self) -> None:
        self.a, self.b = self.network.join("a", here=True), self.network.join("b")
        self.folder = self.path / SITE
        made = ["--folder", str(self.folder), "--users", f"{HERE},{THERE}", "--host", self.a.address]
        ended = await self.commands.pointit("site", "init", SITE, *made, "--port", str(free_port()))
        assert ended.code == 0, ended.err
        self.router = self.start(self.a, "router", "--site-folder", str(self.folder), name="")
        await self.router.says("router listens")
        self.run = self.start(self.a, "run", "scenario_4", "--site-only", "--no-view", name="supervisor")
        self.here = self.start(self.a, "user", HERE, "--no-view", "--place", "1", name=HERE)
        self.there = self.start(self.b, "user", THERE, "--no-view", "--place", "2", name=THERE)

    def start(self, host: Host, *arguments: str, name: str) -> Command:
        return host.pointit(self.commands, *arguments, environment=self.environment(host, name))

    def spectator(self, host: Host, name: str) -> Spectator:
        program = python("network_spectator", str(self.folder / "identities" / name))
        return Spectator(self.commands.run(host.arguments(*program), self.environment(host, "")))

    def environment(self, host: Host, name: str) -> dict[str, str]:
        state = {"POINTIT_STATE": str(self.path / f"state-{host.name}")}
        return state | ({"POINTIT_CREDENTIALS": str(self.folder / "identities" / name)} if name else {})

    @property
    def processes(self) -> dict[str, Command]:
        return {"router": self.router, "services": self.run, HERE: self.here, THERE: self.there}

    def memory_mb(self) -> dict[str, float]:
        return {name: _memory_mb(command) for name, command in self.processes.items()}

    def ended(self) -> list[str]:
        return [name for name, command in self.processes.items() if not command.is_running]

    async def doctor(self) -> list[str]:
        """Return the findings of `pointit doctor` at host A, each as `code service: sentence`."""
        ended = await self.start(self.a, "doctor", "--json", name="supervisor").end()
        report: dict[str, Any] = json.loads(ended.out)
        return [f"{each['code']} {each['service']}: {each['sentence']}" for each in report["findings"]]

    @contextlib.asynccontextmanager
    async def view(self) -> AsyncGenerator[View]:
        """Yield the view from host A from now on."""
        credentials = read_credentials(self.folder / "identities" / "supervisor", now())
        link = Link(site=SITE, connect=credentials.link.endpoints, credentials=credentials)
        bus = await ZenohBus.open(link, patience_s=PATIENCE_S)
        view = View(bus)
        view.look()
        try:
            yield view
        finally:
            await bus.close()


@contextlib.contextmanager
def running(path: Path) -> Generator[Plant]:
    """Yield the two hosts with everything that runs there; skip the test where there can be no network."""
    network_or_skip()
    (path / "printed").mkdir()
    commands = Commands(path / "printed")
    with network() as wire:
        try:
            plant = Plant(wire, commands, path)
            asyncio.run(plant.begin())
            yield plant
        finally:
            commands.kill_all()


def _memory_mb(command: Command) -> float:
    return float(sum(process.memory_info().rss for process in command.family()) / 1e6)
