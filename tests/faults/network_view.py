"""The view of a site at its router's host: cursors and their delays, findings of doctor."""

import asyncio
import contextlib
import itertools
import json
import math
import os
import sys
import time
from collections import defaultdict
from collections.abc import AsyncGenerator, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import DiagnosisReport, Finding, Observation
from pointit.runtime.link.link import Link, read_credentials
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, Deployment, Health, SelectionEvent
from pointit.schemas.topics import CURSOR, DEPLOYMENT, HEALTH, SELECTION_EVENTS, SERVICE_ALIVE
from tests.faults.network import Host, Network, network, network_or_skip
from tests.integration.access.secured import now
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import Command, Commands

PATIENCE_S = 40.0
FRESH_S = 0.5
"""A cursor up to this age is where the person points."""
REPORTS_S = 8.0
"""Doctor looks back so far."""


@dataclass(frozen=True)
class Seen:
    user: str
    age_s: float
    came_s: float
    """Monotonic."""


@dataclass
class View:
    bus: ZenohBus
    cursors: list[Seen] = field(default_factory=list[Seen])
    events: list[str] = field(default_factory=list[str])
    """Selections and deselections, each as `told` names it."""
    _present: set[str] = field(default_factory=set[str])
    _ever: set[str] = field(default_factory=set[str])
    _reports: dict[str, list[DiagnosisReport]] = field(default_factory=lambda: defaultdict(list))
    _deployments: dict[str, Deployment] = field(default_factory=dict[str, Deployment])
    _told: int = 0
    _began_s: float = field(default_factory=time.monotonic)

    def look(self) -> None:
        self._teller = self.bus.publisher(SELECTION_EVENTS)
        self.bus.subscribe(CURSOR, self._on_cursor)
        self.bus.subscribe(SELECTION_EVENTS, self._on_event)
        self.bus.subscribe(HEALTH, self._on_health)
        self.bus.subscribe(DEPLOYMENT, self._on_deployment)
        self.bus.watch(SERVICE_ALIVE, self._on_presence)

    def tell(self) -> None:
        """Publish a selection event, which observers elsewhere must get, now or later."""
        self._told += 1
        event = SelectionEvent(stamp_ns=time.time_ns(), seq=self._told, event="left", object_id=f"{id(self)}")
        self._teller.put(event)

    def findings(self) -> list[Finding]:
        now_s = time.monotonic()
        lately = {
            instance: [report for report in reports if report.received_s > now_s - REPORTS_S] or reports[-1:]
            for instance, reports in self._reports.items()
        }
        seen = Observation(
            began_s=max(self._began_s, now_s - REPORTS_S), now_s=now_s, present=frozenset(self._present),
            left=frozenset(self._ever - self._present), reports=lately, deployments=self._deployments,
            host=os.uname().nodename,
        )  # fmt: skip
        return [finding for finding in diagnose(seen) if finding.severity != "note"]

    def ages_s(self, user: str, since_s: float = 0.0, until_s: float = math.inf) -> list[float]:
        return [it.age_s for it in self.cursors if it.user == user and since_s <= it.came_s <= until_s]

    def gap_s(self, user: str, since_s: float) -> float:
        """Return the longest time between two cursors of `user` since then, till now."""
        came = [
            since_s,
            *(each.came_s for each in self.cursors if each.user == user and each.came_s > since_s),
        ]
        return max(later - earlier for earlier, later in itertools.pairwise([*came, time.monotonic()]))

    @property
    def present(self) -> frozenset[str]:
        return frozenset(self._present)

    async def flows(self, *users: str) -> None:
        """Wait until fresh cursors of everybody come, from now on."""
        began_s = time.monotonic()

        def flow() -> bool:
            return all(min(self.ages_s(user, began_s), default=math.inf) < FRESH_S for user in users)

        await until(flow, PATIENCE_S, f"fresh cursors of {users}")

    async def calm(self) -> None:
        """Wait until there is nothing to find, except that this machine is slow."""

        def found() -> list[Finding]:
            return [finding for finding in self.findings() if finding.code != "slow"]

        await until(lambda: not found(), PATIENCE_S, f"nothing to be found; there is {found()}")

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        age_s = (time.time_ns() - cursor.stamp_ns) / 1e9
        self.cursors.append(Seen(user, age_s, time.monotonic()))

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        self.events.append(told(event))

    def _on_health(self, health: Health, instance: str) -> None:
        self._reports[instance].append(
            DiagnosisReport(received_s=time.monotonic(), health=health, arrived_ns=time.time_ns())
        )

    def _on_deployment(self, deployment: Deployment, name: str) -> None:
        self._deployments[name] = deployment

    def _on_presence(self, instance: str, *, present: bool) -> None:
        (self._present.add if present else self._present.discard)(instance)
        self._ever.add(instance)


def told(event: SelectionEvent) -> str:
    return f"{event.seq} {event.event} {event.object_id} {event.user}"


def quantile_s(values_s: Sequence[float], share: float) -> float:
    ordered = sorted(values_s)
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


SITE = "plant"
HERE = "ben"
"""Person pointing at host A."""
THERE = "anna"
"""Person pointing at host B."""


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
        lines = [it for it in self.lines() if it["topic"] == topic and since_ns <= it["came"] <= until_ns]
        return [(line["came"] - line["stamp"]) / 1e9 for line in lines]


def python(program: str, *arguments: str) -> list[str]:
    return [sys.executable, "-m", f"tests.faults.{program}", *arguments]


@dataclass
class Plant:
    """Router, services and one person at host A; another person and an observer at host B."""

    network: Network
    commands: Commands
    path: Path
    rates: Mapping[str, str]
    """Parameters of the processes, as environment variables."""
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
        self.here = self.start(self.a, "person", "add", HERE, "--no-view", "--place", "1", name=HERE)
        self.there = self.start(self.b, "person", "add", THERE, "--no-view", "--place", "2", name=THERE)

    def start(self, host: Host, *arguments: str, name: str) -> Command:
        return host.pointit(self.commands, *arguments, environment=self.environment(host, name))

    def spectator(self, host: Host, name: str) -> Spectator:
        program = python("network_spectator", str(self.folder / "identities" / name))
        return Spectator(self.commands.run(host.arguments(*program), self.environment(host, "")))

    def environment(self, host: Host, name: str) -> dict[str, str]:
        state = {"POINTIT_STATE": str(self.path / f"state-{host.name}")}
        return {**self.rates, **state} | (
            {"POINTIT_CREDENTIALS": str(self.folder / "identities" / name)} if name else {}
        )

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
def running(path: Path, rates: Mapping[str, str] = MappingProxyType({})) -> Generator[Plant]:
    """Yield the two hosts with everything that runs there; skip the test where there can be no network."""
    network_or_skip()
    (path / "printed").mkdir()
    commands = Commands(path / "printed")
    with network() as wire:
        try:
            plant = Plant(wire, commands, path, rates)
            asyncio.run(plant.begin())
            yield plant
        finally:
            commands.kill_all()


def _memory_mb(command: Command) -> float:
    return float(sum(process.memory_info().rss for process in command.family()) / 1e6)
