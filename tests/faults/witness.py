"""An observer of everything on a secured site, which counts losses."""

import asyncio
import contextlib
import itertools
import socket
import time
from collections import defaultdict
from collections.abc import AsyncGenerator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import DiagnosisReport, Finding, Observation
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, Deployment, Health, ImuSample, Message, Selection, SelectionEvent
from pointit.schemas.topics import CURSOR, DEPLOYMENT, HEALTH, IMU, SELECTION, SELECTION_EVENTS, SERVICE_ALIVE
from tests.faults.site import FLOWS_S, INSTANCES, NOTICED_S, PEOPLE, START_S, Site
from tests.integration.access.secured import link_of
from tests.support.bench import until
from tests.support.commands import Onlooker

SELECTORS = ("selected", "deselected", "refused")
"""Events of the selector. The conveyor writes the others, and `refused` without a cause."""


@dataclass
class Witness(Onlooker):
    events: list[SelectionEvent] = field(default_factory=list[SelectionEvent])
    selections: list[Selection] = field(default_factory=list[Selection])
    samples: dict[str, list[ImuSample]] = field(default_factory=lambda: defaultdict(list))
    """By user."""
    arrivals: list[tuple[str, int, int]] = field(default_factory=list[tuple[str, int, int]])
    """Cursors: user, stamp, and arrival, both Unix ns."""

    reports: dict[str, list[DiagnosisReport]] = field(default_factory=lambda: defaultdict(list))
    deployments: dict[str, Deployment] = field(default_factory=dict[str, Deployment])
    ever: set[str] = field(default_factory=set[str])
    """Instances that are or were present."""
    began_s: float = field(default_factory=time.monotonic)
    _first: int = 1
    """Number of the selector's first event that counts."""

    def look(self) -> None:
        super().look()
        self.bus.subscribe(SELECTION_EVENTS, lambda message, _name: self.events.append(message))
        self.bus.subscribe(SELECTION, lambda message, _name: self.selections.append(message))
        self.bus.subscribe(IMU, lambda message, user: self.samples[user].append(message))
        self.bus.subscribe(CURSOR, self._on_cursor)
        self.bus.subscribe(HEALTH, self._on_report)
        self.bus.subscribe(DEPLOYMENT, self._on_deployment)
        self.bus.watch(SERVICE_ALIVE, lambda instance, **_: self.ever.add(instance))

    def _on_report(self, health: Health, instance: str) -> None:
        report = DiagnosisReport(received_s=time.monotonic(), health=health, arrived_ns=time.time_ns())
        self.reports[instance] = [*self.reports[instance][-1:], report]

    def _on_deployment(self, deployment: Deployment, name: str) -> None:
        self.deployments[name] = deployment

    def findings(self, instance: str = "") -> list[Finding]:
        """Return the findings that doctor would have after observing as long: of one service, or of all.

        Without notes of the past, and of a slow machine.
        """
        seen = Observation(
            began_s=self.began_s, now_s=time.monotonic(), present=frozenset(self.present),
            left=frozenset(self.ever - self.present), reports=self.reports, deployments=self.deployments,
            host=socket.gethostname(),
        )  # fmt: skip
        found = [each for each in diagnose(seen) if each.severity != "note" and each.code != "slow"]
        return [finding for finding in found if not instance or finding.service == instance]

    async def finds(self, instance: str, *codes: str) -> Finding:
        """Wait until doctor would find one of `codes` of a service."""

        def found() -> list[Finding]:
            return [finding for finding in self.findings(instance) if finding.code in codes]

        await until(lambda: bool(found()), NOTICED_S, f"{codes} of {instance}; there is {self.findings()}")
        return found()[0]

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        self.arrivals.append((user, cursor.stamp_ns, time.time_ns()))

    @property
    def selected(self) -> dict[str, str]:
        return {thing.id: thing.user for thing in self.selections[-1].objects} if self.selections else {}

    async def begins(self, site: Site) -> None:
        """Wait until all is there and flows; events count from now on."""
        await self.all_report()
        await self.flows()
        await until(lambda: not self._journal_fails, FLOWS_S, "the journal to be in order")
        self._first = max((seq for seq, _, _ in site.told()), default=0) + 1

    @property
    def _journal_fails(self) -> bool:
        return any("cannot be written" in warning for warning in self.health["selector"].warnings)

    def told(self) -> list[tuple[int, str, str]]:
        """Return number, object and event of the published selections, each once, in order."""
        mine = [event for event in self.events if event.event in SELECTORS]
        return sorted({(e.seq, e.object_id, e.event) for e in mine if e.seq >= self._first})

    def processes(self) -> dict[str, tuple[int, float]]:
        """Return the process of each service, and for how long it has run, s."""
        return {instance: (health.pid, health.uptime_s) for instance, health in self.health.items()}

    def is_undisturbed(self, before: Mapping[str, tuple[int, float]], but: str = "") -> None:
        """Fail unless all but one (`but`) are the same `processes` as before, and have not restarted."""
        for instance, (pid, uptime_s) in before.items():
            if instance != but:
                assert self.health[instance].pid == pid, instance
                assert self.health[instance].uptime_s >= uptime_s, instance

    async def keeps(self, selected: Iterable[str]) -> None:
        """Wait until the `selected` still are, except those that have left or were deselected.

        What was published while a link was down is recovered in another order than it was published in.
        """

        def lost() -> set[str]:
            there = {thing.id for thing in self.objects[-1].objects}
            gone = {
                event.object_id
                for event in self.events
                if event.event in ("left", "dispatched", "deselected")
            }
            return (set(selected) & there) - gone - set(self.selected)

        await until(lambda: not lost(), FLOWS_S, "the selections to survive")

    async def agrees(self, site: Site) -> None:
        """Wait until the events seen since the beginning are those published by the selector's journal."""
        kept = [record for record in site.told() if record[0] >= self._first]
        assert [seq for seq, _, _ in kept] == list(range(self._first, self._first + len(kept))), kept
        await until(lambda: self.told()[: len(kept)] == kept, FLOWS_S, f"{kept}, not {self.told()}")

        def missing() -> set[int]:
            dispatches = {event.seq for event in self.events if event.event in ("left", "dispatched")}
            return set(range(min(dispatches, default=0), max(dispatches, default=0))) - dispatches

        await until(lambda: not missing(), FLOWS_S, "the conveyor's events without a gap")

    async def all_report(self, instances: Sequence[str] = INSTANCES) -> None:
        await until(lambda: set(instances) <= set(self.health), START_S, f"more than {set(self.health)}")

    async def flows(self, *users: str) -> None:
        """Wait for a frame, objects and cursors of `users`, or everybody, that were captured from now on."""
        now_ns = time.time_ns()

        def all_came() -> bool:
            newest: list[Sequence[Message]] = [self.frames, self.objects]
            newest += [self.cursors[user] for user in users or PEOPLE]
            return all(messages and messages[-1].stamp_ns >= now_ns for messages in newest)

        await until(all_came, FLOWS_S, f"frames, objects and cursors of {list(users or PEOPLE)}")

    async def sees_more_selected(self, patience_s: float = 60.0) -> None:
        """Wait until an object is selected that is not now. Selected ones leave meanwhile."""
        now = set(self.selected)
        await until(lambda: bool(set(self.selected) - now), patience_s, f"more than {now} to be selected")

    async def sees_selected(self, count: int, patience_s: float = 60.0) -> None:
        """Wait until `count` objects are selected."""
        await until(lambda: len(self.selected) >= count, patience_s, f"{count} to be selected")

    def lost(self, since_ns: int, but: str = "") -> tuple[int, int]:
        """Return the number of samples since then without a received cursor, and the number of all.

        Without the person `but`, whose clock is wrong.
        """
        count = answered = 0
        for user, samples in self.samples.items():
            if user == but:
                continue
            newest_ns = max((cursor.stamp_ns for cursor in self.cursors[user]), default=0)
            window = [sample for sample in samples if since_ns <= sample.stamp_ns <= newest_ns]
            steps = (after.seq - before.seq for before, after in itertools.pairwise(window))
            count += sum(step if step > 0 else 1 for step in steps)  # else the sender was restarted
            count += bool(window)
            answered += len({c.stamp_ns for c in self.cursors[user] if since_ns <= c.stamp_ns <= newest_ns})
        return max(0, count - answered), count

    def lost_in_words(self, since_ns: int, but: str = "") -> str:
        """Return the table's text on losses. `agrees` asserts that no event was lost."""
        lost, count = self.lost(since_ns, but)
        events = sum(seq >= self._first for seq, _, _ in self.told())
        return f"{lost} of {count} cursors; none of {events} selection events"

    def stale(self, since_ns: int, old_s: float = 0.5) -> int:
        """Return the number of cursors since then that were older than `old_s` at that time."""
        oldest_ns = since_ns - round(old_s * 1e9)
        return sum(stamp_ns < oldest_ns for _, stamp_ns, came_ns in self.arrivals if came_ns >= since_ns)


@contextlib.asynccontextmanager
async def witness(site: Site) -> AsyncGenerator[Witness]:
    """Yield an observer of the site from now on, which is started if it is not running."""
    await site.begin()
    async with asyncio.timeout(START_S):
        bus = await ZenohBus.open(link_of(site.folder, "supervisor"), patience_s=START_S)
    seen = Witness(bus)
    seen.look()
    try:
        yield seen
    finally:
        await bus.close()
