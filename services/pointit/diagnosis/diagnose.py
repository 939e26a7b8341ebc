"""Problems of a running site, from its services' reports. Pure."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from pointit.diagnosis.observation import Finding, Observation, Report, Severity
from pointit.diagnosis.outage import fold_outage
from pointit.diagnosis.staleness import stale_inputs
from pointit.diagnosis.writers import start_command
from pointit.runtime.bus.timeliness import LONGEST_HOST, REMEDY, ClockSkewMonitor
from pointit.runtime.config.similar_names import did_you_mean
from pointit.schemas import Health
from pointit.schemas.system import split_instance
from pointit.schemas.text import one_line, round_beyond
from pointit.schemas.topics import TOPICS, Delivery
from pointit.services.localizer.certainty import (
    ANCHOR_AGE,
    OLD_ANCHOR_S,
    POSITION_SIGMA,
    SURE_DEG,
    UNSURE_DEG,
    UNSURE_M,
    YAW_SIGMA,
    figure,
)
from pointit.services.registry import person_of

SLOW_S = 0.1
"""Latency from capture to output, 99th percentile, above which pointing feels detached from the hand, s."""
STARTING_S = 5.0
"""Time after its start in which a service is not called slow, s: others are loading modules beside it."""
UNCERTAIN = "uncertain"
"""Word in the localizer's own warnings about the pose."""


def diagnose(seen: Observation, is_sure: Callable[[Finding], bool] = lambda _: True) -> list[Finding]:
    """Return the problems that `is_sure`, the worst first."""
    found = [*_presence(seen), *find_clock_skew(seen), *_reports(seen), *stale_inputs(seen)]
    findings = fold_outage(_fold_slow([finding for finding in found if is_sure(finding)], seen), seen)
    order = ("error", "warning", "note")
    return sorted(findings, key=lambda finding: (order.index(finding.severity), finding.service))


def _fold_slow(findings: Sequence[Finding], seen: Observation) -> list[Finding]:
    """Return `findings`; of services that are slow, all but the first on the way from the person follow."""
    slow = {each.service: _behind_s(seen.newest(each.service)) for each in findings if each.code == "slow"}
    first = min(slow, key=lambda instance: slow[instance], default="")
    return [replace(each, follows=each.code == "slow" and each.service != first) for each in findings]


def _behind_s(health: Health | None) -> float:
    """Return its latency from capture to output, 99th percentile, s."""
    return 0.0 if health is None or health.latency is None else health.latency.p99_s


def is_healthy(findings: Sequence[Finding]) -> bool:
    """Return True if there is no current problem. Notes are about the past."""
    return all(finding.severity == "note" for finding in findings)


def _presence(seen: Observation) -> Iterator[Finding]:
    expected = seen.expected
    if seen.denied:
        yield Finding("error", "denied", "", seen.denied, "")
    elif not seen.present and not expected and seen.other_sites:
        are = "a site is" if len(seen.other_sites) == 1 else "sites are"
        sentence = f"no service runs on this site, but {are} there: {', '.join(seen.other_sites)}"
        yield Finding("error", "empty", "", sentence, f"name the right one: --site {seen.other_sites[0]}")
    elif not seen.present and not expected:
        remedy = (
            "start with `pointit run`, or name the right site with --site, or its address with --connect (of "
            "a run with --ros2: tcp/127.0.0.1:7448)"
        )
        yield Finding("error", "empty", "", "the router answers, but no service runs on this site", remedy)
    elif not expected and all(map(_is_router, seen.present)):
        remedy = (
            "start what all people share with `pointit run --site-only --credentials FOLDER/identities/"
            "supervisor`, then each person with `pointit person add NAME --credentials NAME`"
        )
        yield Finding("error", "empty", "", "nothing but the router runs on this site yet", remedy)
    for instance, remedy in expected.items():
        if instance not in seen.present:
            yield Finding("error", "absent", instance, "should run and does not", remedy)
    for instance in seen.left - seen.present - expected.keys():
        sentence = "was present and has left: ended, killed, stopped or cut off"
        yield Finding("warning", "left", instance, sentence, _restart(instance, seen.options))
    for instance in filter(seen.is_silent, seen.present):
        health = seen.newest(instance)
        silence_s = seen.silence_s(instance)
        sentence = (
            f"is present but has not reported for {silence_s:.0f} s: is it stopped, overloaded or cut off?"
        )
        again = expected.get(instance, _restart(instance, seen.options))
        process = f"process {health.pid}" if health else "its process"
        remedy = f"look at {process} (stopped: `kill -CONT`); else {again}"
        yield Finding("error", "silent", instance, sentence, remedy)


def _reports(seen: Observation) -> Iterator[Finding]:
    for instance, reports in seen.reports.items():
        if instance not in seen.present or not reports:
            continue
        health = reports[-1].health
        yield from _twice(seen, instance, reports)
        yield from _counters(instance, reports[0].health, health)
        yield from _certainty(instance, health)
        for sentence in map(one_line, health.warnings):
            remedy = "" if _says_what_to_do(sentence) else "look at its log, which has details"
            told = f"says: “{sentence}”" if person_of(instance) else sentence
            yield Finding("warning", "warning", instance, told, remedy)
        if health.status == "degraded" and not health.warnings:
            sentence = "reports itself as degraded without a reason"
            yield Finding("warning", "degraded", instance, sentence, "look at its log")
        late_s = [_behind_s(each.health) for each in reports if each.health.uptime_s >= STARTING_S]
        if min(late_s, default=0.0) > SLOW_S:
            sentence = (
                f"its output is {late_s[-1] * 1e3:.0f} ms behind the person "
                f"(99th percentile; {SLOW_S * 1e3:.0f} ms is too much)"
            )
            remedy = (
                "is the machine overloaded, are two machines' clocks apart, or has a link to LEDs "
                "more pixels than it carries?"
            )
            yield Finding("warning", "slow", instance, sentence, remedy)


def _says_what_to_do(warning: str) -> bool:
    """Return True if a warning continues after the problem: `...; do this`, `...: do this`."""
    return any(mark in warning for mark in ("; ", ": ", "`"))


def _twice(seen: Observation, instance: str, reports: Sequence[Report]) -> Iterator[Finding]:
    """Find two processes under one name. One that was only restarted is younger than our observation."""
    watched_s = seen.now_s - seen.began_s
    ages_s = {
        (report.health.host, report.health.pid): report.health.uptime_s + seen.now_s - report.received_s
        for report in reports
    }
    if len(ages_s) > 1 and min(ages_s.values()) > watched_s:
        pids = " and ".join(f"{pid} on {one_line(host, LONGEST_HOST) or '?'}" for host, pid in sorted(ages_s))
        remedy = "end all but one, or give each person their own --user"
        yield Finding("error", "twice", instance, f"runs more than once: processes {pids}", remedy)


def _counters(instance: str, first: Health, last: Health) -> Iterator[Finding]:
    """Find counters that should be 0: an error while one grows, a note afterwards."""
    before = {(key.key, key.direction): key for key in first.keys}
    for key in last.keys:
        old = before.get((key.key, key.direction), key)
        pattern = one_line(key.key)
        invalid = f"messages on {pattern} were invalid, and were dropped"
        other_version = "a writer of another version? `pointit --version` on both machines"
        yield from _counter(instance, key.invalid, old.invalid, invalid, other_version)
        lost = "the network loses more than can be fetched again: look at the link between the machines"
        yield from _counter(instance, key.lost, old.lost, f"events on {pattern} never arrived", lost)
        # for other topics only the newest counts
        if any(row.key == pattern and row.delivery is Delivery.EVENT for row in TOPICS):
            dropped = f"events on {pattern} were dropped: it reads too slowly"
            yield from _counter(instance, key.dropped, old.dropped, dropped, "is its machine overloaded?")
    yield from _counter(
        instance, last.errors, first.errors, "of its handlers' calls failed", "its log has the traceback"
    )


def _certainty(instance: str, health: Health) -> Iterator[Finding]:
    """Find a pose that is uncertain, and the remedy."""
    where_m, yaw_deg = figure(health, POSITION_SIGMA), figure(health, YAW_SIGMA)
    age_s = figure(health, ANCHOR_AGE)
    if any(UNCERTAIN in sentence for sentence in health.warnings):
        return  # it reports this itself, with a remedy
    who = split_instance(instance)[1] or "NAME"
    point = f"have them point at one lamp: `pointit person anchor {who}`, or press the button twice"
    if where_m is not None and where_m > UNSURE_M:
        sentence = (
            f"the person's position is uncertain by {round_beyond(where_m, UNSURE_M, 2)} m "
            f"(1 sigma, limit {UNSURE_M:g} m)"
        )
        remedy = (
            f"let them localize again: hold the button, or `pointit person press {who} --gesture hold`; "
            "point at more lamps with --targets"
        )
        yield Finding("warning", "unsure", instance, sentence, remedy)
    elif yaw_deg is not None and yaw_deg > UNSURE_DEG:
        sentence = (
            f"the person's yaw is uncertain by {round_beyond(yaw_deg, UNSURE_DEG)}° "
            f"(1 sigma, limit {UNSURE_DEG:g}°)"
        )
        sentence += "" if age_s is None else f", the last anchor is {age_s:.0f} s old"
        yield Finding("warning", "unsure", instance, sentence, point)
    elif age_s is not None and age_s > OLD_ANCHOR_S and (yaw_deg is None or yaw_deg > SURE_DEG):
        sentence = f"the last anchor is {age_s / 60:.0f} min old, and the IMU's yaw drifts"
        yield Finding("warning", "old-anchor", instance, sentence, point)


def _counter(instance: str, now: int, then: int, sentence: str, remedy: str) -> Iterator[Finding]:
    if not now:
        return
    if now > then:
        yield Finding("error", "failing", instance, f"{now} {sentence}, and the number grows", remedy)
    else:
        yield Finding("note", "failed", instance, f"{now} {sentence}, not any more", remedy)


def _restart(instance: str, options: str) -> str:
    if _is_router(instance):
        return "if it should run: pointit router --site-folder FOLDER"
    command = start_command(*split_instance(instance))
    return f"if it should run: {command}{options}" if command else "if it should run, start it where it ran"


def _is_router(instance: str) -> bool:
    return instance.partition(".")[0].partition("-")[0] == "router"


def find_clock_skew(seen: Observation) -> Iterator[Finding]:
    """Find machines with clock skew relative to ours, unless a keeper has reported it."""
    watch = ClockSkewMonitor(seen.host, window_s=seen.now_s - seen.began_s + 1.0)
    for reports in seen.reports.values():
        for report in reports:
            if report.arrived_ns is not None and report.health.host:
                watch.on_report(
                    report.health.host, report.health.stamp_ns, report.arrived_ns, report.received_s
                )
    keeper = seen.newest("keeper")
    said = " ".join(keeper.warnings) if keeper is not None else ""
    for skew in watch.skews(seen.now_s):
        if f"the clock of machine {skew.host} " not in said:
            severity: Severity = "error" if skew.exceeds_limit else "warning"
            yield Finding(severity, "clock", "", skew.sentence(seen.host), REMEDY)


def is_about(instance: str, name: str) -> bool:
    """Return True if `name` is the instance, its service or its person."""
    return name in (instance, *split_instance(instance))


def filter_findings(findings: Sequence[Finding], seen: Observation, name: str) -> list[Finding]:
    """Return the findings about `name`, or one that nothing of that name runs or should run.

    Without the right to view the site, all findings are returned.
    """
    if seen.denied:
        return list(findings)
    instances = {*seen.present, *seen.left, *seen.expected}
    if not any(is_about(instance, name) for instance in instances):
        there = sorted({part for instance in instances for part in split_instance(instance) if part})
        remedy = did_you_mean(name, there) or "start it, or see without --only what does"
        return [Finding("error", "absent", name, "does not run here", remedy)]
    return [each for each in findings if each.code == "unreachable" or is_about(each.service, name)]
