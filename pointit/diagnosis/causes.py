"""Deepest causes of symptoms: out of reach as a whole, machine, process, person, stream, in this order. Pure.

Each explanation takes the symptoms that no deeper cause has explained, and returns causes. What a cause
explains is not a problem of its own.
"""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from pointit.diagnosis.missing_services import (
    CHAIN,
    GONE,
    gone_processes,
    is_router,
    starved_machines,
    stopped_services,
)
from pointit.diagnosis.observation import CONTINUE, Code, Finding, Observation, Severity, StoppedProcess
from pointit.diagnosis.symptoms import latency_s
from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.link.link import AGAIN, Outage, find_outage
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
) -> Finding:
    """Return the finding of an observer that cannot join.

    `is_refused`: nothing listens at `connect`. `stopped`: processes of this machine that may be the router.
    `rejection`: reason and remedy if the router rejects the observer.
    """
    where = ", ".join(connect)
    if not is_refused and (pid := next((each.pid for each in stopped if each.may_route), 0)):
        sentence = f"the router at {where} does not answer: process {pid} is stopped (Ctrl-Z or SIGSTOP)"
        return _unreachable(sentence, CONTINUE.format(pid=pid), "stopped")
    if rejection:
        return _unreachable(rejection, "", "denied")
    if not is_refused:
        return _unreachable(
            f"the router at {where} does not answer", f"{AGAIN}; or give another address by --connect"
        )
    return _unreachable(
        f"nothing runs at {where}",
        "start its router with `pointit router`, or give its address by --connect"
        if is_secured
        else "start `pointit run`, or `pointit router` if services wait for it, give its address by "
        "--connect or, on a secured site, your identity by --credentials",
    )


def _outage(findings: Sequence[Finding], seen: Observation) -> Outage | None:
    gone = {each.service for each in findings if each.code in GONE}
    lost_router = next((each.subject for each in findings if each.problem == ROUTER_LOST), "")
    return find_outage(seen.present | seen.expected.keys() | gone, gone, lost_router)


def _unreachable(sentence: str, remedy: str, code: Code = "unreachable") -> Finding:
    return Finding("error", code, "", sentence, remedy)


def find_consequences(services: Collection[str], seen: Observation) -> Callable[[Finding], bool]:
    """Return a test for symptoms of others that follow if `services` do nothing, or do it wrongly."""
    written = {topic.key for each in services for topic in _topics(each, "writes")}
    names = {split_instance(each)[0] for each in services}
    affected = _readers(services, seen)

    def follows(each: Finding) -> bool:
        if each.code == "no-cursor":
            return bool(names & {split_instance(instance)[0] for instance in each.services})
        if each.service not in affected:
            return False
        if each.code in ("stale", "slow"):
            return True
        is_concerned = each.topic in written or each.subject in names or each.problem == LATE
        return each.code == "warning" and is_concerned

    return follows


def _readers(services: Collection[str], seen: Observation) -> set[str]:
    """Return `services` and those that read what they write, directly or through others."""
    affected = set(services)
    new = set(services)
    while new:
        written = [(person_of(each), topic) for each in new for topic in _topics(each, "writes")]
        new = {
            each
            for each in seen.present - affected
            if any(
                topic in _topics(each, "reads") and (not person or person_of(each) in ("", person))
                for person, topic in written
            )
        }
        affected |= new
    return affected


def _topics(instance: str, way: str) -> tuple[AnyTopic, ...]:
    row = row_of(split_instance(instance)[0])
    return () if row is None else getattr(row, way)


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
    explained_findings: list[Finding] = []
    unexplained = list(symptoms)
    people = sorted({_claimant(each) for each in symptoms} - {""})
    for person, explanation in [
        *(("", each) for each in EXPLANATIONS),
        *((person, each) for person in people for each in OF_ONE_PERSON),
    ]:
        considered = tuple(each for each in unexplained if _claimant(each) == person)
        for cause in explanation(considered, seen):
            findings.append(cause.finding)
            of_person = person or person_of(cause.finding.service)
            left: list[Finding] = []
            for each in unexplained:
                if each in (cause.finding, cause.symptom):
                    continue
                is_other = of_person and of_person not in (
                    _claimant(each),
                    person_of(each.service),
                    each.service,
                )
                if is_other or not cause.explains(each):
                    left.append(each)
                elif cause.finding.severity == "note":  # nothing is wrong
                    explained_findings.append(replace(each, severity="note"))
                else:
                    explained_findings.append(each)
            unexplained = left
    return [*findings, *unexplained, *(replace(each, follows=True) for each in explained_findings)]


def _claimant(finding: Finding) -> str:
    """Return the person whose services alone claim `finding`, or write the input that is missing, or `""`.

    What is gone is seen by its presence, which is not a claim.
    """
    if finding.code in GONE:
        return ""
    writers = {person_of(each) for each in finding.services if each != finding.service}
    is_of_person = finding.code == "stale" and len(writers) == 1
    return person_of(finding.service) or (writers.pop() if is_of_person else "")


def may_pass(finding: Finding) -> bool:
    """Return True if a short load can cause `finding`: it counts if it lasts."""
    return finding.code in PASSING or finding.problem == LATE


def _lost_router(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain services that are out of reach by the router that services say they have lost."""
    outage = _outage(symptoms, seen)
    if outage is None or outage.remedy != AGAIN:
        return
    is_error = any(each.code in GONE and each.severity == "error" for each in symptoms)
    severity: Severity = "error" if is_error else "warning"  # what it cannot reach is not expected here
    finding = replace(_unreachable(outage.sentence, outage.remedy), severity=severity)
    yield Cause(
        finding, lambda each: each.code in (*GONE, "stale", "no-cursor") or each.problem == ROUTER_LOST
    )


def _clock(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    by_host: dict[str, list[Finding]] = defaultdict(list)
    for each in symptoms:
        if each.problem in (CLOCK, CLOCK_LIMIT):
            by_host[each.subject].append(each)
    hosts = {health.host for name in seen.reports if not person_of(name) and (health := seen.newest(name))}
    for reporter in {"", *(each.service for group in by_host.values() for each in group)}:
        health = seen.newest(reporter)
        if len(by_host) > 1 and by_host.keys() >= hosts - {health.host if health else seen.host}:
            first, *others = by_host.values()  # the clock that is wrong is the reporter's
            by_host = {"": [*first, *(each for group in others for each in group)]}
    for group in by_host.values():
        is_far = group[0].problem == CLOCK_LIMIT

        def explains(each: Finding, group: Symptoms = group, *, is_far: bool = is_far) -> bool:
            is_late = each.code in ("stale", "slow", "no-cursor") or each.problem == LATE
            is_claim = each.problem in (CLOCK, CLOCK_LIMIT) and bool(person_of(each.service))
            return each in group or is_claim or (is_late and (is_far or each.code == "slow"))

        yield replace(_first_of(group, group[0].code), explains=explains)


def _disk(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    by_host: dict[str, list[Finding]] = defaultdict(list)
    host_of = {name: health.host for name in seen.reports if (health := seen.newest(name))}
    for each in symptoms:
        if each.problem == UNWRITABLE:
            by_host[host_of.get(each.service, "")].append(each)
    for host, group in by_host.items():

        def is_same(each: Finding, host: str = host) -> bool:
            return each.problem == UNWRITABLE and host_of.get(each.service, "") == host

        cause = _first_of(group, "disk")
        is_claim = bool(person_of(cause.finding.service))
        severity: Severity = "warning" if is_claim else "error"  # data of the site is lost
        yield _also(replace(cause, finding=replace(cause.finding, severity=severity)), is_same)


def _rights(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    by_name: dict[tuple[str, bool], list[Finding]] = defaultdict(list)
    revoked = {each.subject for each in symptoms if each.problem == REVOKED}
    for each in symptoms:
        if each.problem in (DENIED, REVOKED):  # a router tells a valid certificate from a revoked one
            is_valid = each.problem == DENIED and is_router(each.service) and each.subject in revoked
            by_name[each.subject, is_valid].append(each)
    for (name, _), group in by_name.items():
        own = sorted(group, key=lambda each: (each.problem == DENIED, is_router(each.service)))
        services = {each.service for each in group}
        cause = _first_of(own, "denied")
        follow = find_consequences(services, seen)
        if own[0].problem == DENIED and is_router(own[0].service):
            remedy = (
                f"start it with its own credentials instead of those of {name}, or end it"
                if name
                else "give it credentials by --credentials (`pointit site user add NAME`), or end it"
            )
            cause = replace(cause, finding=replace(cause.finding, remedy=remedy))

        def is_of_service(each: Finding, name: str = name, group: Symptoms = group) -> bool:
            is_denied = each.problem in (DENIED, REVOKED) and not is_router(each.service)
            is_same = is_denied and each.subject == name
            return each in group or is_same or (each.code in GONE and split_instance(each.service)[1] == name)

        yield _also(_also(cause, follow), is_of_service)


def _processes(
    find: Callable[[Symptoms, Observation], Iterator[Finding]], symptoms: Symptoms, seen: Observation
) -> Iterator[Cause]:
    yield from (_process_cause(finding, seen) for finding in find(symptoms, seen))


def _mass(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    if outage := _outage(symptoms, seen):
        finding = _unreachable(outage.sentence, outage.remedy)
        yield Cause(finding, lambda each: each.code in (*GONE, "stale", "slow", "no-cursor"))


def _gone(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    for each in symptoms:
        if each.code in GONE:
            yield Cause(each, find_consequences({each.service}, seen))


def _unwritten(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain inputs that never come by what their writer says of its device: that is the error, not they."""
    for each in symptoms:
        if each.problem in SILENCING and (stale := [of for of in symptoms if _waits_for(of, each.service)]):
            follow = find_consequences({each.service}, seen)
            is_idle = each.problem == IDLE_ARM
            finding = replace(each, severity="note" if is_idle else "error")
            yield _also(Cause(finding, stale.__contains__, each), follow)


def _waits_for(finding: Finding, writer: str) -> bool:
    return finding.code == "stale" and writer in finding.services and writer != finding.service


def _no_cursor(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    for each in symptoms:
        if each.code == "no-cursor":
            yield Cause(each, find_consequences(set(each.services), seen))


def _process_cause(finding: Finding, seen: Observation) -> Cause:
    services = set(finding.services)
    follow = find_consequences(services, seen)
    return Cause(finding, lambda each: (each.code in GONE and each.service in services) or follow(each))


def _duplicates(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    by_remark: dict[str, list[Finding]] = defaultdict(list)
    for each in symptoms:
        if each.problem == TWICE:
            by_remark[each.subject if each.code == "twice" else ""].append(each)
    if len(by_remark) > 1:  # the services' own words on it
        first = next(key for key in by_remark if key)
        by_remark[first] += by_remark.pop("", [])
    for group in by_remark.values():
        group.sort(key=lambda each: each.code != "twice")
        services = {each.service for each in group}
        cause = _first_of(group, "twice")
        follow = find_consequences(services, seen)
        yield _also(cause, follow)


def _invalid(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain messages that several services drop by what writes them."""
    del seen
    invalid = [each for each in symptoms if each.problem == INVALID]
    words = {each.topic: each for each in invalid if each.code == "warning"}
    by_writer: dict[str, list[Finding]] = defaultdict(list)
    for each in invalid:
        by_writer[words[each.topic].subject if each.topic in words else each.topic].append(each)
    for group in by_writer.values():
        group.sort(key=lambda each: (SEVERITIES.index(each.severity), each.code == "warning"))
        cause = _first_of(group, group[0].code)
        if cause.finding.code != "warning" and (told := words.get(cause.finding.topic)):
            remedy = f"{told.service} {told.sentence}; {cause.finding.remedy}"
            cause = replace(cause, finding=replace(cause.finding, remedy=remedy))
        yield cause


def _failing(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain handlers that fail by the messages on which they do, and name the sender."""
    del seen
    failures = [each for each in symptoms if each.problem == HANDLER]
    growing = {each.service for each in failures if each.code == "failing"}
    by_sender: dict[tuple[str, str], list[Finding]] = defaultdict(list)
    for each in failures:
        if each.code == "warning":
            by_sender[each.topic, each.subject].append(each)
    for group in by_sender.values():
        services = {each.service for each in group}
        cause = _first_of(group, "failing")
        if services & growing:
            cause = replace(cause, finding=replace(cause.finding, severity="error"))

        def is_counter(other: Finding, services: set[str] = services) -> bool:
            return other.problem == HANDLER and other.code != "warning" and other.service in services

        yield _also(cause, is_counter)


def _late(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain what is late, or does not come, by the first of it on the way from the wrist."""
    late = [each for each in symptoms if may_pass(each)]
    late.sort(key=lambda each: (_position(each), latency_s(seen.newest(each.service))))
    while late:
        first = late[0]
        follow = find_consequences(first.instances, seen)
        yield Cause(first, follow)
        late = [each for each in late[1:] if not follow(each)]


def _blocked(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain what a process does not do, or does late, by what blocks its event loop."""
    for each in symptoms:
        if each.problem == EVENT_LOOP:
            process = seen.process_of(each.service)
            services = {each.service, *seen.processes.get(process, ())}
            sentence = f"process {process.pid} of machine {process.host}: {each.sentence}"
            finding = replace(each, severity="error", sentence=sentence, services=tuple(sorted(services)))
            cause = _process_cause(finding, seen)

            def is_same(other: Finding, services: set[str] = services) -> bool:
                return other.service in services and (may_pass(other) or other.problem == EVENT_LOOP)

            yield replace(_also(cause, is_same), symptom=each)


def _starved(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    for finding in starved_machines(filter(may_pass, symptoms), seen):
        follow = find_consequences(set(finding.services), seen)

        def explains(each: Finding, finding: Finding = finding) -> bool:
            return each.service in finding.services and may_pass(each)

        yield _also(Cause(finding=finding, explains=explains), follow)


def _position(finding: Finding) -> int:
    """Return the index in `CHAIN` of the first topic that is late, or that the service reads."""
    keys = [topic.key for topic in CHAIN]
    if finding.topic in keys:
        return keys.index(finding.topic)
    row = row_of(split_instance(finding.service)[0])
    reads = [topic.key for topic in row.reads] if row else []
    return min((keys.index(key) for key in reads if key in keys), default=len(keys))


def _same_words(symptoms: Symptoms, seen: Observation) -> Iterator[Cause]:
    """Explain what several services of one process say in the same words, such as of their connection."""
    del seen
    by_sentence: dict[str, list[Finding]] = defaultdict(list)
    for each in symptoms:
        if each.code == "warning":
            by_sentence[each.said or each.sentence].append(each)
    yield from (_first_of(group, "warning") for group in by_sentence.values() if len(group) > 1)


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
    def explains(each: Finding) -> bool:
        return cause.explains(each) or follows(each)

    return replace(cause, explains=explains)


def _first_of(group: Symptoms, code: Code) -> Cause:
    """Return the first of `group` as the cause of the others, which it names."""
    first = group[0]
    services = tuple(dict.fromkeys(each.service for each in group if each.service))
    others = [each for each in services if each != first.service]
    also = f" (also {few_of(others)})" if others else ""
    cause = replace(first, code=code, sentence=f"{first.sentence}{also}", services=services)
    return Cause(cause, lambda each: each in group, first)
