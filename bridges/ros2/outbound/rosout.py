"""Findings of a health report as lines of ROS's log, when they begin and when they end."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import DiagnosisReport, Observation
from pointit.schemas import Health

Line = tuple[int, str]
"""Level and text."""
Identity = tuple[str, ...]
"""That of a finding."""

INFO = 20
"""Levels of rcl_interfaces/Log, from here."""
WARN = 30
ERROR = 40
LEVELS = {"warning": WARN, "error": ERROR}
"""By a finding's severity. Notes are about the past and not sent."""

OVER_REPORTS = 5
"""Reports in a row without a finding before it counts as over. A flapping finding is logged once."""
MAX_AT_ONCE = 16
"""Maximum burst of lines of one service; further ones are delayed."""
REPORTS_PER_LINE = 5
"""Reports until a further line of a service may be sent."""
MAX_REPORTS = 64
"""Maximum number of findings of one service that are not over; others wait."""

LONG_S = 1e9
"""Observation time for `diagnose`: a restarted service does not run twice."""


@dataclass(slots=True)
class _Report:
    """A finding that was sent and is not over."""

    level: int
    text: str
    """As last worded."""
    missed: int = 0
    """Reports in a row without it."""


@dataclass(slots=True)
class _Service:
    """Findings of one service."""

    name: str
    """Instance name, by the key of its reports."""
    spent: int = 0
    """Reports until the full burst is available again."""
    last: Health | None = None
    reports: dict[Identity, _Report] = field(default_factory=dict[Identity, _Report])

    def hear(self, health: Health) -> Iterator[Line]:
        """Yield lines about findings that are over or new by this report."""
        self.spent = max(self.spent - 1, 0)
        current = _findings(self.name, health, self.last)
        self.last = health

        # Ended findings first: they make room for new ones
        for identity, report in list(self.reports.items()):
            line = current.get(identity)
            if line is not None:
                report.missed = 0
                report.text = line[1]
                continue
            report.missed += 1
            if report.missed >= OVER_REPORTS and self._spend_line():
                del self.reports[identity]
                yield INFO, f"over: {report.text}"

        # A known finding is logged again if it has got worse
        for identity, (level, text) in current.items():
            report = self.reports.get(identity)
            is_due = len(self.reports) < MAX_REPORTS if report is None else level > report.level
            if is_due and self._spend_line():
                self.reports[identity] = _Report(level, text)
                yield level, text

    def _spend_line(self) -> bool:
        """Return True, and count the line, if one more may be sent."""
        if self.spent > (MAX_AT_ONCE - 1) * REPORTS_PER_LINE:
            return False
        self.spent += REPORTS_PER_LINE
        return True


class Rosout:
    """Reports new and ended findings of each service once."""

    def __init__(self) -> None:
        self._services: dict[str, _Service] = {}
        self._gone: dict[str, int] = {}
        """Spent bursts of services that are gone: a crash loop gets no new burst."""

    def __call__(self, health: Health, context: ConversionContext) -> Converted:
        """Return the log lines of one service's report, none while nothing changes."""
        service = self._services.get(context.name)
        if service is None:
            spent = self._gone.pop(context.name, 0)
            service = _Service(context.name, spent)
            self._services[context.name] = service
        types = context.state.types
        stamp = values.time(types, context.stamp_ns)
        name = values.text(f"pointit.{context.name}")
        logs: list[Any] = []
        for level, line in service.hear(health):
            text = values.text(line)
            log = types.make("rcl_interfaces/msg/Log", stamp=stamp, level=level, name=name, msg=text)
            logs.append(log)
        return tuple(logs)

    def forget(self, instance: str) -> None:
        """Forget the findings of a service that is gone."""
        service = self._services.pop(instance, None)
        if service is not None and service.spent:
            self._gone[instance] = service.spent

    def begin(self) -> None:
        """Reset: to the first reader all present findings are new."""
        self._services.clear()
        self._gone.clear()


def _findings(name: str, health: Health, previous: Health | None) -> dict[Identity, Line]:
    """Return the line of each finding of `name` by a report and the `previous` one."""
    reports = [DiagnosisReport(received_s=LONG_S, health=health)]
    if previous is not None:
        is_same_process = (previous.host, previous.pid) == (health.host, health.pid)
        if is_same_process:  # figures of another process say nothing about this one
            reports.insert(0, DiagnosisReport(received_s=LONG_S, health=previous))
    observation = Observation(began_s=0.0, now_s=LONG_S, present=frozenset({name}), reports={name: reports})
    lines: dict[Identity, Line] = {}
    for finding in diagnose(observation):  # the worst first
        if finding.service != name or finding.severity not in LEVELS:
            continue
        text = finding.sentence
        if finding.remedy:
            text = f"{text}; {finding.remedy}"
        lines.setdefault(finding.identity, (LEVELS[finding.severity], values.text(text)))
    return lines
