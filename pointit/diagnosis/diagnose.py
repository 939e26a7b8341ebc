"""Problems of a running site: symptoms, of which each deepest cause is a finding. Pure."""

import math
from collections.abc import Callable, Iterator, Sequence

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


def stale_inputs(seen: Observation) -> Iterator[Finding]:
    """Find old inputs with a present writer, reporting the first cause only."""
    stale: dict[str, list[tuple[AnyTopic, KeyHealth, list[str]]]] = {}
    for instance, health in ((instance, seen.newest(instance)) for instance in seen.present):
        for topic, key in _rated(health, "in"):
            if health is None or not _is_old(key, topic, seen, health.uptime_s):
                continue
            if key.age_s is not None and key.age_s < _span_s(seen, instance):
                continue  # messages came between its last two reports
            able = present_writers(topic, health.user or ANY, seen.present)
            new_s = min(GRACE_S, math.inf if key.age_s is None else key.age_s)  # the message is another's
            old = [each for each in able if not is_bridge(each) and not seen.has_just_begun(each, new_s)]
            writers = [each for each in old if _is_read(seen, instance, topic, each)]
            if writers and (topic not in PAUSES or _written(seen, topic, writers)):
                stale.setdefault(instance, []).append((topic, key, writers))
    for instance, inputs in stale.items():
        for topic, key, writers in inputs:
            if _written(seen, topic, writers):
                remedy = f"{writers[0]} does write it: what is between the two? A link, an access rule?"
            elif any(writer in stale or seen.newest(writer) is None for writer in writers):
                continue  # the writer's own problem is the cause
            else:
                remedy = _look_at(seen, writers[0])
            age = "never came" if key.age_s is None else f"is {key.age_s:.1f} s old"
            people = set(map(person_of, writers))
            key_name = fill_key(topic.key, person_of(instance) or (people.pop() if len(people) == 1 else ""))
            sentence = f"its input {key_name} {age}, though {all_of(writers)} should write it"
            yield Finding(
                "error", "stale", instance, sentence, remedy, topic=topic.key, services=(instance, *writers)
            )


def _is_read(seen: Observation, instance: str, topic: AnyTopic, writer: str) -> bool:
    """Return True if `instance` certainly reads what `writer` writes.

    A shard must hear the person after whom it is called: presence does not tell whom others it serves. The
    default instance must hear the people whom no shard of its service serves.
    """
    service, which = split_instance(instance)
    row = row_of(service)
    is_shared = row is not None and row.shard_serves is not None and topic.placeholder == "user"
    if not is_shared or not any(each.startswith(f"{service}.") for each in seen.present):
        return True
    person = person_of(writer)
    if which or seen.shards is None:
        return bool(which) and person == which
    if person:
        return instance_of(service, person) not in seen.shards
    source, of = split_instance(writer)  # a shared service writes of whom its own shards do not serve
    return not of and _served(seen.shards, service) <= _served(seen.shards, source)


def _served(shards: frozenset[str], service: str) -> set[str]:
    return {person for name, person in map(split_instance, shards) if name == service}


def _look_at(seen: Observation, writer: str) -> str:
    health = seen.newest(writer)
    if health is not None and health.warnings:
        return f"look at {writer}, which says: “{one_line(health.warnings[0])}”"
    return f"look at {writer}: has its device, recording or input ended?"


def _is_old(key: KeyHealth | None, topic: AnyTopic, seen: Observation, uptime_s: float) -> bool:
    if key is None or topic.stale_after_s is None:
        return False
    if key.age_s is None:
        return uptime_s > GRACE_S
    return key.age_s > max(topic.stale_after_s / min(seen.speed, 1.0), MAX_INPUT_AGE_S)


def _span_s(seen: Observation, instance: str) -> float:
    """Return the time between the last two reports of `instance`, s, or 0 if there is one only."""
    reports = seen.reports.get(instance, ())
    return reports[-1].received_s - reports[-2].received_s if len(reports) > 1 else 0.0


def _written(seen: Observation, topic: AnyTopic, writers: Sequence[str]) -> bool:
    for writer in writers:
        health = seen.newest(writer)
        for other, key in _rated(health, "out"):
            if other is topic and key.age_s is not None and not _is_old(key, topic, seen, 0.0):
                return True
    return False


def _rated(health: Health | None, direction: str) -> Iterator[tuple[AnyTopic, KeyHealth]]:
    """Yield the topics with a nominal rate that a service reads or writes."""
    for key in health.keys if health is not None else ():
        topic = next((row for row in TOPICS if row.key == key.key), None)
        if topic is not None and topic.rate_hz is not None and key.direction == direction:
            yield topic, key


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
    findings = explain([each for each in symptoms if is_sure(each)], seen)
    return sorted(
        findings,
        key=lambda finding: (
            SEVERITIES.index(finding.severity),
            bool(person_of(finding.service)),
            finding.service,
        ),
    )


def is_healthy(findings: Sequence[Finding]) -> bool:
    """Return True if there is no current problem. Notes are about the past."""
    return all(finding.severity == "note" for finding in findings)


def find_clock_skew(seen: Observation) -> Iterator[Finding]:
    """Find machines with clock skew relative to ours, unless a keeper has reported it."""
    skew_monitor = ClockSkewMonitor(seen.host, window_s=seen.now_s - seen.began_s + 1.0)
    for instance, reports in seen.reports.items():
        for report in reports:
            if report.arrived_ns is not None and (host := report.health.host):
                stamps_ns = report.health.stamp_ns, report.arrived_ns
                skew_monitor.on_report(host, *stamps_ns, report.received_s, person_of(instance))
    keeper = seen.newest("keeper")
    reported_hosts = {
        each.subject
        for each in (keeper.all_problems if keeper else ())
        if each.code in (CLOCK, CLOCK_CLAIM, CLOCK_LIMIT)
    }
    for skew in skew_monitor.skews(seen.now_s):
        if skew.host not in reported_hosts:
            severity: Severity = "error" if skew.exceeds_limit else "warning"
            problem = CLOCK_LIMIT if skew.exceeds_limit else CLOCK
            claimants = (each for each in sorted(seen.reports) if person_of(each) == skew.claimant)
            service = next(claimants, "") if skew.claimant else ""
            sentence = skew.sentence(seen.host)
            yield Finding(severity, "clock", service, sentence, REMEDY, problem=problem, subject=skew.host)


def is_about(instance: str, name: str) -> bool:
    """Return True if `name` is the instance, its service or its person."""
    return name in (instance, *split_instance(instance))


def filter_findings(findings: Sequence[Finding], seen: Observation, name: str) -> list[Finding]:
    """Return the findings about `name` and their causes, or one that nothing of that name runs or should run.

    Without the right to view the site, all findings are returned.
    """
    if seen.denied:
        return list(findings)
    instances = {*seen.present, *seen.left, *seen.expected, *(name for name in seen.deployments)}
    if not any(is_about(instance, name) for instance in instances):
        there = sorted({part for instance in instances for part in split_instance(instance) if part})
        remedy = did_you_mean(name, there) or "start it, or see without --only what does"
        return [Finding("error", "absent", name, "does not run here", remedy)]
    return [
        each
        for each in findings
        if each.code == "unreachable" or any(is_about(instance, name) for instance in each.instances)
    ]
