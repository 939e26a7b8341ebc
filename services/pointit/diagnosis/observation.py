"""What was seen of a running site, and what can be found wrong with it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from pointit.diagnosis.writers import instance_of, start_command
from pointit.schemas import Deployment, ExpectedService, Health
from pointit.schemas.system import RUN
from pointit.schemas.table_types import NAME

SILENT_S = 3.0
"""Present, but without a report for so long: stopped, or too busy to report."""

Severity = Literal["error", "warning", "note"]
Code = Literal[
    "unreachable",
    "empty",
    "denied",
    "absent",
    "left",
    "silent",
    "twice",
    "stale",
    "failing",
    "failed",
    "warning",
    "degraded",
    "slow",
    "clock",
    "unsure",
    "old-anchor",
]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that is wrong, or (a note) was wrong once."""

    severity: Severity
    code: Code
    service: str
    """The instance it is about; empty for the whole site."""
    sentence: str
    remedy: str


@dataclass(frozen=True, kw_only=True)
class Report:
    """A health message and when it came."""

    received_s: float
    health: Health
    arrived_ns: int | None = None
    """The same by this machine's clock, Unix ns."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """What was seen of a site from `began_s` to `now_s` (any monotonic clock)."""

    began_s: float
    now_s: float
    present: frozenset[str] = frozenset()
    left: frozenset[str] = frozenset()
    """Instances that were present and are no more."""
    reports: Mapping[str, Sequence[Report]] = field(default_factory=dict[str, Sequence[Report]])
    """By instance, oldest first."""
    deployments: Mapping[str, Deployment] = field(default_factory=dict[str, Deployment])
    host: str = ""
    """Of the machine that looks."""
    speed: float = 1.0
    """Of the site's clock: rates of slow simulations are slow."""
    other_sites: tuple[str, ...] = ()
    """Names of the sites that run at the same address, if nobody is seen on this one."""
    denied: str = ""
    """Why this identity sees nobody, in a sentence; empty when it may look on, or nobody knows."""
    options: str = ""
    """Options by which a command reaches this site from here, ` --site hall`; "" if the defaults do."""

    @property
    def expected(self) -> dict[str, str]:
        """Return the instances that should run, each with what starts it again.

        The commands that deployments hold are never shown: others have written them, and operators copy.
        """
        return {
            instance: _again(service, name.removeprefix(RUN), self.options)
            for name, deployment in self.deployments.items()
            for service in deployment.believed(name).services
            if NAME.match(instance := instance_of(service.service, service.user))
        }

    def newest(self, instance: str) -> Health | None:
        """Return the last report of `instance`."""
        reports = self.reports.get(instance)
        return reports[-1].health if reports else None

    def silence_s(self, instance: str) -> float:
        """Return for how long nothing was heard of `instance`."""
        reports = self.reports.get(instance)
        return self.now_s - (reports[-1].received_s if reports else self.began_s)

    def is_silent(self, instance: str) -> bool:
        """Return True if nothing was heard of `instance` for too long."""
        return self.silence_s(instance) > SILENT_S


def _again(service: ExpectedService, started_by: str, options: str) -> str:
    """Return what starts `service` again, which `started_by` has started; `options` reach the site."""
    if not service.command:
        return f"it runs inside the process that started {started_by}: start that again"
    command = start_command(service.service, service.user)
    settings = f"the log of what started {started_by} has the command with its settings"
    return f"start it again: {command}{options} ({settings})" if command else f"start it again: {settings}"
