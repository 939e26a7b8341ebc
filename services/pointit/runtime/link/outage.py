"""A site that is out of reach as a whole: one cause, and the one remedy. Pure."""

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from pointit.runtime.link.link import ROUTER_LOST

SILENT_S = 3.0
"""Time without a report at which a present service is stopped, or too busy to report, s."""
MANY = 4
"""Minimum number of services that are gone together. Of fewer, each is named with its own remedy."""

AGAIN = (
    "is its process stopped (`kill -CONT PID`), or its machine off or cut off? Else start it again where it "
    "ran, with `pointit run` or `pointit router`; the services come back by themselves"
)
LOST = re.compile(re.escape(ROUTER_LOST.partition("{where}")[0]) + r"(?P<where>.+?) lost \d+ s ago")
"""A service's warning that it has lost the router."""


@dataclass(frozen=True)
class Outage:
    """One cause for which services are out of reach, and its remedy."""

    sentence: str
    remedy: str


def find_outage(known: Collection[str], gone: Collection[str], warnings: Iterable[str]) -> Outage | None:
    """Return the outage if the router is lost or most of the site vanished together, else None.

    `known`: instances that run or should run; `gone`: those of them that left, are absent or silent.
    """
    majority = f"{len(gone)} of {len(known)} services are"
    is_majority = len(gone) >= MANY and 2 * len(gone) > len(known)
    if lost := next(filter(None, map(LOST.search, warnings)), None):
        sentence = f"the router at {lost['where']} does not answer: "
        sentence += f"{majority} out of reach" if is_majority else "nothing arrives from other machines"
        return Outage(sentence, AGAIN)
    if not is_majority:
        return None
    return Outage(
        f"{majority} gone together: what started them has ended, is stopped, or is cut off from the router",
        "look there: continue it (`kill -CONT PID`), or start it again; the log of what started them has the "
        "command",
    )
