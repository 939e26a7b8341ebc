"""Observation of a running site, and the type of its findings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from pointit.diagnosis.writers import start_command
from pointit.runtime.link.outage import SILENT_S
from pointit.schemas import Deployment, ExpectedService, Health
from pointit.schemas.system import RUN
from pointit.schemas.table_types import NAME

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


@dataclass(frozen=True)
class Finding:
    """One problem, or (a note) a former problem."""

    severity: Severity
    code: Code
    service: str
    """Instance with the problem. `""` for the whole site."""
    sentence: str
    remedy: str
    follows: bool = False
    """It follows from another finding: the outage of the whole site, or a slow service before this one."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """A health message and its time of arrival."""

    received_s: float
    health: Health
    arrived_ns: int | None = None
    """Time of arrival by this machine's clock, Unix ns."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """Observation of a site from `began_s` to `now_s` (any monotonic clock)."""

    began_s: float
    now_s: float
    present: frozenset[str] = frozenset()
    left: frozenset[str] = frozenset()
    """Instances that were present and are no longer."""
    shards: frozenset[str] | None = None
    """People whom shards serve, as `SHARD_ALIVE` names them. None if that was not observed."""
    reports: Mapping[str, Sequence[Report]] = field(default_factory=dict[str, Sequence[Report]])
    """Reports by instance, oldest first."""
    deployments: Mapping[str, Deployment] = field(default_factory=dict[str, Deployment])
    host: str = ""
    """Host name of the observer's machine."""
    speed: float = 1.0
    """Speed of the site's clock: rates of slow simulations are slow."""
    other_sites: tuple[str, ...] = ()
    """Names of other sites at the same address, if this one is empty."""
    denied: str = ""
    """Reason for which this identity may not view the site, or `""`."""
    options: str = ""
    """Options by which a command reaches this site from here, ` --site hall`. `""` if the defaults do."""

    @property
    def expected(self) -> dict[str, str]:
        """Return `expected_services` of the deployments."""
        return expected_services(self.deployments, self.options)

    def newest(self, instance: str) -> Health | None:
        """Return the last report of `instance`, or None."""
        reports = self.reports.get(instance)
        return reports[-1].health if reports else None

    def silence_s(self, instance: str) -> float:
        """Return the time since the last report of `instance`, s."""
        reports = self.reports.get(instance)
        return self.now_s - (reports[-1].received_s if reports else self.began_s)

    def is_silent(self, instance: str) -> bool:
        """Return True if `instance` has not reported for too long."""
        return self.silence_s(instance) > SILENT_S


def expected_services(deployments: Mapping[str, Deployment], options: str = "") -> dict[str, str]:
    """Return the instances that should run, each with the remedy that starts it again.

    Commands in deployments are never shown, since others have written them, and operators copy.

    Args:
        deployments: by name.
        options: see `Observation.options`.
    """
    return {
        instance: _again(service, name.removeprefix(RUN), options)
        for name, deployment in deployments.items()
        for service in deployment.believed(name).services
        if NAME.match(instance := service.instance)
    }


def _again(service: ExpectedService, started_by: str, options: str) -> str:
    """Return the remedy that restarts `service` of `started_by`. `options` reach the site."""
    if not service.command:
        return f"it runs inside the process that started {started_by}: start that again"
    command = start_command(service.service, service.user or service.name)
    settings = f"the log of what started {started_by} has the command with its settings"
    return f"start it again: {command}{options} ({settings})" if command else f"start it again: {settings}"
