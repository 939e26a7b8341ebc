"""Links between hosts that fail or are bad: reports at the site, and recovery.

Host A has router, services and ben. anna and an observer are at host B. Whatever happens to B's link, ben
goes on undisturbed, nothing ends, and the observer at B loses no selection event.
"""

import asyncio
import statistics
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import pytest

from tests.faults.account import Account
from tests.faults.network import ALL
from tests.faults.network_view import (
    FRESH_S,
    HERE,
    PATIENCE_S,
    THERE,
    Plant,
    Spectator,
    View,
    quantile_s,
    running,
)
from tests.support.bench import until
from tests.support.pace import Patience, slowness, within

AFTER_S = 2.0
LOOK_S = 0.05
GAP_S = 2.0
"""Time limit between two cursors of an unaffected person, on a busy machine."""
NOTICED_S = 10.0
GONE_S = 12.0
"""Lease, and as long for TCP to give a write up."""
RECOVERED_S = 15.0
MEMORY_MB = 30.0
RATE_HZ = 20.0
RATES = {"POINTIT_USER_SIM__RATE_HZ": f"{RATE_HZ}", "POINTIT_LED_DRIVER__MAX_RATE_HZ": "10"}
"""Less than usual: a site's work goes by its rates."""
GONE = ("silent", "absent", "left")
"""Doctor's codes for an unreachable person."""
BAD = (*GONE, "slow", "stale", "clock", "warning")
"""And of a link that is bad; a busy machine is slow, too."""


@dataclass
class Both:
    plant: Plant
    spectator: Spectator


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Both]:
    """Start the two hosts, once for all tests here."""
    with running(tmp_path_factory.mktemp("links"), RATES) as plant:
        spectator = plant.spectator(plant.b, "operator")
        asyncio.run(until(lambda: bool(spectator.lines()), PATIENCE_S, "somebody who looks on at host B"))
        yield Both(plant, spectator)


@dataclass
class Outcome:
    noticed_s: float | None
    by: str
    recovered_s: float
    during_s: list[float]
    """Ages of anna's cursors."""
    lasted_s: float
    memory_mb: float
    events: int
    events_s: float
    """From the fault's end until all of them were known at host B."""

    def row(self, account: Account, name: str, lost: str = "") -> None:
        latency = f"{self.events} events, none lost, all known after {self.events_s:.1f} s"
        if self.during_s:
            p50, p99 = (quantile_s(self.during_s, share) * 1e3 for share in (0.5, 0.99))
            latency += f"; wrist to cursor p50 {p50:.0f} ms, p99 {p99:.0f} ms"
        told = "; ".join(each for each in (lost, latency) if each)
        account.add(name, self.noticed_s, self.by, self.recovered_s, told, memory_mb=self.memory_mb)


class Trial:
    """One fault of B's link, from calm to calm."""

    def __init__(self, both: Both, view: View) -> None:
        self.both = both
        self.plant = both.plant
        self.view = view
        self.wire = both.plant.network
        self.b = both.plant.b

    async def suffer(
        self, begin: Callable[[], None], lasts_s: float, codes: Collection[str], named: Collection[str] = ()
    ) -> Outcome:
        """Begin the fault, end it after `lasts_s` and when doctor has found it. Check the invariants.

        Of doctor's findings only `codes` count, and all that are `named` must be among them.
        """
        view = self.view
        plant = self.plant
        await view.flows(HERE, THERE)
        await view.calm()
        await self._events_arrive()
        memory = plant.memory_mb()
        began_s = time.monotonic()
        patience = Patience(lasts_s + GONE_S)
        found: dict[str, float] = {}
        try:
            begin()
            while time.monotonic() - began_s < lasts_s or not found or not found.keys() >= set(named):
                for finding in view.findings():
                    if finding.code in codes:
                        found.setdefault(finding.code, time.monotonic() - began_s)
                assert not patience.is_over(), f"found after {patience}: {found}"
                view.tell()
                await asyncio.sleep(LOOK_S)
        finally:
            self.wire.clear()
        ended_s = time.monotonic()
        await view.flows(THERE)
        recovered_s = time.monotonic() - ended_s
        await self._events_arrive()
        events_s = time.monotonic() - ended_s
        await asyncio.sleep(AFTER_S)
        await view.calm()
        assert len(view.events) >= lasts_s
        assert within(view.gap_s(HERE, began_s), GAP_S), "ben was disturbed"
        assert within(statistics.median(view.ages_s(HERE, began_s)), FRESH_S)
        assert plant.ended() == []
        assert within(recovered_s, RECOVERED_S)
        late_s = max(view.ages_s(HERE, began_s))  # on a machine that has much else to do
        held_up_s = max(view.ages_s(THERE, began_s)) - late_s
        assert held_up_s < FRESH_S * min(2.0, slowness()), "what was held up is shown"
        grown = max(now_mb - memory[name] for name, now_mb in plant.memory_mb().items())
        assert grown < MEMORY_MB
        codes = sorted(found, key=lambda code: found[code])
        return Outcome(
            noticed_s=min(found.values(), default=None),
            by=f"doctor: {', then '.join(codes)}" if codes else "",
            recovered_s=recovered_s,
            during_s=view.ages_s(THERE, began_s, ended_s),
            lasted_s=ended_s - began_s,
            memory_mb=grown,
            events=len(view.events),
            events_s=events_s,
        )

    async def _events_arrive(self) -> None:
        """Wait until all selections and deselections so far are known at host B."""
        self.view.tell()

        def missing() -> set[str]:
            return set(self.view.events) - set(self.both.spectator.events())

        def said() -> str:
            there = self.both.spectator
            return f"host B lacks {missing()}; it has {there.events()} and said {there.command.err}"

        await until(lambda: not missing(), PATIENCE_S, said)


@pytest.mark.slow
async def test_a_cut_link(both: Both, account: Account) -> None:
    async with both.plant.view() as view:
        trial = Trial(both, view)
        outcome = await trial.suffer(lambda: trial.wire.cut(trial.b), 5.0, GONE, named=["silent"])
    assert outcome.noticed_s is not None
    assert within(outcome.noticed_s, NOTICED_S)
    outcome.during_s.clear()
    outcome.row(account, "link of a host cut for 5 s", "the host's cursors meanwhile")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "ways"),
    [
        ("black hole, both ways", {}),
        pytest.param("half open: nothing comes from the host", {"down": False}, marks=pytest.mark.long),
        pytest.param("half open: nothing gets to the host", {"up": False}, marks=pytest.mark.long),
    ],
)
async def test_a_link_that_drops_all(both: Both, account: Account, name: str, ways: dict[str, bool]) -> None:
    """An unreachable person is not present, however full the buffers of the dead connections are."""
    async with both.plant.view() as view:
        trial = Trial(both, view)
        outcome = await trial.suffer(
            lambda: trial.wire.lose(trial.b, ALL, **ways), 8.0, GONE, named=["absent"]
        )
    assert outcome.noticed_s is not None
    assert within(outcome.noticed_s, NOTICED_S)
    assert any("router at" in line and "is back" in line for line in both.plant.there.logged())
    outcome.during_s.clear()
    outcome.row(account, name, "the host's cursors meanwhile")


@pytest.mark.long
@pytest.mark.slow
async def test_a_link_that_loses_much(both: Both, account: Account) -> None:
    async with both.plant.view() as view:
        trial = Trial(both, view)
        outcome = await trial.suffer(lambda: trial.wire.lose(trial.b, 20), 8.0, BAD)
    assert outcome.noticed_s is not None
    outcome.row(account, "20 % of packets lost, both ways", f"{_missing(outcome)} of cursors")


def _missing(outcome: Outcome) -> str:
    return f"{max(0.0, 1.0 - len(outcome.during_s) / (RATE_HZ * outcome.lasted_s)):.0%}"
