"""Symptoms in services' reports: duplicates, counters, warnings, uncertain poses, slowness. Pure."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from pointit.diagnosis.observation import BUSY_START_S, DiagnosisReport, Finding, Observation
from pointit.geometry import floor_sigma
from pointit.runtime.bus.timeliness import LONGEST_HOST
from pointit.schemas import Health, UserPose
from pointit.schemas.problems import HANDLER, IDLE_ARM, INVALID, REFUSED_ACTS, TWICE, UNCERTAIN
from pointit.schemas.system import split_instance
from pointit.schemas.table_types import fill_key
from pointit.schemas.text import all_of, one_line, round_beyond
from pointit.schemas.topics import TOPICS, Delivery
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.registry import moves_arm, person_of

_LOCALIZER = LocalizerConfig()

UNSURE_M = 1.2
"""Standard deviation above which a position is uncertain: things 3 m away and 2 m apart are confused."""
UNSURE_DEG = _LOCALIZER.drift.max_yaw_sigma_deg
"""The same of a yaw."""

OLD_ANCHOR_S = 180.0
"""Age of an anchor at which the yaw of a common IMU may be 45 deg off. It may still be certain."""

SURE_DEG = _LOCALIZER.enough.yaw_deg
"""Standard deviation of the yaw at which localization ends."""

ANCHOR_AGE = "anchor age"
"""Name of a metric of the localizer, as are those below."""
POSITION_SIGMA = "position σ"  # noqa: RUF001 - the localizer's own
YAW_SIGMA = "yaw σ"  # noqa: RUF001 - the localizer's own

SLOW_S = 0.1
"""Latency from capture to output, 99th percentile, above which pointing feels detached from the hand, s."""


def yaw_sigma_deg(pose: UserPose) -> float:
    """Return the standard deviation of the yaw. 0: assumed exact."""
    return math.degrees(floor_sigma.yaw_sigma_rad(pose.covariance))


def figure(health: Health, name: str) -> float | None:
    """Return the value of a service's metric, or None."""
    return next((figure.value for figure in health.figures if figure.name == name), None)


def latency_s(health: Health | None) -> float:
    """Return its latency from capture to output, 99th percentile, s."""
    return 0.0 if health is None or health.latency is None else health.latency.p99_s


def find_in_reports(seen: Observation) -> Iterator[Finding]:
    """Find what reports state: duplicates, faults, warnings, uncertain poses and high latencies."""
    for instance, reports in seen.reports.items():
        if instance not in seen.present or not reports:
            continue
        health = reports[-1].health
        yield from _twice(seen, instance, reports)
        yield from _counters(instance, reports[0].health, health)
        yield from _certainty(instance, health)
        for problem in health.all_problems:
            sentence = one_line(problem.sentence)
            subject = one_line(problem.subject, LONGEST_HOST)
            if problem.code == REFUSED_ACTS and subject in seen.present:
                continue  # it reports its own problem
            if problem.code == IDLE_ARM and _is_simulated(person_of(instance), seen):
                continue  # a simulated person has it, of whatever package
            is_note = problem.severity == "note"
            text = f"says: “{sentence}”" if person_of(instance) and not is_note else sentence
            yield Finding(
                problem.severity,
                "idle" if is_note else "warning",
                instance,
                text,
                "",
                topic=one_line(problem.topic),
                problem=problem.code,
                subject=subject,
                said=sentence,
            )
        if health.status == "degraded" and not health.all_problems:
            sentence = "reports itself as degraded without a reason"
            yield Finding("warning", "degraded", instance, sentence, "look at its log")
        late_s = sorted(latency_s(each.health) for each in reports if each.health.uptime_s >= BUSY_START_S)
        if late_s and (usual_s := late_s[(len(late_s) - 1) // 2]) > SLOW_S:
            sentence = (
                f"its output is {round_beyond(usual_s * 1e3, SLOW_S * 1e3, 0)} ms behind the person "
                f"(99th percentile; {SLOW_S * 1e3:.0f} ms is too much)"
            )
            remedy = (
                "is the machine overloaded, are two machines' clocks apart, or has a link to LEDs "
                "more pixels than it carries?"
            )
            yield Finding("warning", "slow", instance, sentence, remedy)


def _twice(seen: Observation, instance: str, reports: Sequence[DiagnosisReport]) -> Iterator[Finding]:
    """Find two processes under one name. One that was only restarted is younger than our observation."""
    watched_s = seen.now_s - seen.began_s
    ages_s = {
        (report.health.host, report.health.pid): report.health.uptime_s + seen.now_s - report.received_s
        for report in reports
    }
    if len(ages_s) > 1 and min(ages_s.values()) > watched_s:
        pids = all_of(f"{pid} on {one_line(host, LONGEST_HOST) or '?'}" for host, pid in sorted(ages_s))
        remedy = "end all but one, or give each person their own --user"
        sentence = f"runs more than once: processes {pids}"
        yield Finding("error", "twice", instance, sentence, remedy, problem=TWICE, subject=pids)


def _counters(instance: str, first: Health, last: Health) -> Iterator[Finding]:
    """Find counters that should be 0: an error while one grows, a note afterwards."""
    before = {(key.key, key.direction): key for key in first.keys}
    for key in last.keys:
        old = before.get((key.key, key.direction), key)
        pattern = one_line(key.key)
        shown = fill_key(pattern, person_of(instance))
        invalid = f"messages on {shown} were invalid, and were dropped"
        other_version = "a writer of another version? `pointit --version` on both machines"
        lost = "the network loses more than can be fetched again: look at the link between the machines"
        # for other topics only the newest counts
        is_event = any(row.key == pattern and row.delivery is Delivery.EVENT for row in TOPICS)
        dropped = f"events on {shown} were dropped: it reads too slowly"
        for problem, findings in (
            (INVALID, _counter(instance, key.invalid, old.invalid, invalid, other_version)),
            ("lost", _counter(instance, key.lost, old.lost, f"events on {shown} never arrived", lost)),
            (
                "dropped",
                _counter(
                    instance, key.dropped * is_event, old.dropped, dropped, "is its machine overloaded?"
                ),
            ),
        ):
            yield from (replace(each, topic=pattern, problem=problem) for each in findings)
    failures = _counter(
        instance, last.errors, first.errors, "of its handlers' calls failed", "its log has the traceback"
    )
    yield from (replace(each, problem=HANDLER) for each in failures)


def _is_simulated(user: str, seen: Observation) -> bool:
    """Return True if a simulated person moves the arm of `user`."""
    return any(moves_arm(service) and who == user for service, who in map(split_instance, seen.present))


def _certainty(instance: str, health: Health) -> Iterator[Finding]:
    """Find a pose that is uncertain, and the remedy."""
    where_m = figure(health, POSITION_SIGMA)
    yaw_deg = figure(health, YAW_SIGMA)
    age_s = figure(health, ANCHOR_AGE)
    if any(each.code == UNCERTAIN for each in health.all_problems):
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
