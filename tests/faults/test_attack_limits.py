"""A single insider with 1, 8 and 32 connections and each kind of operation, who is named and cut off.

`pytest -m "slow and long" tests/faults/test_attack_limits.py` prints a table. In the environment,
`FLOOD_KINDS="own keys,questions"` and `FLOOD_CONNECTIONS=1,32` select some of its rows.
"""

import asyncio
import itertools
import math
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest

from tests.faults.central import PEOPLE, Central, central_site
from tests.faults.insider import CONNECTIONS, KINDS
from tests.support.bench import until
from tests.support.commands import Command

pytestmark = [pytest.mark.slow, pytest.mark.long]

ALL_KINDS = (*KINDS, CONNECTIONS)
WRITES_HZ = 6000.0
"""Minimum rate of writes of all connections together."""
CONNECTION_HZ = 500.0
"""Minimum rate of writes of each."""
DECLARATIONS_HZ = 1000.0
INTERESTS_HZ = 40_000.0
LARGE_WRITES_HZ = 3000.0
LONG_KEYS_HZ = 500.0
NAMED_S = 5.0
"""Limit of the time from the start of a flood until its identity is named and cut off."""
AFTER_S = 6.0
"""Time for which the flood goes on once it is cut off."""
MAX_GAP_S = 0.5
"""Limit of the time without a cursor after that."""
GIVEN_UP_S = 30.0
REST_S = 1.0
HEAD = (
    "operation", "connections", "sent/s", "named after s", "cut off after s", "cursors", "longest gap s",
    "cursors afterwards", "longest gap afterwards s",
)  # fmt: skip


@dataclass(kw_only=True)
class FloodResult:
    """One row of the table."""

    kind: str
    connections: int
    sent_hz: float
    named_s: float
    cut_s: float
    during: "CursorCount"
    afterwards: "CursorCount"
    allowed_gap_s: float
    """Limit of the gap afterwards: other jobs of the machine may cause one, too."""

    @property
    def cells(self) -> list[str]:
        return [
            self.kind,
            str(self.connections),
            f"{self.sent_hz:.0f}",
            f"{self.named_s:.1f}",
            f"{self.cut_s:.1f}",
            f"{self.during.received}/{self.during.expected}",
            f"{self.during.gap_s:.2f}",
            f"{self.afterwards.received}/{self.afterwards.expected}",
            f"{self.afterwards.gap_s:.2f}",
        ]


@dataclass(kw_only=True)
class CursorCount:
    """Cursors of others in one interval."""

    received: int
    expected: int
    gap_s: float


@dataclass
class CursorCounter:
    """Counts the cursors of others from now on."""

    site: Central
    began_s: float = field(default_factory=time.monotonic)
    sent: Counter[str] = field(default_factory=Counter[str])

    def __post_init__(self) -> None:
        self.sent = Counter(self.site.sent)

    def count(self) -> CursorCount:
        ended_s = time.monotonic()
        received = 0
        gaps_s: list[float] = []
        for person in PEOPLE:
            came_s = [at_s for at_s in self.site.came_s[person] if at_s > self.began_s]
            received += len(came_s)
            gaps_s += [
                after - before for before, after in itertools.pairwise([self.began_s, *came_s, ended_s])
            ]
        expected = sum(self.site.sent[person] - self.sent[person] for person in PEOPLE)
        return CursorCount(received=received, expected=expected, gap_s=max(gaps_s))


def flood_rate_hz(kind: str, connections: int) -> float:
    if kind in ("own keys", "one own key", "denied writes"):
        return max(WRITES_HZ, CONNECTION_HZ * connections)
    if kind.startswith("interests"):
        return INTERESTS_HZ
    if kind == "large writes":
        return LARGE_WRITES_HZ
    if kind == "keys of 60 kB":
        return LONG_KEYS_HZ
    return DECLARATIONS_HZ


def connections_of_process(flood: Command) -> set[int]:
    """Return the own ports of an insider's process."""
    connections = psutil.Process(flood.process.pid).net_connections("tcp")
    return {connection.laddr[1] for connection in connections}


def connections_of(site: Central) -> set[int]:
    """Return the ports of the clients from which the router still takes something."""
    connections = psutil.Process(site.router.process.pid).net_connections("tcp")
    return {connection.raddr[1] for connection in connections if connection.status == "ESTABLISHED"}


async def flood_result(
    site: Central, kind: str, connections: int, insider: str, named: str = "{} has "
) -> FloodResult:
    """Flood until it is cut off and for a while longer, and return what others had of it.

    `named`: beginning of the sentence by which the router names the insider.
    """
    await site.fresh()
    rate_hz = flood_rate_hz(kind, connections)
    program = [sys.executable, "-m", "tests.faults.insider", str(site.folder.path), insider, kind]
    flood = site.commands.run([*program, str(connections), str(rate_hz)])
    try:
        await flood.says("begins")
        whole = CursorCounter(site)
        first = connections_of_process(flood) & connections_of(site)

        named_s = math.inf
        cut_s = math.inf
        elapsed_s = 0.0
        while elapsed_s < GIVEN_UP_S and max(named_s, cut_s) == math.inf:
            await asyncio.sleep(0.02)
            elapsed_s = time.monotonic() - whole.began_s
            if named_s == math.inf and named.format(f"lab/{insider}") in site.router.err:
                named_s = elapsed_s
            # Who only opens connections has none that lasts.
            is_cut = named_s < math.inf if kind == CONNECTIONS else not first & connections_of(site)
            if cut_s == math.inf and is_cut:
                cut_s = elapsed_s
        during = whole.count()
        afterwards = CursorCounter(site)
        sent = [line.split() for line in flood.out.splitlines() if " in " in line]
        await asyncio.sleep(AFTER_S)
        sent = sent or [line.split() for line in flood.out.splitlines() if " in " in line]
        counted = afterwards.count()
    finally:
        flood.kill()
        await until(lambda: not flood.is_running, what="the end of the flood")
        await asyncio.sleep(REST_S)

    allowed_gap_s = MAX_GAP_S
    if counted.gap_s > MAX_GAP_S:
        with site.busy():
            allowed_gap_s = max(MAX_GAP_S, 2.0 * await site.longest_gap_s())
    return FloodResult(
        kind=kind,
        connections=connections,
        sent_hz=int(sent[-1][0]) / float(sent[-1][2]) if sent else 0.0,
        named_s=named_s,
        cut_s=cut_s,
        during=during,
        afterwards=counted,
        allowed_gap_s=allowed_gap_s,
    )


def selected(variable: str, all_values: Sequence[str]) -> list[str]:
    value = os.environ.get(variable, "")
    return [name for name in all_values if name in value.split(",")] if value else list(all_values)


def table(results: Sequence[FloodResult]) -> str:
    rows = [HEAD, ["---"] * len(HEAD), *(result.cells for result in results)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


@pytest.mark.timeout(3600)
async def test_insider_is_named_and_cut_off_whatever_she_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cases = list(
        itertools.product(
            selected("FLOOD_KINDS", ALL_KINDS),
            [int(number) for number in selected("FLOOD_CONNECTIONS", ("1", "8", "32"))],
        )
    )
    insiders = [f"insider{number}" for number in range(len(cases))]
    results: list[FloodResult] = []
    async with central_site(tmp_path, insiders) as site:
        for (kind, connections), insider in zip(cases, insiders, strict=True):
            results.append(await flood_result(site, kind, connections, insider))
            with capsys.disabled():
                print("\n" + table(results[-1:]).splitlines()[-1], flush=True)  # noqa: T201 - it takes long
        said = site.router.err
    with capsys.disabled():
        print("\n" + table(results))  # noqa: T201 - this is what it is run for
    for result in results:
        row = " ".join(result.cells)
        assert result.named_s <= NAMED_S, row
        assert result.cut_s <= NAMED_S, row
        assert result.afterwards.gap_s <= result.allowed_gap_s, (
            f"{row}; allowed are {result.allowed_gap_s:.2f} s"
        )
    for insider in insiders:
        messages = said.replace(f"the flood of lab/{insider} has ended", "")
        assert messages.count(f"lab/{insider} has ") == 1, "an attack is reported once, and its end beside"


@pytest.mark.timeout(900)
async def test_revoked_identity_is_named_and_cut_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Who has no rights can ask for all readers that there are, and take that back, all the same."""
    numbers = [int(number) for number in selected("FLOOD_CONNECTIONS", ("1", "8", "32"))]
    insiders = [f"insider{number}" for number in range(len(numbers))]
    results: list[FloodResult] = []
    async with central_site(tmp_path, insiders) as site:
        count = site.router.err.count("that there are now")
        for insider in insiders:
            site.folder.revoke(insider)
        await until(lambda: site.router.err.count("that there are now") > count, what="the new rules")
        for connections, insider in zip(numbers, insiders, strict=True):
            named = "{}, by a revoked or replaced certificate, has "
            results.append(await flood_result(site, "interests", connections, insider, named))
    with capsys.disabled():
        print("\n" + table(results))  # noqa: T201 - this is what it is run for
    for result in results:
        row = " ".join(result.cells)
        assert result.named_s <= NAMED_S, row
        assert result.cut_s <= NAMED_S, row
        assert result.afterwards.gap_s <= result.allowed_gap_s, row
