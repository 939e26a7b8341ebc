"""Snapshots of three sites that are well, as real ones report, and of each with one fault."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pointit.diagnosis.observation import DiagnosisReport, Observation, StoppedProcess
from pointit.schemas import NS_PER_S, Deployment, ExpectedService, Figure, Health, KeyHealth, Quantiles
from pointit.schemas.problems import Problem
from pointit.schemas.system import split_instance
from pointit.schemas.topics import CURSOR, DEPLOYMENT, HOVER, IMU, MAP, POSE, RAY, Topic
from pointit.services.registry import person_of

NOW_S = 106.0
NOW_NS = 1_700_000_000 * NS_PER_S
BEGAN_S = 100.0
REPORTS = 6
SHARED = ("pui", "selector", "led-driver", "conveyor-sim", "keeper")
PERSONAL = ("user-sim", "pointing", "localizer", "supervisor")
READS: Mapping[str, tuple[Topic[Any], ...]] = {
    "pointing": (IMU, POSE),
    "localizer": (IMU, RAY),
    "supervisor": (IMU,),
    "pui": (RAY, POSE),
    "selector": (CURSOR, MAP),
    "led-driver": (CURSOR, HOVER, MAP),
    "keeper": (MAP, DEPLOYMENT),
}
WRITES: Mapping[str, tuple[Topic[Any], ...]] = {
    "user-sim": (IMU,),
    "pointing": (RAY,),
    "pui": (CURSOR, MAP),
    "selector": (HOVER,),
}


@dataclass
class Process:
    """A process of a site, and what it reports."""

    pid: int
    host: str
    services: tuple[str, ...]
    arguments: tuple[str, ...]
    uptime_s: float = 600.0
    latency_s: float = 0.003
    ahead_s: float = 0.0
    period_s: float = 1.0
    """Time between its reports."""
    warnings: tuple[Problem, ...] = ()
    """Warnings of each of its services."""
    is_present: bool = True
    silence_s: float = 0.0


@dataclass
class Site:
    """Processes of a site by name, what was started, and what its services report beyond the usual."""

    processes: dict[str, Process]
    deployments: dict[str, Deployment]
    ages_s: dict[tuple[str, Topic[Any], str], float | None] = field(default_factory=dict[Any, Any])
    """Ages of the newest message by instance, topic and direction, where it is not fresh. None: never."""
    invalid: dict[tuple[str, Topic[Any]], int] = field(default_factory=dict[Any, int])
    """Growth of the number of invalid messages in each report, by instance and topic."""
    errors: dict[str, int] = field(default_factory=dict[str, int])
    """Growth of the number of failed handlers in each report, by instance."""
    warnings: dict[str, tuple[Problem, ...]] = field(default_factory=dict[str, tuple[Problem, ...]])
    figures: dict[str, tuple[Figure, ...]] = field(default_factory=dict[str, tuple[Figure, ...]])
    options: dict[str, Any] = field(default_factory=dict[str, Any])
    """Further fields of the observation."""

    def seen(self) -> Observation:
        reports: dict[str, list[DiagnosisReport]] = {}
        present: set[str] = set()
        for process in self.processes.values():
            if process.is_present:
                present.update(process.services)
                for number in range(REPORTS):
                    at_s = NOW_S - 0.1 - (REPORTS - 1 - number) * process.period_s
                    if at_s <= NOW_S - process.silence_s:
                        for service in process.services:
                            reports.setdefault(service, []).append(
                                self._report(process, service, number, at_s)
                            )
        for each in reports.values():
            each.sort(key=lambda report: report.received_s)
        values: dict[str, Any] = {"host": "desk", "shards": frozenset(), "now_ns": NOW_NS, **self.options}
        return Observation(
            began_s=BEGAN_S,
            now_s=NOW_S,
            present=frozenset(present),
            reports=reports,
            deployments=self.deployments,
            **values,
        )

    def _report(self, process: Process, instance: str, number: int, at_s: float) -> DiagnosisReport:
        service, _ = split_instance(instance)
        ways = (("in", READS), ("out", WRITES))
        keys = [
            self._key(instance, topic, way, number) for way, rows in ways for topic in rows.get(service, ())
        ]
        stamp_ns = NOW_NS - round((NOW_S - at_s) * NS_PER_S)
        late = Quantiles(p50_s=process.latency_s / 2, p99_s=process.latency_s) if keys else None
        health = Health(
            stamp_ns=stamp_ns + round((process.ahead_s - 0.002) * NS_PER_S), service=service,
            instance=instance,
            seq=number, user=person_of(instance), pid=process.pid, host=process.host, keys=tuple(keys),
            latency=late,
            errors=self.errors.get(instance, 0) * (number + 1),
            uptime_s=max(process.uptime_s - (NOW_S - at_s), 0.0),
            figures=self.figures.get(instance, ()),
            problems=(*process.warnings, *self.warnings.get(instance, ())),
        )  # fmt: skip
        return DiagnosisReport(received_s=at_s, health=health, arrived_ns=stamp_ns)

    def _key(self, instance: str, topic: Topic[Any], way: str, number: int) -> KeyHealth:
        age_s = self.ages_s.get((instance, topic, way), 0.01)
        invalid = self.invalid.get((instance, topic), 0) * (number + 1)
        fields = {"key": topic.key, "direction": way, "rate_hz": 50.0, "age_s": age_s, "invalid": invalid}
        return KeyHealth.model_validate(fields)

    def process_of(self, instance: str) -> str:
        return next(name for name, each in self.processes.items() if instance in each.services)

    def end(self, name: str, *, with_its_deployment: bool = False) -> None:
        """Kill a process."""
        process = self.processes.pop(name)
        if with_its_deployment:
            gone = set(process.services)
            for key, item in list(self.deployments.items()):
                if {each.instance for each in item.services} <= gone:
                    del self.deployments[key]

    def stop(self, name: str, *, is_local: bool = True) -> None:
        """Stop a process; its lease is over, and what nobody else retains is out of reach."""
        process = self.processes[name]
        self.end(name, with_its_deployment="keeper" in process.services)
        if is_local:
            self.options["stopped"] = (StoppedProcess(process.pid, process.arguments),)


def deployment(name: str, processes: Iterable[Process], age_s: float = 600.0) -> Deployment:
    expected = [
        ExpectedService(service=split_instance(each)[0], user=person_of(each), command=process.arguments)
        for process in processes
        for each in process.services
    ]
    stamp_ns = NOW_NS - round(age_s * NS_PER_S)
    return Deployment(stamp_ns=stamp_ns, name=name, services=tuple(expected), scenario="scenario_4")


def services_of(*people: str) -> tuple[str, ...]:
    return tuple(f"{service}.{person}" for person in people for service in PERSONAL)


def one_process() -> Site:
    run = Process(10, "desk", (*SHARED, *services_of("user1", "user2")), ("pointit", "run", "scenario_4"))
    return Site({"run": run}, {"run.scenario_4": deployment("scenario_4", [run])})


def processes() -> Site:
    """Return a site of `--processes`."""
    names = (*SHARED, *services_of("user1", "user2"))
    all_of = {
        name: Process(
            20 + number,
            "desk",
            (name,),
            (
                "pointit.services",
                split_instance(name)[0],
                *(("--user", person_of(name)) if person_of(name) else ()),
                *("--site", "lab"),
            ),
        )
        for number, name in enumerate(names)
    }
    return Site(dict(all_of), {"run.scenario_4": deployment("scenario_4", all_of.values())})


def router_with_people(*people: str) -> Site:
    """Return a secured site: router, shared services in one process, each person on their own machine."""
    router = Process(1, "desk", ("router",), ("pointit", "router", "--site-folder", "hall"))
    site = Process(2, "desk", SHARED, ("pointit", "run", "scenario_4", "--site-only"))
    theirs = {
        person: Process(
            3 + number, f"laptop-{person}", services_of(person), ("pointit", "person", "add", person)
        )
        for number, person in enumerate(people or ("anna", "ben", "cleo"))
    }
    deployments = {"run.scenario_4": deployment("scenario_4", [site])}
    deployments |= {person: deployment(person, [each]) for person, each in theirs.items()}
    return Site(
        {"router": router, "site": site, **theirs}, deployments, options={"identities": "hall/identities"}
    )


Make = Callable[[], Site]
DEPLOYMENTS: Mapping[str, Make] = {
    "one process": one_process,
    "--processes": processes,
    "router": router_with_people,
}
