"""Observation of a running site, its stopped processes and present writers, and the type of its findings."""

import contextlib
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal, NamedTuple

from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.bus.timeliness import LONGEST_HOST
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.runtime.host.advised_commands import ROUTER, AdvisedCommands, advised_commands
from pointit.runtime.link.link import SILENT_S
from pointit.schemas import NS_PER_S, Deployment, ExpectedService, Health, Interaction
from pointit.schemas.problems import OTHER
from pointit.schemas.system import RUN, instance_of, split_instance
from pointit.schemas.table_types import NAME
from pointit.schemas.text import one_line
from pointit.schemas.topics import ANY
from pointit.services.registry import person_of, present_writers, row_of

Severity = Literal["error", "warning", "note"]
"""Severity of a finding:

- error: something that the site needs does not work. A person cannot point, select or see the light, data is
  lost, or a device is not there while others wait for it.
- warning: it works worse, or not for long, or one service alone says so: late, uncertain, a battery.
- note: it is over, or nobody uses it yet. A site with notes only is healthy.

What follows from a finding is listed under it. What one person's services say is about that person only.
"""
Code = Literal[
    "unreachable",
    "empty",
    "denied",
    "absent",
    "left",
    "silent",
    "stopped",
    "starved",
    "no-cursor",
    "no-bridge",
    "twice",
    "stale",
    "failing",
    "failed",
    "warning",
    "idle",
    "degraded",
    "slow",
    "clock",
    "disk",
    "unsure",
    "old-anchor",
]

SHARED_CONTAINERS = ("keeper", "pui", "selector", "led-driver", "conveyor-sim", "web")
"""Services of `deploy/compose.yaml` with a container of their own, which has their name."""
PROGRAM = re.compile(r"(?:.*/)?pointit(?:\.exe)?|pointit\.services")
"""Name of the program or module by which a process is one of PointIt."""
CONTINUE = "continue it: `kill -CONT {pid}`, or `fg` in its terminal"
"""Remedy of a stopped process."""
STOPPED = ("T", "t")
"""States of a process that was stopped by a signal, or by a debugger."""

STARTING_S = 10.0
"""Time after the start of a service within which others of its process may be missing, s."""
LOADING_S = 30.0
"""Time after the start of a process within which others that begin with it may be missing, s."""
BUSY_START_S = 5.0
"""Time after its start in which a process may be busy, s: others are loading modules beside it."""
FIRST_S = 120.0
"""Time after the publication of a deployment within which none of its processes need have reported, s.

Python loads them all at once, which takes a busy machine a minute and more.
"""


def is_bridge(instance: str) -> bool:
    """Return True if an instance is a bridge to a foreign system."""
    row = row_of(split_instance(instance)[0])
    return row is not None and row.room == "bridges"


def start_command(service: str, which: str = "") -> str:
    """Return the command that starts `service`, or `""` if the process table has none of that scope.

    Names come from other machines. Only a name of the table and a name that is valid in a key become part of
    a command. `which`: whose it is, or its name among several.
    """
    row = row_of(service)
    if row is None:
        return ""
    needs_name = row.scope == "user"
    if needs_name != bool(which) and not row.several:
        return ""
    command = f"pointit service run {service}"
    if not which:
        return command
    if not NAME.match(which) or which.startswith("."):
        return ""
    option = "--user" if needs_name else "--name"
    people = "" if row.shard_serves is None else " --people [...]"
    return f"{command} {option} {which}{people}"


def is_router(instance: str) -> bool:
    """Return True if `instance` is a router's account of itself."""
    service, _, _ = instance.partition(".")
    kind, _, _ = service.partition("-")
    return kind == "router"


def container_of(instance: str) -> str:
    """Return the container of `instance` in the compose files, without the site's name, or `""`.

    All services of a person are in one container, called after the person.
    """
    if is_router(instance):
        return ROUTER
    service, name = split_instance(instance)
    user = person_of(instance)
    if not user:
        is_shared = service in SHARED_CONTAINERS and not name
        return service if is_shared else ""
    is_name = NAME.match(user) and not user.startswith(".")
    return user if is_name else ""


def restart_remedy(instance: str, options: str, commands: AdvisedCommands) -> str:
    """Return the remedy that starts `instance`, if it should run at all.

    Args:
        instance: any instance name, also of other machines.
        options: those by which a command joins the site.
        commands: as the reader types them.
    """
    if commands.containers:
        container = container_of(instance)
        if not container:
            return "if it should run, start it where it ran"
        return f"if it should run: {commands.restart([container])}"
    if is_router(instance):
        return "if it should run: `pointit router --site-folder FOLDER`"
    command = start_command(*split_instance(instance))
    if not command:
        return "if it should run, start it where it ran"
    return f"if it should run: `{command}{options}`"


def silence_reason(topic: AnyTopic, name: str, present: Collection[str]) -> str:
    """Return a clause on the writers of `topic` at `name`, whether they run, and the remedy."""
    writers = present_writers(topic, name, present)
    if writers:
        doctor = advised_commands().command("pointit doctor")
        return f"{', '.join(writers)} can write it and runs; does {doctor} find something wrong?"
    row = row_of(topic.writers[0])  # the first is the usual one
    if row is None:
        return f"it is written by {' or '.join(topic.writers)}"

    user = ""
    if topic.placeholder == "user" and name != ANY:
        user = name
    command = f"pointit service run {row.name}"
    if row.scope == "user":
        command += f" --user {user or 'NAME'}"
    advice = f"start it with `{command}`"
    commands = advised_commands()
    if commands.containers:
        container = container_of(instance_of(row.name, user))
        advice = f"start it with {commands.restart([container])}" if container else "start it where it ran"

    # A misspelt name is more probable than a service that nobody has started
    people = set(map(person_of, present))
    suggestion = did_you_mean(user, people - {user, ""})
    if suggestion:
        advice = f"{suggestion[:-1]}, or {advice}?"
    return f"no writer is present ({' or '.join(topic.writers)}); {advice}"


@dataclass(frozen=True)
class StoppedProcess:
    """A process that a signal has stopped, for example SIGSTOP or Ctrl-Z."""

    pid: int
    arguments: tuple[str, ...]
    """Command line from the program's name or module on: `pointit`, `person`, `add`, `anna`."""

    @property
    def may_route(self) -> bool:
        """Return True if other processes may connect to it."""
        return self.arguments[1:2] in (("run",), ("router",))

    def may_run(self, instance: str, deployment: str = "") -> bool:
        """Return True if it runs `instance`, which belongs to `deployment` (`""`: that is unknown)."""
        program, *rest = self.arguments
        if program == "pointit.services":
            rest = ["service", "run", *rest]
        words = [word for word in rest if not word.startswith("-")]
        name = "".join(words[2:3])
        if rest[:2] == ["service", "run"]:
            which = self._option("--user") or self._option("--name")
            return instance == instance_of(name, which)
        if rest[:2] == ["person", "add"]:
            return name in (instance.partition(".")[2], deployment)
        if rest[:1] == ["router"]:
            return instance.partition("-")[0] == "router"
        if rest[:1] == ["run"]:
            return deployment.startswith("run.") or not deployment
        return False

    def is_of(self, site: str, addresses: Sequence[str]) -> bool:
        """Return True unless its command line names another site or address."""
        if self._option("--site") not in ("", site):
            return False
        endpoints = {self._option("--connect"), self._option("--listen")} - {""}
        return not endpoints or not endpoints.isdisjoint(addresses)

    def _option(self, name: str) -> str:
        for word, following in zip(self.arguments, (*self.arguments[1:], ""), strict=True):
            if word == name:
                return following
            if word.startswith(f"{name}="):
                return word.partition("=")[2]
        return ""


def stopped_processes(site: str, addresses: Sequence[str]) -> tuple[StoppedProcess, ...]:
    """Return the stopped processes of this machine that may belong to `site` at `addresses`.

    Only Linux tells them, and a container only its own.
    """
    return tuple(process for process in _stopped(Path("/proc")) if process.is_of(site, addresses))


def _stopped(proc: Path) -> Iterator[StoppedProcess]:
    for folder in proc.glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended meanwhile, or is another user's
            # The state follows the name in parentheses, which may contain spaces and parentheses
            stat = (folder / "stat").read_text(errors="replace")
            state = stat.rpartition(")")[2].split()[0]
            if state not in STOPPED:
                continue
            words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")

            # An interpreter and its options may come first
            for position, word in enumerate(words[:6]):
                if PROGRAM.fullmatch(word):
                    yield StoppedProcess(int(folder.name), tuple(words[position:-1]))
                    break


class ReportedProcess(NamedTuple):
    """A process by its services' reports."""

    host: str
    pid: int
    claimant: str = ""
    """Person whose own services alone claim the numbers, or `""`: these may be forged."""

    @property
    def description(self) -> str:
        """Return the process for people."""
        claim = f" ({self.claimant} says)" if self.claimant else ""
        return f"process {self.pid or '?'}{claim}"


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
    """True if another finding is its cause, which is reported instead."""
    topic: str = ""
    """Key of the topic that is late, invalid or lost, or `""`."""
    services: tuple[str, ...] = ()
    """Instances with the problem, if there are several."""
    problem: str = ""
    """Code of the service's problem (`schemas.problems`), or `""`."""
    subject: str = ""
    """Machine, identity, writer or process that it is about, or `""`."""
    said: str = ""
    """The service's own words, without those of the finding around them, or `""`."""

    @property
    def identity(self) -> tuple[str, ...]:
        """Return the key of the finding, without figures that change with time."""
        sentence = self.sentence if self.problem == OTHER else ""
        return (self.code, self.service, self.problem, self.subject, self.topic, sentence)

    @property
    def instances(self) -> tuple[str, ...]:
        """Return the instances with the problem. None if it is the whole site's."""
        if self.services:
            return self.services
        return (self.service,) if self.service else ()


@dataclass(frozen=True, kw_only=True)
class DiagnosisReport:
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
    reports: Mapping[str, Sequence[DiagnosisReport]] = field(
        default_factory=dict[str, Sequence[DiagnosisReport]]
    )
    """Reports by instance, oldest first."""
    deployments: Mapping[str, Deployment] = field(default_factory=dict[str, Deployment])
    interactions: Mapping[str, Interaction] = field(default_factory=dict[str, Interaction])
    """State of each person, with their next step, by user."""
    home_things: tuple[str, ...] = ()
    """Things of the map that are entities of a Home Assistant."""
    host: str = ""
    """Host name of the observer's machine."""
    stopped: tuple[StoppedProcess, ...] = ()
    """Stopped processes of PointIt on the observer's machine."""
    now_ns: int | None = None
    """Time of the observer's clock, Unix ns. None: unknown."""
    is_patient: bool = True
    """False if what is still starting counts as missing, since the observer has waited long enough."""
    speed: float = 1.0
    """Speed of the site's clock: rates of slow simulations are slow."""
    other_sites: tuple[str, ...] = ()
    """Names of other sites at the same address, if this one is empty."""
    denied: str = ""
    """Reason for which this identity may not view the site, or `""`."""
    options: str = ""
    """Options by which a command reaches this site from here, ` --site hall`. `""` if the defaults do."""
    identities: str = ""
    """Folder of the observer's identity and probably of others, if the site is secured, else `""`."""
    commands: AdvisedCommands = field(default_factory=AdvisedCommands)
    """Commands as the reader of the findings types them."""

    @cached_property
    def expected(self) -> dict[str, str]:
        """Return `expected_services` of the deployments."""
        return expected_services(self.deployments, self.options_of, self.commands)

    @cached_property
    def services_of(self) -> dict[str, frozenset[str]]:
        """Return the instances of each deployment, by its name."""
        services: dict[str, frozenset[str]] = {}
        for name, deployment in self.deployments.items():
            services[name] = frozenset(expected_services({name: deployment}))
        return services

    @cached_property
    def starting(self) -> frozenset[str]:
        """Return the instances of deployments that are starting: they may be missing."""
        instances: set[str] = set()
        for name, services in self.services_of.items():
            if self.is_starting(name):
                instances |= services
        return frozenset(instances)

    def credentials_of(self, name: str) -> str:
        """Return the option by which `name` joins a secured site, or `""` if the site is open."""
        return f" --credentials {self.identities}/{name}" if self.identities else ""

    def options_of(self, instance: str) -> str:
        """Return the options of the command that starts `instance` on this site."""
        return self.options + self.credentials_of(person_of(instance) or "supervisor")

    @cached_property
    def processes(self) -> dict[ReportedProcess, list[str]]:
        """Return the instances of each process that reports."""
        processes: dict[ReportedProcess, list[str]] = {}
        for instance in sorted(self.reports):
            if self.newest(instance) is not None:
                processes.setdefault(self.process_of(instance), []).append(instance)
        return processes

    def process_of(self, instance: str) -> ReportedProcess:
        """Return the process in which `instance` says that it runs."""
        # What a run lists is the operator's, so its report is no person's claim
        claimant = person_of(instance)
        for name, services in self.services_of.items():
            if name.startswith(RUN) and instance in services:
                claimant = ""
        health = self.newest(instance)
        if health is None:
            return ReportedProcess("?", 0, claimant)
        host = one_line(health.host, LONGEST_HOST) or "?"
        return ReportedProcess(host, health.pid, claimant)

    def newest(self, instance: str) -> Health | None:
        """Return the last report of `instance`, or None."""
        reports = self.reports.get(instance)
        return reports[-1].health if reports else None

    def period_s(self, instance: str) -> float:
        """Return the mean time between reports of `instance`, s. 0 if it reported once, or has just begun."""
        reports = [report.health for report in self.reports.get(instance, ())]
        if len(reports) < 2:
            return 0.0
        first = reports[0]
        last = reports[-1]
        if first.pid != last.pid or first.uptime_s < BUSY_START_S:
            return 0.0
        # By its own numbers: reports that the network lost count
        count = last.seq - first.seq
        return (last.uptime_s - first.uptime_s) / count if count > 0 else 0.0

    def silence_s(self, instance: str) -> float:
        """Return the time since the last report of `instance`, s."""
        reports = self.reports.get(instance)
        last_s = reports[-1].received_s if reports else self.began_s
        return self.now_s - last_s

    def is_silent(self, instance: str) -> bool:
        """Return True if `instance` has not reported for too long. While it loads, it need not report."""
        is_loading = instance in self.starting and not self.reports.get(instance)
        return self.silence_s(instance) > SILENT_S and not is_loading

    def has_just_begun(self, instance: str, limit_s: float = STARTING_S) -> bool:
        """Return True if `instance` reports and has run for less than `limit_s`."""
        health = self.newest(instance)
        if health is None or instance not in self.present:
            return False
        return health.uptime_s + self.silence_s(instance) < limit_s

    def is_starting(self, deployment: str) -> bool:
        """Return True if services of `deployment` may be missing because it has begun a moment ago."""
        if not self.is_patient:
            return False
        services = self.services_of[deployment]
        published = self.deployments[deployment]
        commands = {service.command for service in published.services}

        # Several commands are processes of their own, and each loads its modules. None of them need have
        # reported for longer still
        start_s = LOADING_S if len(commands) > 1 else STARTING_S
        limit_s = start_s
        if len(commands) > 1 and services.isdisjoint(self.reports):
            limit_s = FIRST_S
        if self.now_ns is not None and 0 <= self.now_ns - published.stamp_ns < limit_s * NS_PER_S:
            return True
        return any(self.has_just_begun(instance, start_s) for instance in services)


def expected_services(
    deployments: Mapping[str, Deployment],
    options_of: Callable[[str], str] = lambda _: "",
    commands: AdvisedCommands | None = None,
) -> dict[str, str]:
    """Return the instances that should run, each with the remedy that starts it again.

    Commands in deployments are never shown, since others have written them, and operators copy.

    Args:
        deployments: by name.
        options_of: see `Observation.options_of`.
        commands: as the reader types them. None: in a shell.
    """
    forms = commands or AdvisedCommands()
    remedies: dict[str, str] = {}
    for name, deployment in deployments.items():
        started_by = name.removeprefix(RUN)
        for service in deployment.believed(name).services:
            instance = service.instance
            if NAME.match(instance):
                remedies[instance] = _again(service, started_by, options_of(instance), forms)
    return remedies


def _again(service: ExpectedService, started_by: str, options: str, commands: AdvisedCommands) -> str:
    """Return the remedy that restarts `service` of `started_by`. `options` join the site."""
    container = container_of(service.instance)
    if commands.containers and container:
        return f"start it again: {commands.restart([container])}"
    if not service.command:
        return f"it runs inside the process that started {started_by}: start that again"
    command = start_command(service.service, service.user or service.name)
    settings = f"the log of what started {started_by} has the command with its settings"
    if not command:
        return f"start it again: {settings}"
    return f"start it again: `{command}{options}` ({settings})"
