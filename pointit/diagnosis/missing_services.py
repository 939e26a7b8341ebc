"""Services that are missing, stopped or ended, and people without a cursor because of them. Pure."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence

from pointit.diagnosis.observation import (
    CONTINUE,
    Code,
    Finding,
    Observation,
    ReportedProcess,
    StoppedProcess,
    restart_remedy,
)
from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.service.service import HEALTH_PERIOD_S
from pointit.schemas.environment import Environment
from pointit.schemas.system import RUN, split_instance
from pointit.schemas.text import few_of
from pointit.schemas.topics import CURSOR, HOVER, IMU, MAP, RAY
from pointit.services.registry import HOME_ASSISTANT, person_of, present_writers, row_of

CHAIN: tuple[AnyTopic, ...] = (IMU, RAY, CURSOR, HOVER)
"""Topics from a wrist to a selection. Each is made of the one before it."""
SHARED_REMEDY = (
    "start what all people share again where it ran, with `pointit run --site-only{credentials}`; if its "
    "process is stopped there, continue it: `kill -CONT PID`"
)
HOME_REMEDY = (
    f"add --with {HOME_ASSISTANT.name} to `pointit run`, and its address and token by --config "
    "(`home_assistant: {url, token_file}`)"
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
    for instance in seen.left - seen.present - seen.expected.keys():
        sentence = "was present and has left: ended, killed, stopped or cut off"
        yield Finding(
            "warning", "left", instance, sentence, restart_remedy(instance, seen.options_of(instance))
        )
    for instance in filter(seen.is_silent, seen.present):
        health = seen.newest(instance)
        sentence = (
            f"is present but has not reported for {seen.silence_s(instance):.0f} s: is it stopped, "
            "overloaded or cut off?"
        )
        again = seen.expected.get(instance, restart_remedy(instance, seen.options_of(instance)))
        process = seen.process_of(instance).description if health else "its process"
        remedy = f"look at {process}: {STUCK_REMEDY.format(pid='PID')}; else {again}"
        yield Finding("error", "silent", instance, sentence, remedy)


def find_empty_site(seen: Observation) -> Iterator[Finding]:
    """Find a site where nothing runs, or that may not be viewed."""
    if seen.denied:
        yield Finding("error", "denied", "", seen.denied, "")
    elif not seen.present and not seen.expected and seen.other_sites:
        are = "a site is" if len(seen.other_sites) == 1 else "sites are"
        sentence = f"no service runs on this site, but {are} there: {', '.join(seen.other_sites)}"
        yield Finding("error", "empty", "", sentence, f"name the right one: --site {seen.other_sites[0]}")
    elif not seen.present and not seen.expected:
        remedy = (
            "start with `pointit run`, or name the right site with --site, or its address with --connect (of "
            "a run with --ros2: tcp/127.0.0.1:7448)"
        )
        yield Finding("error", "empty", "", "the router answers, but no service runs on this site", remedy)
    elif not seen.expected and all(map(is_router, seen.present)):
        remedy = (
            "start what all people share with `pointit run --site-only --credentials FOLDER/identities/"
            "supervisor`, then each person with `pointit person add NAME --credentials NAME`"
        )
        yield Finding("error", "empty", "", "nothing but the router runs on this site yet", remedy)


def find_people_without_cursor(seen: Observation) -> Iterator[Finding]:
    """Find people whose pointing has no effect, since a service that it needs is not present."""
    people = {
        person: services
        for person, services in _services_by_person(seen).items()
        if _missing_writers(seen, person, services)
    }
    if not people or is_anything_starting(seen):
        return
    lacking = {each for person in people for each in _missing_writers(seen, person, people[person])}
    names = sorted(people)
    without = "cursor" if lacking & {"pui", "pointing"} else "selections"
    have = f"has no {without}" if len(names) == 1 else f"have no {without}"
    run = "does not run" if len(lacking) == 1 else "do not run"
    sentence = f"{few_of(names)} {have}: {few_of(sorted(lacking))} {run} on this site"
    remedy = SHARED_REMEDY.format(credentials=seen.credentials_of("supervisor"))
    if lacking == {"pointing"}:
        pointing = f"pointing.{names[0]}"
        remedy = restart_remedy(pointing, seen.options_of(pointing))
    subject = names[0] if len(names) == 1 else ""
    user_services = sorted(each for services in people.values() for each in services)
    yield Finding(
        "error", "no-cursor", subject, sentence, remedy, services=(*sorted(lacking), *user_services)
    )


def find_missing_bridge(seen: Observation) -> Iterator[Finding]:
    """Find things that are entities of a Home Assistant on a site that is not connected to it."""
    services = {*seen.present, *seen.left, *seen.expected}
    is_map_in_use = bool(
        present_writers(MAP, "", seen.present)
    )  # a retained one may be of a run that is over
    if seen.home_things and is_map_in_use and HOME_ASSISTANT.name not in services:
        yield Finding("warning", "no-bridge", "", unconnected_sentence(seen.home_things), HOME_REMEDY)


def home_things(environment: Environment) -> tuple[str, ...]:
    """Return the names of the things that are entities of a Home Assistant."""
    return tuple(thing.id for thing in environment.things if thing.home_assistant)


def unconnected_sentence(things: Sequence[str]) -> str:
    """Return the sentence on things of a Home Assistant to which the site is not connected."""
    return f"Home Assistant is not connected: pointing at {few_of(things)} switches nothing there"


def _missing_writers(seen: Observation, person: str, services: list[str]) -> set[str]:
    """Return the services that are not present and that `person`, who has `services`, needs for pointing."""
    written = [topic for topic in CHAIN if present_writers(topic, person, seen.present)]
    own = {topic for each in services for topic in _writes(each)}
    if not own & {IMU, RAY}:
        return set()
    needed = CHAIN[1:3] if _does_without_selector(seen, person) else CHAIN[1:]
    return {topic.writers[0] for topic in needed if topic not in written}


def _does_without_selector(seen: Observation, person: str) -> bool:
    """Return True if nothing is selected on the site: a run has no selector, or the person sends robots."""
    runs = [services for name, services in seen.services_of.items() if name.startswith(RUN)]
    is_run_without = bool(runs) and not any("selector" in services for services in runs)
    return is_run_without or f"goal.{person}" in seen.present


def _writes(instance: str) -> tuple[AnyTopic, ...]:
    row = row_of(split_instance(instance)[0])
    return () if row is None else row.writes


def _services_by_person(seen: Observation) -> dict[str, list[str]]:
    services: dict[str, list[str]] = {}
    for instance in sorted(seen.present):
        if person := person_of(instance):
            services.setdefault(person, []).append(instance)
    return services


def is_anything_starting(seen: Observation) -> bool:
    """Return True if a service that is missing, or has not reported yet, may be starting."""
    if not seen.is_patient:
        return False
    are_new = [
        all(map(seen.has_just_begun, services))
        for person, services in _services_by_person(seen).items()
        if _missing_writers(seen, person, services)
    ]
    return (bool(are_new) and all(are_new)) or not seen.starting <= seen.present & seen.reports.keys()


def is_router(instance: str) -> bool:
    """Return True if `instance` is a router's account of itself."""
    return instance.partition(".")[0].partition("-")[0] == "router"


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
                f"process {process.pid} is stopped (Ctrl-Z or SIGSTOP): {few_of(services)} {do} nothing"
            )
            remedy = CONTINUE.format(pid=process.pid)
            yield Finding("error", "stopped", _subject(services), sentence, remedy, services=tuple(services))


def starved_machines(findings: Iterable[Finding], seen: Observation) -> Iterator[Finding]:
    """Find machines with processes that get too little processor time, which explains `findings` symptoms."""
    affected = {each.service for each in findings}
    by_host: dict[tuple[str, str], dict[int, list[str]]] = defaultdict(dict)
    for process, services in seen.processes.items():
        if present := [each for each in services if each in seen.present]:
            by_host[process.host, process.claimant][process.pid] = present
    for (host, claimant), processes in by_host.items():
        starved: dict[int, float] = {}
        for pid, own_services in processes.items():
            period_s = min(map(seen.period_s, own_services))
            # a little delay counts where it explains a symptom
            limit_s = STARVED_S if affected.isdisjoint(own_services) else LATE_S
            if period_s > limit_s:
                starved[pid] = period_s
        if not starved:
            continue
        services = sorted(each for pid in starved for each in processes[pid])
        pid = max(starved, key=lambda each: starved[each])
        names = f"process {pid}" if len(starved) == 1 else f"{len(starved)} processes"
        says = f"{claimant} says: " if claimant else ""
        get = "gets" if len(starved) == 1 else "get"
        sentence = (
            f"{says}{names} of machine {host} ({few_of(services)}) {get} too little processor time: reports "
            f"come every {starved[pid]:.1f} s instead of every {HEALTH_PERIOD_S:g} s"
        )
        remedy = "is the machine overloaded (`top`), or its processor time limited? end other programs there"
        yield Finding("warning", "starved", _subject(services), sentence, remedy, services=tuple(services))


def gone_processes(findings: Sequence[Finding], seen: Observation) -> Iterator[Finding]:
    """Find processes all of whose services are gone, if there are several."""
    gone = {each.service: each for each in findings if each.code in GONE}
    for name, services in _processes(gone.keys(), seen).items():
        lost = sorted(gone[each].service for each in services if each in gone)
        silent = [each for each in lost if gone[each].code == "silent"]
        process = next((seen.process_of(each) for each in lost if seen.newest(each)), ReportedProcess("?", 0))
        pid = process.pid
        code: Code = "silent" if silent == lost else "absent"
        if code == "silent":
            sentence = (
                f"{process.description} does not report: {few_of(lost)} are silent; is it stopped, "
                "overloaded or cut off?"
            )
            stuck = STUCK_REMEDY.format(pid=pid or "PID")
            remedy = f"look at it where it runs: {stuck}; else {_again(name, seen)}"
        else:
            sentence = (
                f"{few_of(lost)} should run and do not: their process has ended, or is stopped or cut off"
            )
            remedy = f"{_again(name, seen)}; if it is stopped there, continue it: `kill -CONT {pid or 'PID'}`"
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
    for process, services in seen.processes.items():
        if len(services) > 1 and left.issuperset(services):
            processes[f"{process.description} of {process.host}"] = set(services)
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
    is_claim = bool(seen.process_of(instance).claimant)
    if health is not None and health.host == seen.host and not is_claim:
        return health.pid == process.pid
    names = [name for name, services in seen.services_of.items() if instance in services]
    return any(process.may_run(instance, name) for name in names or [""])


def _subject(services: Sequence[str]) -> str:
    """Return the only service, or the person of all, or `""`."""
    people = set(map(person_of, services))
    return services[0] if len(services) == 1 else people.pop() if len(people) == 1 else ""
