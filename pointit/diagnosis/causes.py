"""Deepest causes of symptoms: out of reach as a whole, machine, process, person, stream, in this order. Pure.

Each explanation takes the symptoms that no deeper cause has explained, and returns causes. What a cause
explains is not a problem of its own.
"""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Literal

from pointit.diagnosis.missing_services import (
    CHAIN,
    GONE,
    gone_processes,
    starved_machines,
    stopped_services,
)
from pointit.diagnosis.observation import (
    CONTINUE,
    Code,
    Finding,
    Observation,
    Severity,
    StoppedProcess,
    is_router,
)
from pointit.diagnosis.symptoms import latency_s
from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.host.advised_commands import AdvisedCommands
from pointit.runtime.link.link import Outage, find_outage, restart_router_remedy
from pointit.schemas.problems import (
    CLOCK,
    CLOCK_LIMIT,
    DENIED,
    EVENT_LOOP,
    HANDLER,
    IDLE_ARM,
    INVALID,
    LATE,
    REVOKED,
    ROUTER_LOST,
    SILENCING,
    TWICE,
    UNWRITABLE,
)
from pointit.schemas.system import split_instance
from pointit.schemas.text import few_of
from pointit.services.registry import person_of, row_of

Symptoms = Sequence[Finding]

PASSING = ("slow", "stale", "silent", "starved")
"""Codes of findings that a short load can cause."""
SEVERITIES = ("error", "warning", "note")
"""The worst first."""


def unreachable(
    connect: Sequence[str],
    stopped: Sequence[StoppedProcess],
    *,
    is_refused: bool,
    is_secured: bool,
    rejection: str = "",
    commands: AdvisedCommands,
) -> Finding:
    """Return the finding of an observer that cannot join.

    `is_refused`: nothing listens at `connect`. `stopped`: processes of this machine that may be the router.
    `rejection`: reason and remedy if the router rejects the observer. `commands`: as its reader types them.
    """
    addresses = ", ".join(connect)

    # The kernel accepts connections for a stopped router, which then does not answer
    if not is_refused:
        for process in stopped:
            if process.may_route:
                pid = process.pid
                sentence = (
                    f"the router at {addresses} does not answer: process {pid} is stopped (Ctrl-Z or SIGSTOP)"
                )
                remedy = CONTINUE.format(pid=pid)
                if commands.containers:
                    remedy = f"start it again: {commands.start_router()}"
                return _unreachable(sentence, remedy, "stopped")

    if rejection:
        return _unreachable(rejection, "", "denied")
    if not is_refused:
        sentence = f"the router at {addresses} does not answer"
        remedy = f"{restart_router_remedy(commands)}; or give another address by --connect"
        return _unreachable(sentence, remedy)

    # An open site has its router in `pointit run`, a secured one has a router of its own
    remedy = (
        "start `pointit run`, or `pointit router` if services wait for it, give its address by "
        "--connect or, on a secured site, your identity by --credentials"
    )
    if is_secured or commands.containers:
        remedy = f"start its router with {commands.start_router()}, or give its address by --connect"
    return _unreachable(f"nothing runs at {addresses}", remedy)


def _outage(findings: Sequence[Finding], seen: Observation) -> Outage | None:
    gone = {finding.service for finding in _with_code(findings, GONE)}
    lost_routers = [finding.subject for finding in _with_problem(findings, (ROUTER_LOST,))]
    lost_router = next(iter(lost_routers), "")
    return find_outage(seen.present | seen.expected.keys() | gone, gone, lost_router, seen.commands)


def _with_code(findings: Iterable[Finding], codes: Collection[str]) -> list[Finding]:
    return [finding for finding in findings if finding.code in codes]


def _with_problem(findings: Iterable[Finding], problems: Collection[str]) -> list[Finding]:
    return [finding for finding in findings if finding.problem in problems]


def _unreachable(sentence: str, remedy: str, code: Code = "unreachable") -> Finding:
    return Finding("error", code, "", sentence, remedy)


def find_consequences(services: Collection[str], seen: Observation) -> Callable[[Finding], bool]:
    """Return a test for symptoms of others that follow if `services` do nothing, or do it wrongly."""
    written: set[str] = set()
    for instance in services:
        written.update(topic.key for topic in _topics(instance, "writes"))
    names = {split_instance(instance)[0] for instance in services}
    affected = _readers(services, seen)

    def follows(symptom: Finding) -> bool:
        # A missing cursor names the services that it needs
        if symptom.code == "no-cursor":
            needed = {split_instance(instance)[0] for instance in symptom.services}
            return bool(names & needed)

        # Inputs and latencies of readers depend on the writers, their other warnings only if they say so
        if symptom.service not in affected:
            return False
        if symptom.code in ("stale", "slow"):
            return True
        if symptom.code != "warning":
            return False
        if symptom.topic in written or symptom.subject in names:
            return True
        return symptom.problem == LATE

    return follows


def _readers(services: Collection[str], seen: Observation) -> set[str]:
    """Return `services` and those that read what they write, directly or through others."""
    affected = set(services)
    new = set(services)
    while new:
        written: list[tuple[str, AnyTopic]] = []
        for writer in new:
            written += [(person_of(writer), topic) for topic in _topics(writer, "writes")]
        unaffected = seen.present - affected
        new = {instance for instance in unaffected if _reads_any(instance, written)}
        affected |= new
    return affected


def _reads_any(instance: str, written: Sequence[tuple[str, AnyTopic]]) -> bool:
    """Return True if `instance` reads one of the topics that are written, each for a person or for all."""
    inputs = _topics(instance, "reads")
    reader_person = person_of(instance)
    for person, topic in written:
        if topic not in inputs:
            continue
        if not person or reader_person in ("", person):
            return True
    return False


def _topics(instance: str, direction: Literal["reads", "writes"]) -> tuple[AnyTopic, ...]:
    row = row_of(split_instance(instance)[0])
    return () if row is None else getattr(row, direction)


@dataclass(frozen=True)
class Cause:
    """A finding, and the symptoms that it explains."""

    finding: Finding
    explains: Callable[[Finding], bool]
    symptom: Finding | None = None
    """The symptom in whose place `finding` is, if it is not `finding` itself."""


Explanation = Callable[[Symptoms, Observation], Iterator[Cause]]


def explain(symptoms: Symptoms, seen: Observation) -> list[Finding]:
    """Return the causes, the symptoms without a cause, and with `follows` those that have one.

    The report of a person's service is a claim, which may be forged. First all that others report and
    presence shows is explained, then each person's symptoms by what is left of them.
    """
    findings: list[Finding] = []
    explained: list[Finding] = []
    unexplained = list(symptoms)
    claimants = {symptom: _claimant(symptom) for symptom in symptoms}
    people = sorted({*claimants.values()} - {""})
    steps = [("", explanation) for explanation in EXPLANATIONS]
    for person in people:
        steps += [(person, explanation) for explanation in OF_ONE_PERSON]

    # Deepest causes first: each explanation sees only what those before it have not explained
    for person, explanation in steps:
        considered = tuple(symptom for symptom in unexplained if claimants[symptom] == person)
        for cause in explanation(considered, seen):
            findings.append(cause.finding)
            affected_person = person or person_of(cause.finding.service)
            remaining: list[Finding] = []
            for symptom in unexplained:
                # The cause itself is a finding, not its own consequence
                if symptom in (cause.finding, cause.symptom):
                    continue
                if _is_of_others(symptom, affected_person) or not cause.explains(symptom):
                    remaining.append(symptom)
                elif cause.finding.severity == "note":  # nothing is wrong
                    explained.append(replace(symptom, severity="note"))
                else:
                    explained.append(symptom)
            unexplained = remaining

    consequences = [replace(symptom, follows=True) for symptom in explained]
    return [*findings, *unexplained, *consequences]


def _is_of_others(symptom: Finding, person: str) -> bool:
    """Return True if a cause that concerns only `person` cannot explain `symptom`. `""`: it concerns all."""
    if not person:
        return False
    return person not in (_claimant(symptom), person_of(symptom.service), symptom.service)


def _claimant(finding: Finding) -> str:
    """Return the person whose services alone claim `finding`, or write the input that is missing, or `""`.

    What is gone is seen by its presence, which is not a claim.
    """
    if finding.code in GONE:
        return ""
    claimant = person_of(finding.service)
    if claimant or finding.code != "stale":
        return claimant
    writers = {*finding.services} - {finding.service}
    people = set(map(person_of, writers))
    return people.pop() if len(people) == 1 else ""


def may_pass(finding: Finding) -> bool:
    """Return True if a short load can cause `finding`: it counts if it lasts."""
    return finding.code in PASSING or finding.problem == LATE


def _lost_router(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain services that are out of reach by the router that services say they have lost."""
    outage = _outage(symptoms, seen)
    if outage is None or not outage.is_of_router:
        return
    severity: Severity = "warning"  # what it cannot reach is not expected here
    if any(symptom.severity == "error" for symptom in _with_code(symptoms, GONE)):
        severity = "error"
    finding = replace(_unreachable(outage.sentence, outage.remedy), severity=severity)

    def explains(symptom: Finding) -> bool:
        return symptom.code in (*GONE, "stale", "no-cursor") or symptom.problem == ROUTER_LOST

    yield Cause(finding, explains)


def _clock(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    for group in _group_by_clock(symptoms, seen):
        is_far = group[0].problem == CLOCK_LIMIT

        def explains(symptom: Finding, group: Symptoms = group, *, is_far: bool = is_far) -> bool:
            if symptom in group:
                return True
            if symptom.problem in (CLOCK, CLOCK_LIMIT) and person_of(symptom.service):
                return True
            # A small skew changes measured latencies only, one above the limit also the age of messages
            if symptom.code == "slow":
                return True
            is_late = symptom.code in ("stale", "no-cursor") or symptom.problem == LATE
            return is_far and is_late

        yield replace(_first_of(group, group[0].code), explains=explains)


def _group_by_clock(symptoms: Symptoms, seen: Observation) -> list[list[Finding]]:
    """Return the findings on clocks, one list for each machine whose clock is wrong."""
    by_host: dict[str, list[Finding]] = defaultdict(list)
    for symptom in _with_problem(symptoms, (CLOCK, CLOCK_LIMIT)):
        by_host[symptom.subject].append(symptom)
    shared_hosts: set[str] = set()
    for instance, host in _host_of_reporters(seen).items():
        if not person_of(instance):
            shared_hosts.add(host)

    # If the clocks of all other machines seem wrong to a reporter, its own clock is wrong
    reporters = {""}
    for group in by_host.values():
        reporters.update(symptom.service for symptom in group)
    for reporter in reporters:
        health = seen.newest(reporter)
        own_host = health.host if health else seen.host
        if len(by_host) > 1 and by_host.keys() >= shared_hosts - {own_host}:
            by_host = {"": list(chain.from_iterable(by_host.values()))}
    return list(by_host.values())


def _host_of_reporters(seen: Observation) -> dict[str, str]:
    """Return the machine of each instance that has reported."""
    host_of: dict[str, str] = {}
    for instance in seen.reports:
        health = seen.newest(instance)
        if health is not None:
            host_of[instance] = health.host
    return host_of


def _disk(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    by_host: dict[str, list[Finding]] = defaultdict(list)
    host_of = _host_of_reporters(seen)
    for symptom in _with_problem(symptoms, (UNWRITABLE,)):
        by_host[host_of.get(symptom.service, "")].append(symptom)
    for host, group in by_host.items():

        def is_same(symptom: Finding, host: str = host) -> bool:
            return symptom.problem == UNWRITABLE and host_of.get(symptom.service, "") == host

        cause = _first_of(group, "disk")
        is_claim = bool(person_of(cause.finding.service))
        severity: Severity = "warning" if is_claim else "error"  # data of the site is lost
        finding = replace(cause.finding, severity=severity)
        yield _also(replace(cause, finding=finding), is_same)


def _rights(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    by_name: dict[tuple[str, bool], list[Finding]] = defaultdict(list)
    revoked = {symptom.subject for symptom in _with_problem(symptoms, (REVOKED,))}
    for symptom in _with_problem(symptoms, (DENIED, REVOKED)):
        # A router can tell a valid certificate from a revoked one of the same name
        is_valid = _is_denied_by_router(symptom) and symptom.subject in revoked
        by_name[symptom.subject, is_valid].append(symptom)

    for (name, _), group in by_name.items():
        # The service's own words come before those of a router
        own = sorted(group, key=lambda symptom: (symptom.problem == DENIED, is_router(symptom.service)))
        services = {symptom.service for symptom in group}
        cause = _first_of(own, "denied")
        follow = find_consequences(services, seen)

        # A router knows the identity, not the process: the remedy is where that was started
        if _is_denied_by_router(own[0]):
            add = seen.commands.site("user add NAME")
            remedy = f"give it credentials by --credentials ({add}), or end it"
            if name:
                remedy = f"start it with its own credentials instead of those of {name}, or end it"
            cause = replace(cause, finding=replace(cause.finding, remedy=remedy))

        def is_of_service(symptom: Finding, name: str = name, group: Symptoms = group) -> bool:
            if symptom in group:
                return True
            if symptom.code in GONE and split_instance(symptom.service)[1] == name:
                return True
            if symptom.problem not in (DENIED, REVOKED) or is_router(symptom.service):
                return False
            return symptom.subject == name

        yield _also(_also(cause, follow), is_of_service)


def _is_denied_by_router(symptom: Finding) -> bool:
    return symptom.problem == DENIED and is_router(symptom.service)


def _processes(
    find: Callable[[Symptoms, Observation], Iterator[Finding]], symptoms: Symptoms, seen: Observation
) -> Iterator[Cause]:
    for finding in find(symptoms, seen):
        yield _process_cause(finding, seen)


def _mass(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    outage = _outage(symptoms, seen)
    if outage is not None:
        finding = _unreachable(outage.sentence, outage.remedy)
        codes = (*GONE, "stale", "slow", "no-cursor")
        yield Cause(finding, lambda symptom: symptom.code in codes)


def _gone(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    for symptom in _with_code(symptoms, GONE):
        yield Cause(symptom, find_consequences({symptom.service}, seen))


def _unwritten(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain inputs that never come by what their writer says of its device: that is the error, not they."""
    for report in _with_problem(symptoms, SILENCING):
        waiting = [symptom for symptom in symptoms if _waits_for(symptom, report.service)]
        if not waiting:
            continue
        follow = find_consequences({report.service}, seen)
        is_idle = report.problem == IDLE_ARM
        finding = replace(report, severity="note" if is_idle else "error")
        yield _also(Cause(finding, waiting.__contains__, report), follow)


def _waits_for(finding: Finding, writer: str) -> bool:
    if finding.code != "stale" or finding.service == writer:
        return False
    return writer in finding.services


def _no_cursor(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    for symptom in _with_code(symptoms, ("no-cursor",)):
        yield Cause(symptom, find_consequences(set(symptom.services), seen))


def _process_cause(finding: Finding, seen: Observation) -> Cause:
    services = set(finding.services)
    follow = find_consequences(services, seen)

    def explains(symptom: Finding) -> bool:
        if symptom.code in GONE and symptom.service in services:
            return True
        return follow(symptom)

    return Cause(finding, explains)


def _duplicates(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    by_remark: dict[str, list[Finding]] = defaultdict(list)
    for symptom in _with_problem(symptoms, (TWICE,)):
        remark = symptom.subject if symptom.code == "twice" else ""
        by_remark[remark].append(symptom)

    # Services' own words name no processes, so they join the first that were seen
    if len(by_remark) > 1:
        first = next(filter(None, by_remark))
        by_remark[first] += by_remark.pop("", [])

    for group in by_remark.values():
        group.sort(key=lambda symptom: symptom.code != "twice")
        services = {symptom.service for symptom in group}
        cause = _first_of(group, "twice")
        follow = find_consequences(services, seen)
        yield _also(cause, follow)


def _invalid(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain messages that several services drop by what writes them."""
    del seen
    invalid = _with_problem(symptoms, (INVALID,))
    warnings = {symptom.topic: symptom for symptom in _with_code(invalid, ("warning",))}

    # A warning names the writer, a counter only its topic
    by_writer: dict[str, list[Finding]] = defaultdict(list)
    for symptom in invalid:
        warning = warnings.get(symptom.topic)
        writer = symptom.topic if warning is None else warning.subject
        by_writer[writer].append(symptom)

    for group in by_writer.values():
        # The worst first, and of equals the counter: what it says of the writer joins the remedy
        group.sort(key=lambda symptom: (SEVERITIES.index(symptom.severity), symptom.code == "warning"))
        cause = _first_of(group, group[0].code)
        warning = warnings.get(cause.finding.topic)
        if cause.finding.code != "warning" and warning is not None:
            remedy = f"{warning.service} {warning.sentence}; {cause.finding.remedy}"
            cause = replace(cause, finding=replace(cause.finding, remedy=remedy))
        yield cause


def _failing(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain handlers that fail by the messages on which they do, and name the sender."""
    del seen
    failures = _with_problem(symptoms, (HANDLER,))
    growing = {symptom.service for symptom in _with_code(failures, ("failing",))}
    by_sender: dict[tuple[str, str], list[Finding]] = defaultdict(list)
    for symptom in _with_code(failures, ("warning",)):
        by_sender[symptom.topic, symptom.subject].append(symptom)
    for group in by_sender.values():
        services = {symptom.service for symptom in group}
        cause = _first_of(group, "failing")
        if services & growing:
            cause = replace(cause, finding=replace(cause.finding, severity="error"))

        def is_counter(symptom: Finding, services: set[str] = services) -> bool:
            if symptom.problem != HANDLER or symptom.code == "warning":
                return False
            return symptom.service in services

        yield _also(cause, is_counter)


def _late(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain what is late, or does not come, by the first of it on the way from the wrist."""
    late = list(filter(may_pass, symptoms))
    late.sort(key=lambda symptom: (_position(symptom), latency_s(seen.newest(symptom.service))))
    while late:
        first = late[0]
        follow = find_consequences(first.instances, seen)
        yield Cause(first, follow)
        late = [symptom for symptom in late[1:] if not follow(symptom)]


def _blocked(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain what a process does not do, or does late, by what blocks its event loop."""
    for report in _with_problem(symptoms, (EVENT_LOOP,)):
        process = seen.process_of(report.service)
        services = {report.service, *seen.processes.get(process, ())}
        sentence = f"process {process.pid} of machine {process.host}: {report.sentence}"
        finding = replace(report, severity="error", sentence=sentence, services=tuple(sorted(services)))
        cause = _process_cause(finding, seen)

        def is_same(symptom: Finding, services: set[str] = services) -> bool:
            if symptom.service not in services:
                return False
            return may_pass(symptom) or symptom.problem == EVENT_LOOP

        yield replace(_also(cause, is_same), symptom=report)


def _starved(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    for finding in starved_machines(filter(may_pass, symptoms), seen):
        follow = find_consequences(set(finding.services), seen)

        def explains(symptom: Finding, finding: Finding = finding) -> bool:
            return symptom.service in finding.services and may_pass(symptom)

        yield _also(Cause(finding=finding, explains=explains), follow)


def _position(finding: Finding) -> int:
    """Return the index in `CHAIN` of the first topic that is late, or that the service reads."""
    keys = [topic.key for topic in CHAIN]
    if finding.topic in keys:
        return keys.index(finding.topic)
    inputs = {topic.key for topic in _topics(finding.service, "reads")}
    for position, key in enumerate(keys):
        if key in inputs:
            return position
    return len(keys)


def _same_words(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain what several services of one process say in the same words, such as of their connection."""
    del seen
    by_sentence: dict[str, list[Finding]] = defaultdict(list)
    for symptom in _with_code(symptoms, ("warning",)):
        by_sentence[symptom.said or symptom.sentence].append(symptom)
    for group in by_sentence.values():
        if len(group) > 1:
            yield _first_of(group, "warning")


EXPLANATIONS: tuple[Explanation, ...] = (
    _lost_router, _clock, _disk, _rights, partial(_processes, stopped_services), _blocked, _starved,
    partial(_processes, gone_processes), _mass, _gone, _unwritten, _no_cursor, _duplicates, _invalid,
    _failing, _late, _same_words,
)  # fmt: skip
"""From the deepest causes to the nearest."""
OF_ONE_PERSON: tuple[Explanation, ...] = (
    _clock, _disk, _rights, _blocked, _starved, _unwritten, _duplicates, _invalid, _failing, _late,
    _same_words,
)  # fmt: skip
"""The same for what one person's services claim."""


def _also(cause: Cause, follows: Callable[[Finding], bool]) -> Cause:
    def explains(symptom: Finding) -> bool:
        return cause.explains(symptom) or follows(symptom)

    return replace(cause, explains=explains)


def _first_of(group: Symptoms, code: Code) -> Cause:
    """Return the first of `group` as the cause of the others, which it names."""
    first = group[0]
    services = tuple(filter(None, dict.fromkeys(symptom.service for symptom in group)))
    others = [instance for instance in services if instance != first.service]
    sentence = first.sentence
    if others:
        sentence += f" (also {few_of(others)})"
    finding = replace(first, code=code, sentence=sentence, services=services)
    return Cause(finding, lambda symptom: symptom in group, first)
