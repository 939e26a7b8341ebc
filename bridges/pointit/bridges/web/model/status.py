"""Status of the site for the page: services, their uptime, findings and remedies; pure."""

import math
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from pointit.bridges.web.wire import FindingLine, PersonLine, ServiceLine, Status
from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import DiagnosisReport, Finding, Observation, expected_services
from pointit.runtime.link.outage import SILENT_S
from pointit.schemas import Deployment, Health

WINDOW_S = 10.0
"""Window of reports, s: counters that grew in it are growing now."""

LEFT_S = 60.0
"""A service that left this long ago (s) and is not expected is no longer listed."""

GRACE_S = 2.0
"""An expected service may be absent this long (s) before it counts as missing: it may be starting."""

SETTLE_S = 2.0
"""Time (s) that services of the previous scenario have to leave after another one has begun."""

ENDING_S = 30.0
"""Time (s) that services of a run have to leave after its end."""

STARTING_S = 15.0
"""Services that another scenario expects may be absent or silent this long (s) after it has begun."""

MAX_LINES = 256
"""Maximum number of findings, or services, sent to a page."""


class SiteObservation:
    """Observations of the site's services; times are seconds of any monotonic clock."""

    def __init__(self, now_s: float) -> None:
        self._began_s = now_s
        self._since_s: dict[str, float] = {}
        """Start of presence, by present service."""
        self._left_s: dict[str, float] = {}
        """Time of leaving, by service that has left."""
        self._missed_s: dict[str, float] = {}
        """Time of the first expectation, by expected service that was never present."""
        self._reports: dict[str, deque[DiagnosisReport]] = {}
        self._began_run_s = -math.inf
        """Start of the scenario that runs, if another one ran before."""
        self._settled_s = -math.inf
        """Until then services may leave: their run has ended, or another scenario has replaced theirs."""
        self._is_over = False
        """The last run has ended on purpose."""
        self.home_things: tuple[str, ...] = ()
        """Things of the map that are entities of a Home Assistant."""

    @property
    def present(self) -> frozenset[str]:
        """Return the services that are present."""
        return frozenset(self._since_s)

    def set_present(self, instance: str, present: bool, now_s: float) -> None:  # noqa: FBT001 - the bus's signature
        """Update the presence of `instance`."""
        if present:
            self._since_s.setdefault(instance, now_s)
            self._left_s.pop(instance, None)
            self._missed_s.pop(instance, None)
        elif self._since_s.pop(instance, None) is not None:
            if now_s >= self._settled_s:
                self._left_s[instance] = now_s
            self._reports.pop(instance, None)

    def end_run(self, now_s: float) -> None:
        """Note that the run has ended on purpose: services that leave from now on are not missing."""
        self._is_over, self._settled_s = True, now_s + ENDING_S

    def begin_run(self, now_s: float) -> None:
        """Note that another scenario has begun: services of the previous one are not missing."""
        self._is_over, self._began_run_s, self._settled_s = False, now_s, now_s + SETTLE_S
        self._left_s.clear()
        self._missed_s.clear()

    def report(self, instance: str, health: Health, now_s: float) -> None:
        """Store the report of `instance` if it is present."""
        if instance not in self._since_s:
            return
        reports = self._reports.setdefault(instance, deque())
        reports.append(DiagnosisReport(received_s=now_s, health=health))
        while now_s - reports[0].received_s > WINDOW_S:
            reports.popleft()

    def status(
        self,
        deployments: Mapping[str, Deployment],
        people: Sequence[PersonLine],
        now_s: float,
        *,
        viewers: int = 0,
        lan_url: str = "",
        speed: float = 1.0,
        now_ns: int | None = None,
    ) -> Status:
        """Return the status of the site now, at `now_ns` of the wall clock, Unix ns, if that is known."""
        self._forget_left(expected_services(deployments), now_s)
        seen = replace(self._seen(deployments, now_s, speed), now_ns=now_ns)
        is_starting = bool(self._missed_s) and now_s < self._began_run_s + STARTING_S
        return Status(
            run="over" if self._is_over and not deployments else "starts" if is_starting else "runs",
            services=tuple(self._services(seen))[:MAX_LINES],
            findings=tuple(
                FindingLine.model_validate(finding, from_attributes=True)
                for finding in diagnose(seen, lambda finding: self._is_sure(finding, now_s))
            )[:MAX_LINES],
            people=tuple(people),
            viewers=viewers,
            lan_url=lan_url,
        )

    def _seen(self, deployments: Mapping[str, Deployment], now_s: float, speed: float) -> Observation:
        began_s = max(self._began_s, now_s - WINDOW_S)  # older than this observation
        seen = Observation(
            began_s=began_s,
            now_s=now_s,
            present=self.present,
            left=frozenset(self._left_s),
            reports={name: tuple(reports) for name, reports in self._reports.items() if reports},
            deployments=deployments,
            home_things=self.home_things,
            speed=speed,
        )
        missing = seen.expected.keys() - seen.present - self._left_s.keys()
        self._missed_s = {name: self._missed_s.get(name, now_s) for name in missing}
        return seen

    def _forget_left(self, expected: Collection[str], now_s: float) -> None:
        for name in [
            n for n, left_s in self._left_s.items() if left_s < now_s - LEFT_S and n not in expected
        ]:
            del self._left_s[name]

    def _services(self, seen: Observation) -> list[ServiceLine]:
        since_s = {**self._missed_s, **self._left_s, **self._since_s}
        return [
            ServiceLine(instance=name, present=name in seen.present, since_s=max(0.0, seen.now_s - at_s))
            for name, at_s in sorted(since_s.items())
        ]

    def _is_sure(self, finding: Finding, now_s: float) -> bool:
        name = finding.service
        is_starting = name not in self._left_s and now_s < self._began_run_s + STARTING_S
        if finding.code in {"absent", "silent", "stale"} and is_starting:
            return False
        if finding.code == "no-bridge":
            return now_s >= max(self._began_s + GRACE_S, self._began_run_s + STARTING_S)
        if finding.code == "absent":
            return now_s - self._left_s.get(name, self._missed_s.get(name, now_s)) >= GRACE_S
        if finding.code == "silent":
            return now_s - self._since_s.get(name, now_s) > SILENT_S
        return finding.code != "empty" or not self._is_over
