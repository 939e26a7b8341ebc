"""Services that are missing, stopped or ended, and people without a cursor because of them. Pure."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import chain

from pointit.diagnosis.observation import (
    CONTINUE,
    Code,
    Finding,
    Observation,
    ReportedProcess,
    StoppedProcess,
    container_of,
    is_router,
    restart_remedy,
)
from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.host.advised_commands import AdvisedCommands
from pointit.runtime.service.service import HEALTH_PERIOD_S
from pointit.schemas.environment import Environment
from pointit.schemas.system import RUN, split_instance
from pointit.schemas.text import few_of
from pointit.schemas.topics import CURSOR, HOVER, IMU, MAP, RAY
from pointit.services.registry import HOME_ASSISTANT, person_of, present_writers, row_of

CHAIN: tuple[AnyTopic, ...] = (IMU, RAY, CURSOR, HOVER)
"""Topics from a wrist to a selection. Each is made of the one before it."""
SHARED_REMEDY = (
    "restart the shared services where they ran, with `pointit run --site-only{credentials}`; if their "
    "process is stopped, continue it: `kill -CONT PID`"
)
HOME_REMEDY = (
    f"add --with {HOME_ASSISTANT.name} to `pointit run`, and its address and token by --config "
    "(`home_assistant: {url, token_file}`)"
)
CONTAINER_HOME_REMEDY = (
    f"run `pointit service run {HOME_ASSISTANT.name}` outside of the containers, with its address and token "
    "by --config and an identity of its own by --credentials"
)
STUCK_REMEDY = "its log names what blocks its event loop; if it is stopped, `kill -CONT {pid}`"
GONE = ("absent", "left", "silent")
"""Codes of findings of a service that does nothing."""

STARVED_S = 1.5 * HEALTH_PERIOD_S
"""Mean time between reports above which a process gets too little processor time, s."""
LATE_S = 1.2 * HEALTH_PERIOD_S
"""The same, s, if its output is late."""


def find_missing(seen: Observation) -> Iterator[Finding]:
    """Find services that should run and do not, or do not report."""
    for instance, remedy in seen.expected.items():
        if instance not in seen.present and instance not in seen.starting:
            yield Finding("error", "absent", instance, "should run and does not", remedy)

    # Nobody says that these should run: they may have been ended on purpose
    for instance in seen.left - seen.present - seen.expected.keys():
        sentence = "was present and has left: ended, killed, stopped or cut off"
        remedy = restart_remedy(instance, seen.options_of(instance), seen.commands)
        yield Finding("warning", "left", instance, sentence, remedy)

    # Presence is the network's: a process that is stopped keeps it until its connection ends
    for instance in filter(seen.is_silent, seen.present):
        silence_s = seen.silence_s(instance)
        sentence = (
            f"is present but has not reported for {silence_s:.0f} s: is it stopped, overloaded or cut off?"
        )
        process = "its process"
        if seen.newest(instance) is not None:
            process = seen.process_of(instance).description
        restart = seen.expected.get(instance)
        if restart is None:
            restart = restart_remedy(instance, seen.options_of(instance), seen.commands)
        remedy = f"look at {process}: {_stuck_remedy(seen.commands, 'PID', [instance])}; else {restart}"
        yield Finding("error", "silent", instance, sentence, remedy)


def find_empty_site(seen: Observation) -> Iterator[Finding]:
    """Find a site where nothing runs, or that may not be viewed."""
    if seen.denied:
        yield Finding("error", "denied", "", seen.denied, "")
        return
    if seen.expected:
        return

    # A router alone, as after the first step of a secured site
    if seen.present:
        if all(map(is_router, seen.present)):
            remedy = (
                "start the shared services with `pointit run --site-only --credentials FOLDER/identities/"
                "supervisor`, then each person with `pointit person add NAME --credentials NAME`"
            )
            if seen.commands.containers:
                remedy = f"start the other containers: {seen.commands.compose('up -d')}"
            yield Finding("error", "empty", "", "nothing but the router runs on this site yet", remedy)
        return

    # Nothing at all: often a site of another name runs at the same address
    if seen.other_sites:
        are = "a site is" if len(seen.other_sites) == 1 else "sites are"
        sentence = f"no service runs on this site, but {are} there: {', '.join(seen.other_sites)}"
        remedy = f"name the right one: --site {seen.other_sites[0]}"
    else:
        sentence = "the router answers, but no service runs on this site"
        remedy = (
            "start with `pointit run`, or name the right site with --site, or its address with --connect (of "
            "a run with --ros2: tcp/127.0.0.1:7448)"
        )
        if seen.commands.containers:
            remedy = f"start the other containers: {seen.commands.compose('up -d')}"
    yield Finding("error", "empty", "", sentence, remedy)


def find_people_without_cursor(seen: Observation) -> Iterator[Finding]:
    """Find people whose pointing has no effect, since a service that it needs is not present."""
    missing: set[str] = set()
    user_services: list[str] = []
    people: list[str] = []
    for person, services in _services_by_person(seen).items():
        missing_of_person = _missing_writers(seen, person, services)
        if missing_of_person:
            missing |= missing_of_person
            user_services += services
            people.append(person)
    if not people or is_anything_starting(seen):
        return

    # One finding for all people: what they lack is mostly shared
    people.sort()
    effect = "cursor" if missing & {"pui", "pointing"} else "selections"
    have = "has" if len(people) == 1 else "have"
    run = "does not run" if len(missing) == 1 else "do not run"
    sentence = f"{few_of(people)} {have} no {effect}: {few_of(sorted(missing))} {run} on this site"

    # Only `pointing` is a service of the person, all others are shared
    remedy = _shared_remedy(missing, seen)
    if missing == {"pointing"}:
        pointing = f"pointing.{people[0]}"
        remedy = restart_remedy(pointing, seen.options_of(pointing), seen.commands)
    subject = people[0] if len(people) == 1 else ""
    services = (*sorted(missing), *sorted(user_services))
    yield Finding("error", "no-cursor", subject, sentence, remedy, services=services)


def find_missing_bridge(seen: Observation) -> Iterator[Finding]:
    """Find things that are entities of a Home Assistant on a site that is not connected to it."""
    # A retained map may be of a run that is over
    if not seen.home_things or not present_writers(MAP, "", seen.present):
        return
    services = {*seen.present, *seen.left, *seen.expected}
    if HOME_ASSISTANT.name not in services:
        remedy = HOME_REMEDY
        if seen.commands.containers:
            remedy = CONTAINER_HOME_REMEDY
        yield Finding("warning", "no-bridge", "", unconnected_sentence(seen.home_things), remedy)


def home_things(environment: Environment) -> tuple[str, ...]:
    """Return the names of the things that are entities of a Home Assistant."""
    return tuple(thing.id for thing in environment.things if thing.home_assistant)


def unconnected_sentence(things: Sequence[str]) -> str:
    """Return the sentence on things of a Home Assistant to which the site is not connected."""
    return f"Home Assistant is not connected: pointing at {few_of(things)} switches nothing there"


def _missing_writers(seen: Observation, person: str, services: list[str]) -> set[str]:
    """Return the services that are not present and that `person`, who has `services`, needs for pointing."""
    outputs: set[AnyTopic] = set()
    for instance in services:
        outputs.update(_writes(instance))
    if not outputs & {IMU, RAY}:
        return set()
    needed = CHAIN[1:3] if _does_without_selector(seen, person) else CHAIN[1:]
    missing: set[str] = set()
    for topic in needed:
        if not present_writers(topic, person, seen.present):
            missing.add(topic.writers[0])
    return missing


def _does_without_selector(seen: Observation, person: str) -> bool:
    """Return True if nothing is selected on the site: a run has no selector, or the person sends robots."""
    if f"goal.{person}" in seen.present:
        return True
    runs = [services for name, services in seen.services_of.items() if name.startswith(RUN)]
    if not runs:
        return False
    return not any("selector" in services for services in runs)


def _writes(instance: str) -> tuple[AnyTopic, ...]:
    row = row_of(split_instance(instance)[0])
    return () if row is None else row.writes


def _services_by_person(seen: Observation) -> dict[str, list[str]]:
    services: dict[str, list[str]] = {}
    for instance in sorted(seen.present):
        person = person_of(instance)
        if person:
            services.setdefault(person, []).append(instance)
    return services


def is_anything_starting(seen: Observation) -> bool:
    """Return True if a service that is missing, or has not reported yet, may be starting."""
    if not seen.is_patient:
        return False
    if not seen.starting <= seen.present & seen.reports.keys():
        return True

    # People without a cursor: all of them may have begun a moment ago
    are_new: list[bool] = []
    for person, services in _services_by_person(seen).items():
        if _missing_writers(seen, person, services):
            are_new.append(all(map(seen.has_just_begun, services)))
    return bool(are_new) and all(are_new)


def stopped_services(findings: Sequence[Finding], seen: Observation) -> Iterator[Finding]:
    """Find stopped processes of this machine that explain services that are gone, or missing cursors."""
    gone: list[str] = []
    needed: set[str] = set()
    for finding in findings:
        if finding.code in GONE:
            gone.append(finding.service)
        elif finding.code == "no-cursor":
            needed.update(finding.services)

    for process in seen.stopped:
        # Of what a cursor needs, some may never have been present: its command line tells
        services = [instance for instance in gone if _runs(process, instance, seen)]
        services += filter(process.may_run, needed - seen.present - {*services})
        services.sort()
        if services:
            do = "does" if len(services) == 1 else "do"
            sentence = (
                f"process {process.pid} is stopped (Ctrl-Z or SIGSTOP): {few_of(services)} {do} nothing"
            )
            remedy = CONTINUE.format(pid=process.pid)
            containers = _containers_of(services)
            if seen.commands.containers and containers:
                remedy = f"start it again: {seen.commands.restart(containers)}"
            yield Finding("error", "stopped", _subject(services), sentence, remedy, services=tuple(services))


def starved_machines(findings: Iterable[Finding], seen: Observation) -> Iterator[Finding]:
    """Find machines with processes that get too little processor time, which explains `findings` symptoms."""
    affected = {finding.service for finding in findings}
    by_host: dict[tuple[str, str], dict[int, list[str]]] = defaultdict(dict)
    for process, instances in seen.processes.items():
        present = list(filter(seen.present.__contains__, instances))
        if present:
            by_host[process.host, process.claimant][process.pid] = present

    for (host, claimant), processes in by_host.items():
        # A little delay counts where it explains a symptom
        starved: dict[int, float] = {}
        for pid, own_services in processes.items():
            period_s = min(map(seen.period_s, own_services))
            limit_s = STARVED_S if affected.isdisjoint(own_services) else LATE_S
            if period_s > limit_s:
                starved[pid] = period_s
        if not starved:
            continue

        # One finding for each machine, with the process that is worst
        services = sorted(chain.from_iterable(processes[pid] for pid in starved))
        worst_s = max(starved.values())
        names = f"{len(starved)} processes"
        get = "get"
        if len(starved) == 1:
            names = f"process {next(iter(starved))}"
            get = "gets"
        says = f"{claimant} says: " if claimant else ""
        sentence = (
            f"{says}{names} of machine {host} ({few_of(services)}) {get} too little processor time: reports "
            f"come every {worst_s:.1f} s instead of every {HEALTH_PERIOD_S:g} s"
        )
        remedy = "is the machine overloaded (`top`), or its processor time limited? end other programs there"
        yield Finding("warning", "starved", _subject(services), sentence, remedy, services=tuple(services))


def gone_processes(findings: Sequence[Finding], seen: Observation) -> Iterator[Finding]:
    """Find processes all of whose services are gone, if there are several."""
    gone: dict[str, Finding] = {}
    for finding in findings:
        if finding.code in GONE:
            gone[finding.service] = finding

    for name, services in _processes(gone.keys(), seen).items():
        lost = sorted(services & gone.keys())
        process = ReportedProcess("?", 0)
        reporter = next(filter(seen.newest, lost), None)
        if reporter is not None:
            process = seen.process_of(reporter)
        pid = process.pid or "PID"

        # If all are silent, their process is still connected: it may be stopped. Else it has probably ended
        code: Code = "absent"
        if all(gone[instance].code == "silent" for instance in lost):
            code = "silent"
            sentence = (
                f"{process.description} does not report: {few_of(lost)} are silent; is it stopped, "
                "overloaded or cut off?"
            )
            stuck = _stuck_remedy(seen.commands, pid, lost)
            remedy = f"look at it where it runs: {stuck}; else {_restart_remedy(name, lost, seen)}"
        else:
            sentence = (
                f"{few_of(lost)} should run and do not: their process has ended, or is stopped or cut off"
            )
            restart = _restart_remedy(name, lost, seen)
            remedy = restart
            if not seen.commands.containers:
                remedy = f"{restart}; if it is stopped there, continue it: `kill -CONT {pid}`"
        is_person = name in seen.deployments and not name.startswith(RUN)
        subject = name if is_person else _subject(lost)
        yield Finding("error", code, subject, sentence, remedy, services=tuple(lost))


def _processes(gone: Collection[str], seen: Observation) -> dict[str, set[str]]:
    """Return processes without a service that runs, with two services and more, by deployment or number."""
    processes: dict[str, set[str]] = {}
    remaining = set(gone)
    for name, services in seen.services_of.items():
        if len(services) > 1 and services <= remaining:
            processes[name] = set(services)
            remaining -= services
    for process, instances in seen.processes.items():
        if len(instances) > 1 and remaining.issuperset(instances):
            processes[f"{process.description} of {process.host}"] = set(instances)
    return processes


def _shared_remedy(missing: Collection[str], seen: Observation) -> str:
    """Return the remedy that starts the shared services `missing` again."""
    containers = _containers_of(missing)
    if not seen.commands.containers:
        return SHARED_REMEDY.format(credentials=seen.credentials_of("supervisor"))
    if not containers:
        return "start the shared services again where they ran"
    return f"start the shared services again: {seen.commands.restart(containers)}"


def _containers_of(instances: Iterable[str]) -> list[str]:
    """Return the containers of `instances` in the compose files, without the site's name."""
    return sorted({container_of(instance) for instance in instances} - {""})


def _stuck_remedy(commands: AdvisedCommands, pid: int | str, instances: Sequence[str]) -> str:
    """Return the place that names what blocks `instances`, which are of process `pid`."""
    containers = _containers_of(instances)
    if not commands.containers or not containers:
        return STUCK_REMEDY.format(pid=pid)
    log = f"`podman logs {commands.containers}-{containers[0]}`"
    return f"its log, {log}, names what blocks its event loop"


def _restart_remedy(name: str, lost: Sequence[str], seen: Observation) -> str:
    """Return the remedy that starts the deployment or process `name`, which has lost services, again."""
    containers = _containers_of(lost)
    if seen.commands.containers and containers:
        return f"start it again: {seen.commands.restart(containers)}"
    if name not in seen.deployments:
        return f"start {name} again where it ran"
    if name.startswith(RUN):
        return f"start {name.removeprefix(RUN)} again where it ran, with `pointit run`"
    return f"start it again: `pointit person add {name}{seen.options}{seen.credentials_of(name)}`"


def _runs(process: StoppedProcess, instance: str, seen: Observation) -> bool:
    # What others claim of their process is no evidence
    health = seen.newest(instance)
    claimant = seen.process_of(instance).claimant
    if health is not None and health.host == seen.host and not claimant:
        return health.pid == process.pid

    deployments = [name for name, services in seen.services_of.items() if instance in services]
    if not deployments:
        deployments = [""]
    return any(process.may_run(instance, name) for name in deployments)


def _subject(services: Sequence[str]) -> str:
    """Return the only service, or the person of all, or `""`."""
    if len(services) == 1:
        return services[0]
    people = set(map(person_of, services))
    return people.pop() if len(people) == 1 else ""
