"""Services that do nothing because the process that they run in is stopped or has ended. Pure."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence

from pointit.diagnosis.missing_services import GONE, listed
from pointit.diagnosis.observation import CONTINUE, Code, Finding, Observation, StoppedProcess
from pointit.runtime.bus.timeliness import LONGEST_HOST
from pointit.runtime.service.service import HEALTH_PERIOD_S
from pointit.schemas.system import RUN
from pointit.schemas.text import one_line
from pointit.services.registry import person_of

STARVED_S = 1.5 * HEALTH_PERIOD_S
"""Mean time between reports above which a process gets too little processor time, s."""
LATE_S = 1.2 * HEALTH_PERIOD_S
"""The same, s, if its output is late."""


def stopped_services(findings: Sequence[Finding], seen: Observation) -> Iterator[Finding]:
    """Find stopped processes of this machine that explain services that are gone, or missing cursors."""
    gone = [each.service for each in findings if each.code in GONE]
    needed = {each for finding in findings if finding.code == "no-cursor" for each in finding.services}
    for process in seen.stopped:
        services = [each for each in gone if _runs(process, each, seen)]
        missing = needed - seen.present - {*services}
        services = sorted([*services, *(each for each in missing if process.may_run(each))])
        if services:
            do = "does" if len(services) == 1 else "do"
            sentence = (
                f"process {process.pid} is stopped (Ctrl-Z or SIGSTOP): {listed(services)} {do} nothing"
            )
            remedy = CONTINUE.format(pid=process.pid)
            yield Finding("error", "stopped", _subject(services), sentence, remedy, services=tuple(services))


def starved_machines(findings: Iterable[Finding], seen: Observation) -> Iterator[Finding]:
    """Find machines with processes that get too little processor time, which explains `findings` symptoms."""
    affected = {each.service for each in findings}
    by_host: dict[str, dict[int, list[str]]] = defaultdict(lambda: defaultdict(list))
    for instance in sorted(seen.present):
        if (health := seen.newest(instance)) is not None:
            by_host[health.host][health.pid].append(instance)
    for host, processes in by_host.items():
        periods_s = {pid: min(map(seen.period_s, services)) for pid, services in processes.items()}
        starved = {
            pid: period_s
            for pid, period_s in periods_s.items()
            if period_s > STARVED_S or (period_s > LATE_S and not affected.isdisjoint(processes[pid]))
        }
        if not starved:
            continue
        services = sorted(each for pid in starved for each in processes[pid])
        pid = max(starved, key=lambda each: starved[each])
        names = f"process {pid}" if len(starved) == 1 else f"{len(starved)} processes"
        where = one_line(host, LONGEST_HOST) or "?"
        get = "gets" if len(starved) == 1 else "get"
        sentence = (
            f"{names} of machine {where} ({listed(services)}) {get} too little processor time: reports come "
            f"every {starved[pid]:.1f} s instead of every {HEALTH_PERIOD_S:g} s"
        )
        remedy = "is the machine overloaded (`top`), or its processor time limited? end other programs there"
        yield Finding("warning", "starved", _subject(services), sentence, remedy, services=tuple(services))


def gone_processes(findings: Sequence[Finding], seen: Observation) -> Iterator[Finding]:
    """Find processes all of whose services are gone, if there are several."""
    gone = {each.service: each for each in findings if each.code in GONE}
    for name, services in _processes(gone.keys(), seen).items():
        lost = sorted(gone[each].service for each in services if each in gone)
        silent = [each for each in lost if gone[each].code == "silent"]
        pid = next((health.pid for each in lost if (health := seen.newest(each))), 0)
        stop = f"`kill -CONT {pid or 'PID'}`"
        code: Code = "silent" if silent == lost else "absent"
        if code == "silent":
            sentence = (
                f"process {pid or '?'} does not report: {listed(lost)} are silent; is it stopped, overloaded "
                "or cut off?"
            )
            remedy = f"look at it where it runs (stopped: {stop}); else {_again(name, seen)}"
        else:
            sentence = (
                f"{listed(lost)} should run and do not: their process has ended, or is stopped or cut off"
            )
            remedy = f"{_again(name, seen)}; if it is stopped there, continue it: {stop}"
        is_person = name in seen.deployments and not name.startswith(RUN)
        subject = name if is_person else _subject(lost)
        yield Finding("error", code, subject, sentence, remedy, services=tuple(lost))


def _processes(gone: Collection[str], seen: Observation) -> dict[str, set[str]]:
    """Return processes without a service that runs, with two services and more, by deployment or number."""
    processes: dict[str, set[str]] = {}
    left = set(gone)
    for name, services in seen.services_of.items():
        if len(services) > 1 and services <= left:
            processes[name] = set(services)
            left -= services
    by_pid: dict[tuple[str, int], set[str]] = defaultdict(set)
    for instance in seen.reports:
        if (health := seen.newest(instance)) is not None:
            by_pid[health.host, health.pid].add(instance)
    for (host, pid), heard in by_pid.items():
        if len(heard) > 1 and heard <= left:
            processes[f"process {pid} of {host}"] = heard
    return processes


def _again(name: str, seen: Observation) -> str:
    """Return the remedy that starts the deployment or process `name` again."""
    if name not in seen.deployments:
        return f"start {name} again where it ran"
    if name.startswith(RUN):
        return f"start {name.removeprefix(RUN)} again where it ran, with `pointit run`"
    return f"start it again: `pointit person add {name}{seen.options}{seen.credentials_of(name)}`"


def _runs(process: StoppedProcess, instance: str, seen: Observation) -> bool:
    health = seen.newest(instance)
    if health is not None and health.host == seen.host:
        return health.pid == process.pid
    names = [name for name, services in seen.services_of.items() if instance in services]
    return any(process.may_run(instance, name) for name in names or [""])


def _subject(services: Sequence[str]) -> str:
    """Return the only service, or the person of all, or `""`."""
    people = set(map(person_of, services))
    return services[0] if len(services) == 1 else people.pop() if len(people) == 1 else ""
