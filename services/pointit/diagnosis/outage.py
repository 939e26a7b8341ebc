"""The finding of a site that is out of reach as a whole, and those that follow from it. Pure."""

from collections.abc import Sequence
from dataclasses import replace

from pointit.diagnosis.observation import Finding, Observation
from pointit.runtime.link.outage import AGAIN, LOST, find_outage

GONE = ("absent", "left", "silent")


def unreachable(connect: Sequence[str], *, is_refused: bool, is_secured: bool) -> Finding:
    """Return the finding of an observer that cannot join; `is_refused`: nothing listens at `connect`."""
    where = ", ".join(connect)
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


def fold_outage(findings: Sequence[Finding], seen: Observation) -> list[Finding]:
    """Return `findings`; in an outage with the finding of it, from which the others of that cause follow."""
    gone = {each.service for each in findings if each.code in GONE}
    warnings = [each.sentence for each in findings if each.code == "warning"]
    found = find_outage(seen.present | seen.expected.keys() | gone, gone, warnings)
    if found is None:
        return list(findings)
    outage = _finding(found.sentence, found.remedy)
    folded = [
        replace(each, follows=each.code in (*GONE, "stale") or bool(LOST.search(each.sentence)))
        for each in findings
    ]
    if not any(each.follows and each.severity == "error" for each in folded):
        outage = replace(outage, severity="warning")  # what it cannot reach is not expected here
    return [outage, *folded]


def _finding(sentence: str, remedy: str) -> Finding:
    return Finding("error", "unreachable", "", sentence, remedy)
