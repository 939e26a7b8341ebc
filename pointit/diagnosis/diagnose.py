"""Problems of a running site: symptoms, of which each deepest cause is a finding. Pure."""

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import NamedTuple

from pointit.diagnosis.causes import SEVERITIES, explain
from pointit.diagnosis.missing_services import (
    find_empty_site,
    find_missing,
    find_missing_bridge,
    find_people_without_cursor,
)
from pointit.diagnosis.observation import Finding, Observation, Severity, is_bridge
from pointit.diagnosis.symptoms import find_in_reports
from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.bus.timeliness import REMEDY, ClockSkewMonitor
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.schemas import Health, KeyHealth
from pointit.schemas.problems import CLOCK, CLOCK_CLAIM, CLOCK_LIMIT
from pointit.schemas.system import instance_of, split_instance
from pointit.schemas.table_types import fill_key
from pointit.schemas.text import all_of, one_line
from pointit.schemas.topics import ANY, CURSOR, HOVER, TOPICS
from pointit.services.registry import person_of, present_writers, row_of

GRACE_S = 3.0
"""Uptime within which a service need not have received its inputs, nor written its outputs, s."""

MAX_INPUT_AGE_S = 1.0
"""Minimum age of an input that has ended, s. A busy machine makes pauses, which end."""

PAUSES = (CURSOR, HOVER)
"""Topics with a rate that pause while no person points."""


class _StaleInput(NamedTuple):
    topic: AnyTopic
    key: KeyHealth
    writers: list[str]
    """Present instances that should write it."""


def stale_inputs(seen: Observation) -> Iterator[Finding]:
    """Find old inputs with a present writer, reporting the first cause only."""
    stale: dict[str, list[_StaleInput]] = {}
    for instance in seen.present:
        inputs = list(_stale_inputs_of(seen, instance))
        if inputs:
            stale[instance] = inputs

    for instance, inputs in stale.items():
        for topic, key, writers in inputs:
            # A writer that lacks its own input, or does not report, has a finding of its own
            if _is_written(seen, topic, writers):
                remedy = f"{writers[0]} does write it: what is between the two? A link, an access rule?"
            elif any(_has_own_finding(seen, writer, stale) for writer in writers):
                continue
            else:
                remedy = _writer_remedy(seen, writers[0])

            age = "never came" if key.age_s is None else f"is {key.age_s:.1f} s old"
            people = set(map(person_of, writers))
            user = person_of(instance)
            if not user and len(people) == 1:
                user = people.pop()
            key_name = fill_key(topic.key, user)
            sentence = f"its input {key_name} {age}, though {all_of(writers)} should write it"
            yield Finding(
                "error", "stale", instance, sentence, remedy, topic=topic.key, services=(instance, *writers)
            )


def _stale_inputs_of(seen: Observation, instance: str) -> Iterator[_StaleInput]:
    health = seen.newest(instance)
    if health is None:
        return
    for topic, key in _rated_topics(health, "in"):
        if not _is_old(key, topic, seen, health.uptime_s):
            continue
        # Messages came between its last two reports
        if key.age_s is not None and key.age_s < _span_s(seen, instance):
            continue
        # A writer that began after the last message has not sent it: it may need more time
        new_s = GRACE_S if key.age_s is None else min(GRACE_S, key.age_s)
        writers: list[str] = []
        for writer in present_writers(topic, health.user or ANY, seen.present):
            if is_bridge(writer) or seen.has_just_begun(writer, new_s):
                continue
            if _is_read(seen, instance, topic, writer):
                writers.append(writer)
        if not writers:
            continue
        if topic not in PAUSES or _is_written(seen, topic, writers):
            yield _StaleInput(topic, key, writers)


def _has_own_finding(seen: Observation, writer: str, stale: Collection[str]) -> bool:
    return writer in stale or seen.newest(writer) is None


def _is_read(seen: Observation, instance: str, topic: AnyTopic, writer: str) -> bool:
    """Return True if `instance` certainly reads what `writer` writes.

    A shard must hear the person after whom it is called: presence does not tell whom others it serves. The
    default instance must hear the people whom no shard of its service serves.
    """
    # Where no shard runs, an instance reads all
    service, shard = split_instance(instance)
    row = row_of(service)
    if row is None or row.shard_serves is None or topic.placeholder != "user":
        return True
    if not any(name.startswith(f"{service}.") for name in seen.present):
        return True

    person = person_of(writer)
    if shard:
        return person == shard
    if seen.shards is None:
        return False
    if person:
        return instance_of(service, person) not in seen.shards
    # A shared service writes of those whom its own shards do not serve
    source, source_shard = split_instance(writer)
    return not source_shard and _served(seen.shards, service) <= _served(seen.shards, source)


def _served(shards: frozenset[str], service: str) -> set[str]:
    people: set[str] = set()
    for shard in shards:
        shard_service, person = split_instance(shard)
        if shard_service == service:
            people.add(person)
    return people


def _writer_remedy(seen: Observation, writer: str) -> str:
    health = seen.newest(writer)
    if health is not None and health.warnings:
        return f"look at {writer}, which says: “{one_line(health.warnings[0])}”"
    return f"look at {writer}: has its device, recording or input ended?"


def _is_old(key: KeyHealth, topic: AnyTopic, seen: Observation, uptime_s: float) -> bool:
    if topic.stale_after_s is None:
        return False
    if key.age_s is None:
        return uptime_s > GRACE_S
    return key.age_s > max(topic.stale_after_s / min(seen.speed, 1.0), MAX_INPUT_AGE_S)


def _span_s(seen: Observation, instance: str) -> float:
    """Return the time between the last two reports of `instance`, s, or 0 if there is one only."""
    reports = seen.reports.get(instance, ())
    if len(reports) < 2:
        return 0.0
    return reports[-1].received_s - reports[-2].received_s


def _is_written(seen: Observation, topic: AnyTopic, writers: Sequence[str]) -> bool:
    for writer in writers:
        health = seen.newest(writer)
        if health is None:
            continue
        for output, key in _rated_topics(health, "out"):
            if output is not topic or key.age_s is None:
                continue
            if not _is_old(key, topic, seen, 0.0):
                return True
    return False


def _rated_topics(health: Health, direction: str) -> Iterator[tuple[AnyTopic, KeyHealth]]:
    """Yield the topics with a nominal rate that a service reads or writes."""
    for key in health.keys:
        if key.direction != direction:
            continue
        topic = _topic_of(key.key)
        if topic is not None and topic.rate_hz is not None:
            yield topic, key


def _topic_of(key: str) -> AnyTopic | None:
    for topic in TOPICS:
        if topic.key == key:
            return topic
    return None


def diagnose(seen: Observation, is_sure: Callable[[Finding], bool] = lambda _: True) -> list[Finding]:
    """Return the problems that `is_sure`, the worst first.

    Those that another one explains have `follows`: they are not problems of their own.
    """
    symptoms = (
        *find_empty_site(seen),
        *find_missing(seen),
        *find_people_without_cursor(seen),
        *find_missing_bridge(seen),
        *find_clock_skew(seen),
        *find_in_reports(seen),
        *stale_inputs(seen),
    )
    findings = explain(list(filter(is_sure, symptoms)), seen)
    return sorted(findings, key=_rank)


def _rank(finding: Finding) -> tuple[int, bool, str]:
    """Return the key of the order of findings: of equal severity, what all people share comes first."""
    severity = SEVERITIES.index(finding.severity)
    is_of_person = bool(person_of(finding.service))
    return severity, is_of_person, finding.service


def is_healthy(findings: Sequence[Finding]) -> bool:
    """Return True if there is no current problem. Notes are about the past."""
    return all(finding.severity == "note" for finding in findings)


def find_clock_skew(seen: Observation) -> Iterator[Finding]:
    """Find machines with clock skew relative to ours, unless a keeper has reported it."""
    skew_monitor = ClockSkewMonitor(seen.host, window_s=seen.now_s - seen.began_s + 1.0)
    for instance, reports in seen.reports.items():
        for report in reports:
            host = report.health.host
            if report.arrived_ns is None or not host:
                continue
            skew_monitor.on_report(
                host, report.health.stamp_ns, report.arrived_ns, report.received_s, person_of(instance)
            )

    # The keeper observes for longer, so its report replaces ours
    keeper = seen.newest("keeper")
    reported_hosts: set[str] = set()
    for problem in keeper.all_problems if keeper else ():
        if problem.code in (CLOCK, CLOCK_CLAIM, CLOCK_LIMIT):
            reported_hosts.add(problem.subject)

    for skew in skew_monitor.skews(seen.now_s):
        if skew.host in reported_hosts:
            continue
        severity: Severity = "error" if skew.exceeds_limit else "warning"
        code = CLOCK_LIMIT if skew.exceeds_limit else CLOCK
        service = ""
        if skew.claimant:
            service = _first_reporter(seen, skew.claimant)
        sentence = skew.sentence(seen.host)
        yield Finding(severity, "clock", service, sentence, REMEDY, problem=code, subject=skew.host)


def _first_reporter(seen: Observation, person: str) -> str:
    for instance in sorted(seen.reports):
        if person_of(instance) == person:
            return instance
    return ""


def is_about(instance: str, name: str) -> bool:
    """Return True if `name` is the instance, its service or its person."""
    return name in (instance, *split_instance(instance))


def filter_findings(findings: Sequence[Finding], seen: Observation, name: str) -> list[Finding]:
    """Return the findings about `name` and their causes, or one that nothing of that name runs or should run.

    Without the right to view the site, all findings are returned.
    """
    if seen.denied:
        return list(findings)

    # A name that nothing has is probably misspelt
    instances = {*seen.present, *seen.left, *seen.expected, *seen.deployments}
    if not any(is_about(instance, name) for instance in instances):
        names: set[str] = set()
        for instance in instances:
            names.update(split_instance(instance))
        remedy = did_you_mean(name, sorted(names - {""})) or "start it, or see without --only what does"
        return [Finding("error", "absent", name, "does not run here", remedy)]

    # A router that cannot be reached concerns everybody
    selected: list[Finding] = []
    for finding in findings:
        is_named = any(is_about(instance, name) for instance in finding.instances)
        if is_named or finding.code == "unreachable":
            selected.append(finding)
    return selected
