"""The view of a site at its router's host: cursors and their delays, findings of doctor."""

import itertools
import math
import os
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import Finding, Observation, Report
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, Deployment, Health, SelectionEvent
from pointit.schemas.topics import CURSOR, DEPLOYMENT, HEALTH, SELECTION_EVENTS, SERVICE_ALIVE
from tests.support.bench import until

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
    _reports: dict[str, list[Report]] = field(default_factory=lambda: defaultdict(list))
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
            began_s=max(self._began_s, now_s - REPORTS_S),
            now_s=now_s,
            present=frozenset(self._present),
            left=frozenset(self._ever - self._present),
            reports=lately,
            deployments=self._deployments,
            host=os.uname().nodename,
        )
        return [finding for finding in diagnose(seen) if finding.severity != "note"]

    def ages_s(self, user: str, since_s: float = 0.0, until_s: float = math.inf) -> list[float]:
        return [
            each.age_s for each in self.cursors if each.user == user and since_s <= each.came_s <= until_s
        ]

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
            Report(received_s=time.monotonic(), health=health, arrived_ns=time.time_ns())
        )

    def _on_deployment(self, deployment: Deployment, name: str) -> None:
        self._deployments[name] = deployment

    def _on_presence(self, instance: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        (self._present.add if present else self._present.discard)(instance)
        self._ever.add(instance)


def told(event: SelectionEvent) -> str:
    return f"{event.seq} {event.event} {event.object_id} {event.user}"


def quantile_s(values_s: Sequence[float], share: float) -> float:
    ordered = sorted(values_s)
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)]
