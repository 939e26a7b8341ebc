"""The finding of a site that is out of reach as a whole, and those that follow from it. Pure."""

from collections.abc import Sequence
from dataclasses import replace

from pointit.diagnosis.missing_services import GONE
from pointit.diagnosis.observation import Finding, Observation
from pointit.diagnosis.stopped_processes import CONTINUE, StoppedProcess
from pointit.runtime.link.outage import AGAIN, Outage, find_outage


def unreachable(
    connect: Sequence[str], stopped: Sequence[StoppedProcess], *, is_refused: bool, is_secured: bool
) -> Finding:
    """Return the finding of an observer that cannot join.

    `is_refused`: nothing listens at `connect`. `stopped`: processes of this machine that may be the router.
    """
    where = ", ".join(connect)
    if not is_refused and (pid := next((each.pid for each in stopped if each.may_route), 0)):
        sentence = f"the router at {where} does not answer: process {pid} is stopped (Ctrl-Z or SIGSTOP)"
        return replace(_finding(sentence, CONTINUE.format(pid=pid)), code="stopped")
    if not is_refused:
        return _finding(
            f"the router at {where} does not answer", f"{AGAIN}; or give another address by --connect"
        )
    return _finding(
        f"nothing runs at {where}",
        "start its router with `pointit router`, or give its address by --connect"
        if is_secured
        else "start `pointit run`, give its address by --connect or, on a secured site, your identity by "
        "--credentials",
    )


def find_lost_router(findings: Sequence[Finding], seen: Observation) -> Finding | None:
    """Return the finding of a lost router, if services say that they have lost it."""
    outage = _outage(findings, seen)
    if outage is None or outage.remedy != AGAIN:
        return None
    finding = _finding(outage.sentence, outage.remedy)
    is_error = any(each.code in GONE and each.severity == "error" for each in findings)
    # else what it cannot reach is not expected here
    return finding if is_error else replace(finding, severity="warning")


def find_mass_outage(findings: Sequence[Finding], seen: Observation) -> Finding | None:
    """Return the finding of most services of the site that are gone together."""
    outage = _outage(findings, seen)
    return None if outage is None else _finding(outage.sentence, outage.remedy)


def _outage(findings: Sequence[Finding], seen: Observation) -> Outage | None:
    gone = {each.service for each in findings if each.code in GONE}
    warnings = [each.sentence for each in findings if each.code == "warning"]
    return find_outage(seen.present | seen.expected.keys() | gone, gone, warnings)


def _finding(sentence: str, remedy: str) -> Finding:
    return Finding("error", "unreachable", "", sentence, remedy)
