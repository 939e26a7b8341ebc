"""A process that follows all states of the site, as the page and `pointit doctor` do."""

import asyncio
import time
from collections import deque

from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import DiagnosisReport, Finding, Observation
from pointit.schemas import Health, topics
from pointit.schemas.topics import Delivery
from pointit.site.following import follow_site
from pointit.site.site_state import Change, SiteState
from tests.simulation.kernel.process import Process
from tests.simulation.network.simulated_bus import SimulatedBus
from tests.simulation.world.world import World

STATES = tuple(topic for topic in topics.TOPICS if topic.delivery is Delivery.STATE)
KEPT_REPORTS = 4
IGNORED_CODES = ("slow", "starved")
"""Findings about the speed of the machine, which does not pass virtual time."""


class Onlooker:
    """Follows a site from a unit of its own."""

    def __init__(self, world: World, name: str, host: str) -> None:
        """Add the unit `name` on the machine `host`."""
        self.state = SiteState()
        self._timeline = world.simulation
        self._host = host
        self._reports: dict[str, deque[DiagnosisReport]] = {}
        self._shards: set[str] = set()
        self._began_s = 0.0
        world.add_unit(name, world.host(host), self._run)

    async def _run(self, _process: Process, bus: SimulatedBus) -> None:
        self._reports = {}
        self._shards = set()
        self._began_s = self._timeline.now_s
        self.state = SiteState(self._on_change)
        follow_site(self.state, bus, lambda: self._timeline.now_s, (*STATES, topics.HEALTH))
        bus.watch(topics.SHARD_ALIVE, self._on_shard)
        await asyncio.Event().wait()

    def _on_shard(self, name: str, *, present: bool) -> None:
        if present:
            self._shards.add(name)
        else:
            self._shards.discard(name)

    def _on_change(self, change: Change) -> None:
        if isinstance(change.message, Health):
            report = DiagnosisReport(
                received_s=self._timeline.now_s, health=change.message, arrived_ns=time.time_ns()
            )
            self._reports.setdefault(change.name, deque(maxlen=KEPT_REPORTS)).append(report)

    def findings(self) -> list[Finding]:
        """Return the findings of `pointit doctor` now, without notes."""
        state = self.state
        seen = Observation(
            began_s=self._began_s,
            now_s=self._timeline.now_s,
            present=state.services,
            left=state.former_services,
            shards=frozenset(self._shards),
            reports={name: tuple(reports) for name, reports in self._reports.items()},
            deployments=dict(state.all(topics.DEPLOYMENT)),
            interactions=dict(state.all(topics.INTERACTION)),
            host=self._host,
            now_ns=time.time_ns(),
            is_patient=False,
        )
        findings: list[Finding] = []
        for finding in diagnose(seen):
            if finding.severity != "note" and finding.code not in IGNORED_CODES:
                findings.append(finding)
        return findings
