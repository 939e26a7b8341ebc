"""Symptoms in services' reports: duplicates, counters, warnings, uncertain poses, slowness. Pure."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from pointit.diagnosis.observation import BUSY_START_S, DiagnosisReport, Finding, Observation
from pointit.geometry import floor_sigma
from pointit.runtime.bus.timeliness import LONGEST_HOST
from pointit.runtime.host.advised_commands import AdvisedCommands
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
    for metric in health.figures:
        if metric.name == name:
            return metric.value
    return None


def latency_s(health: Health | None) -> float:
    """Return its latency from capture to output, 99th percentile, s."""
    if health is None or health.latency is None:
        return 0.0
    return health.latency.p99_s


def find_in_reports(seen: Observation) -> Iterator[Finding]:
    """Find what reports state: duplicates, faults, warnings, uncertain poses and high latencies."""
    for instance, reports in seen.reports.items():
        if instance not in seen.present or not reports:
            continue

        # Numbers first, then the service's own words
        health = reports[-1].health
        yield from _twice(seen, instance, reports)
        yield from _counters(instance, reports[0].health, health, seen.commands)
        yield from _certainty(instance, health, seen.commands)
        yield from _problems(seen, instance, health)
        if health.status == "degraded" and not health.all_problems:
            sentence = "reports itself as degraded without a reason"
            yield Finding("warning", "degraded", instance, sentence, "look at its log")
        yield from _slowness(instance, reports)


def _problems(seen: Observation, instance: str, health: Health) -> Iterator[Finding]:
    """Find what a service says of itself, in its own words."""
    user = person_of(instance)
    for problem in health.all_problems:
        sentence = one_line(problem.sentence)
        subject = one_line(problem.subject, LONGEST_HOST)
        # A carrier that is present reports its own problem
        if problem.code == REFUSED_ACTS and subject in seen.present:
            continue
        # A simulated person has an idle arm, of whatever package
        if problem.code == IDLE_ARM and _is_simulated(user, seen):
            continue
        is_note = problem.severity == "note"
        text = sentence
        if user and not is_note:
            text = f"says: “{sentence}”"
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


def _slowness(instance: str, reports: Sequence[DiagnosisReport]) -> Iterator[Finding]:
    """Find a high latency, by the median of the reports after the service's start."""
    late_s: list[float] = []
    for report in reports:
        if report.health.uptime_s >= BUSY_START_S:
            late_s.append(latency_s(report.health))
    if not late_s:
        return
    late_s.sort()
    usual_s = late_s[(len(late_s) - 1) // 2]
    if usual_s > SLOW_S:
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
    ages_s: dict[tuple[str, int], float] = {}
    for report in reports:
        process = (report.health.host, report.health.pid)
        ages_s[process] = report.health.uptime_s + seen.now_s - report.received_s
    if len(ages_s) > 1 and min(ages_s.values()) > watched_s:
        places: list[str] = []
        for host, pid in sorted(ages_s):
            name = one_line(host, LONGEST_HOST) or "?"
            places.append(f"{pid} on {name}")
        pids = all_of(places)
        remedy = "end all but one, or give each person their own --user"
        sentence = f"runs more than once: processes {pids}"
        yield Finding("error", "twice", instance, sentence, remedy, problem=TWICE, subject=pids)


def _counters(instance: str, first: Health, last: Health, commands: AdvisedCommands) -> Iterator[Finding]:
    """Find counters that should be 0: an error while one grows, a note afterwards."""
    before = {(key.key, key.direction): key for key in first.keys}
    for key in last.keys:
        old = before.get((key.key, key.direction), key)
        pattern = one_line(key.key)
        shown = fill_key(pattern, person_of(instance))

        # Messages that could not be read
        text = f"messages on {shown} were invalid, and were dropped"
        version = commands.command("pointit --version")
        remedy = f"a writer of another version? {version} on both machines"
        for finding in _counter(instance, key.invalid, old.invalid, text, remedy):
            yield replace(finding, topic=pattern, problem=INVALID)

        # Events that were lost on the way
        text = f"events on {shown} never arrived"
        remedy = "the network loses more than can be fetched again: look at the link between the machines"
        for finding in _counter(instance, key.lost, old.lost, text, remedy):
            yield replace(finding, topic=pattern, problem="lost")

        # Events that waited for too long. Of other topics only the newest message counts
        dropped = key.dropped if _is_event(pattern) else 0
        text = f"events on {shown} were dropped: it reads too slowly"
        for finding in _counter(instance, dropped, old.dropped, text, "is its machine overloaded?"):
            yield replace(finding, topic=pattern, problem="dropped")

    text = "of its handlers' calls failed"
    for finding in _counter(instance, last.errors, first.errors, text, "its log has the traceback"):
        yield replace(finding, problem=HANDLER)


def _is_event(key: str) -> bool:
    """Return True if each message of the topic with this key is an event."""
    for topic in TOPICS:
        if topic.key == key and topic.delivery is Delivery.EVENT:
            return True
    return False


def _is_simulated(user: str, seen: Observation) -> bool:
    """Return True if a simulated person moves the arm of `user`."""
    for service, person in map(split_instance, seen.present):
        if moves_arm(service) and person == user:
            return True
    return False


def _certainty(instance: str, health: Health, commands: AdvisedCommands) -> Iterator[Finding]:
    """Find a pose that is uncertain, and the remedy."""
    # A service that reports this itself gives a remedy, too
    if any(problem.code == UNCERTAIN for problem in health.all_problems):
        return
    position_m = figure(health, POSITION_SIGMA)
    yaw_deg = figure(health, YAW_SIGMA)
    age_s = figure(health, ANCHOR_AGE)
    user = split_instance(instance)[1] or "NAME"

    # Position: one lamp does not determine it, so they have to localize
    if position_m is not None and position_m > UNSURE_M:
        sentence = (
            f"the person's position is uncertain by {round_beyond(position_m, UNSURE_M, 2)} m "
            f"(1 sigma, limit {UNSURE_M:g} m)"
        )
        hold = commands.command(f"pointit person press {user} --gesture hold", user)
        remedy = f"let them localize again: hold the button, or {hold}; point at more lamps with --targets"
        yield Finding("warning", "unsure", instance, sentence, remedy)
        return

    # Yaw: known to be uncertain, or so old that its uncertainty means little
    anchor_command = commands.command(f"pointit person anchor {user}", user)
    anchor = f"have them point at one lamp: {anchor_command}, or press the button twice"
    if yaw_deg is not None and yaw_deg > UNSURE_DEG:
        sentence = (
            f"the person's yaw is uncertain by {round_beyond(yaw_deg, UNSURE_DEG)}° "
            f"(1 sigma, limit {UNSURE_DEG:g}°)"
        )
        if age_s is not None:
            sentence += f", the last anchor is {age_s:.0f} s old"
        yield Finding("warning", "unsure", instance, sentence, anchor)
        return
    is_unsure = yaw_deg is None or yaw_deg > SURE_DEG
    if age_s is not None and age_s > OLD_ANCHOR_S and is_unsure:
        sentence = f"the last anchor is {age_s / 60:.0f} min old, and the IMU's yaw drifts"
        yield Finding("warning", "old-anchor", instance, sentence, anchor)


def _counter(instance: str, now: int, then: int, sentence: str, remedy: str) -> Iterator[Finding]:
    if not now:
        return
    if now > then:
        yield Finding("error", "failing", instance, f"{now} {sentence}; the number is growing", remedy)
    else:
        yield Finding("note", "failed", instance, f"{now} {sentence}, not any more", remedy)
