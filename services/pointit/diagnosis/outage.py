"""A site that is out of reach as a whole: one cause, and the one remedy. Pure."""

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

from pointit.diagnosis.observation import Finding, Observation
from pointit.runtime.link.link import ROUTER_LOST

MANY = 4
"""Minimum number of services that are gone together. Of fewer, each is named with its own remedy."""

GONE = ("absent", "left", "silent")

AGAIN = (
    "is its process stopped (`kill -CONT PID`), or its machine off or cut off? Else start it again where it "
    "ran, with `pointit run` or `pointit router`; the services come back by themselves"
)

_LOST = re.compile(re.escape(ROUTER_LOST.partition("{where}")[0]) + r"(?P<where>.+?) lost \d+ s ago")


def unreachable(connect: Sequence[str], *, is_refused: bool, is_secured: bool) -> Finding:
    """Return the finding of an observer that cannot join.

    Args:
        connect: addresses that were tried.
        is_refused: nothing listens there. Else somebody may, who does not answer.
        is_secured: the observer has credentials.
    """
    where = ", ".join(connect)
    if not is_refused:
        return _outage(
            f"the router at {where} does not answer", f"{AGAIN}; or give another address by --connect"
        )
    return _outage(
        f"nothing runs at {where}",
        "start its router with `pointit router`, or give its address by --connect"
        if is_secured
        else "start `pointit run`, give its address by --connect or, on a secured site, your identity by "
        "--credentials",
    )


def find_outage(known: Collection[str], gone: Collection[str], warnings: Iterable[str]) -> Finding | None:
    """Return the one finding if the router is lost or most of the site vanished together, else None.

    Args:
        known: instances that run or should run.
        gone: those of them that left, are absent or silent.
        warnings: of the services that are heard.
    """
    most = f"{len(gone)} of {len(known)} services are"
    is_most = len(gone) >= MANY and 2 * len(gone) > len(known)
    if lost := next(filter(None, map(_LOST.search, warnings)), None):
        sentence = f"the router at {lost['where']} does not answer: "
        sentence += f"{most} out of reach" if is_most else "nothing arrives from other machines"
        return _outage(sentence, AGAIN)
    if not is_most:
        return None
    return _outage(
        f"{most} gone together: what started them has ended, is stopped, or is cut off from the router",
        "look there: continue it (`kill -CONT PID`), or start it again; the log of what started them has the "
        "command",
    )


def fold_outage(findings: Sequence[Finding], seen: Observation) -> list[Finding]:
    """Return `findings`; in an outage with the finding of it, from which the others of that cause follow."""
    gone = {each.service for each in findings if each.code in GONE}
    warnings = [each.sentence for each in findings if each.code == "warning"]
    outage = find_outage(seen.present | seen.expected.keys() | gone, gone, warnings)
    if outage is None:
        return list(findings)
    folded = [
        replace(each, follows=each.code in (*GONE, "stale") or bool(_LOST.search(each.sentence)))
        for each in findings
    ]
    if not any(each.follows and each.severity == "error" for each in folded):
        outage = replace(outage, severity="warning")  # what it cannot reach is not expected here
    return [outage, *folded]


def _outage(sentence: str, remedy: str) -> Finding:
    return Finding(severity="error", code="unreachable", service="", sentence=sentence, remedy=remedy)
