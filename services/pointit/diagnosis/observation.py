"""What was seen of a running site, and what can be found wrong with it."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from pointit.diagnosis.writers import instance_of
from pointit.schemas import Deployment, Health

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
    denied: str = ""
    """Why this identity sees nobody, in a sentence; empty when it may look on, or nobody knows."""

    @property
    def expected(self) -> dict[str, str]:
        """Return the instances that should run, each with what starts it again."""
        return {
            instance_of(service.service, service.user): (
                f"start it again: {shlex.join(service.command)}"
                if service.command
                else f"it runs inside the process that started {deployment.name}: start that again"
            )
            for deployment in self.deployments.values()
            for service in deployment.services
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
        """Return whether nothing was heard of `instance` for too long."""
        return self.silence_s(instance) > SILENT_S
