"""Clock skew of machines relative to the observer. Pure."""

from collections.abc import Iterator

from pointit.diagnosis.observation import Finding, Observation
from pointit.runtime.bus.timeliness import REMEDY, ClockSkewMonitor


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
            yield Finding(
                severity="error" if skew.exceeds_limit else "warning",
                code="clock",
                service="",
                sentence=skew.sentence(seen.host),
                remedy=REMEDY,
            )
