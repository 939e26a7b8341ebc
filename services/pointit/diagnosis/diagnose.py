"""Problems of a running site: symptoms, of which each deepest cause is a finding. Pure."""

from collections.abc import Callable, Iterator, Sequence

from pointit.diagnosis.causes import SEVERITIES, explain
from pointit.diagnosis.observation import Finding, Observation, Severity
from pointit.diagnosis.presence import find_empty_site, find_missing, find_people_without_cursor
from pointit.diagnosis.staleness import stale_inputs
from pointit.diagnosis.symptoms import find_in_reports
from pointit.runtime.bus.timeliness import REMEDY, ClockSkewMonitor
from pointit.runtime.config.similar_names import did_you_mean
from pointit.schemas.system import split_instance


def diagnose(seen: Observation, is_sure: Callable[[Finding], bool] = lambda _: True) -> list[Finding]:
    """Return the problems that `is_sure`, the worst first.

    Those that another one explains have `follows`: they are not problems of their own.
    """
    symptoms = (
        *find_empty_site(seen),
        *find_missing(seen),
        *find_people_without_cursor(seen),
        *find_clock_skew(seen),
        *find_in_reports(seen),
        *stale_inputs(seen),
    )
    findings = explain([each for each in symptoms if is_sure(each)], seen)
    return sorted(findings, key=lambda finding: (SEVERITIES.index(finding.severity), finding.service))


def is_healthy(findings: Sequence[Finding]) -> bool:
    """Return True if there is no current problem. Notes are about the past."""
    return all(finding.severity == "note" for finding in findings)


def find_clock_skew(seen: Observation) -> Iterator[Finding]:
    """Find machines with clock skew relative to ours, unless a keeper has reported it."""
    skew_monitor = ClockSkewMonitor(seen.host, window_s=seen.now_s - seen.began_s + 1.0)
    for reports in seen.reports.values():
        for report in reports:
            if report.arrived_ns is not None and report.health.host:
                skew_monitor.on_report(
                    report.health.host, report.health.stamp_ns, report.arrived_ns, report.received_s
                )
    keeper = seen.newest("keeper")
    warning_text = " ".join(keeper.warnings) if keeper is not None else ""
    for skew in skew_monitor.skews(seen.now_s):
        if f"the clock of machine {skew.host} " not in warning_text:
            severity: Severity = "error" if skew.exceeds_limit else "warning"
            yield Finding(severity, "clock", "", skew.sentence(seen.host), REMEDY)


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
