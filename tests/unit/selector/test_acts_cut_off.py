"""A carrier that was cut off: what people were told as failed is not done afterwards."""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager

import pytest

from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.service.carrier import Carrier
from pointit.schemas import BeginAct, BeginActReply, topics
from tests.support.bench import in_virtual_time, until
from tests.unit.selector.shop import Device, Shop, shop

LEASE_S = 3.0
"""Time without a sign after which the other side takes a session for dead, s, as Zenoh does here."""


class CuttableLink:
    """The link between a site and the bus of a carrier. While it is cut, events and reports are kept."""

    def __init__(self, site: Shop) -> None:
        self.site = site
        self.bus = MemoryBus()
        self._open = asyncio.Event()
        self._open.set()
        self._kept: list[Callable[[], None]] = []
        self._presence = site.bus.announce(topics.CARRIER_ALIVE, "home")
        self._lease: asyncio.TimerHandle | None = None
        far_events = self.bus.publisher(topics.SELECTION_EVENTS)
        states = site.bus.publisher(topics.THING_STATES, "home")
        results = site.bus.publisher(topics.ACT_RESULTS, "home")
        site.bus.subscribe(
            topics.SELECTION_EVENTS, lambda event, _: self._pass(lambda: far_events.put(event))
        )
        self.bus.subscribe(topics.THING_STATES, lambda told, _: self._pass(lambda: states.put(told)))
        self.bus.subscribe(topics.ACT_RESULTS, lambda told, _: self._pass(lambda: results.put(told)))
        self.bus.serve(topics.BEGIN_ACT, self._begin)

    def cut(self) -> None:
        self._open.clear()
        self._lease = asyncio.get_running_loop().call_later(LEASE_S, self._presence.close)

    def mend(self) -> None:
        """Deliver what was kept, before the presence is seen again."""
        assert self._lease is not None
        was_gone = self._lease.when() <= asyncio.get_running_loop().time()
        self._lease.cancel()
        self._open.set()
        for deliver in self._kept:
            deliver()
        self._kept.clear()
        if was_gone:
            self._presence = self.site.bus.announce(topics.CARRIER_ALIVE, "home")

    def _pass(self, deliver: Callable[[], None]) -> None:
        if self._open.is_set():
            deliver()
        else:
            self._kept.append(deliver)

    async def _begin(self, query: BeginAct, name: str) -> BeginActReply:
        if not self._open.is_set():
            await self._open.wait()
        return await self.site.bus.call(topics.BEGIN_ACT, query, name)


@asynccontextmanager
async def far_bell(device: Device) -> AsyncGenerator[tuple[Shop, CuttableLink]]:
    """Yield a site whose carrier is behind a link."""
    async with shop(has_carrier=False) as home:
        link = CuttableLink(home)
        carrier = Carrier(link.bus, home.bench.clock, "home")
        carrier.use({"bell": [device], "lamp": [device]})
        await asyncio.sleep(1.0)
        try:
            yield home, link
        finally:
            await carrier.close()
            await link.bus.close()


@pytest.mark.parametrize("cut_s", [3.5, 4.0, 6.0, 20.0])
@pytest.mark.parametrize("thing", ["bell", "lamp"])
def test_act_that_was_told_as_failed_is_not_carried_out(thing: str, cut_s: float) -> None:
    @in_virtual_time
    async def main() -> None:
        device = Device(reports=False)
        async with far_bell(device) as (home, link):
            link.cut()
            asyncio.get_running_loop().call_later(cut_s, link.mend)
            first = await home.set(thing)
            await until(lambda: len(home.outcomes) == 1)
            assert home.outcomes[0].result == "failed"
            assert home.outcomes[0].text == "home has ended before it began: start it again"

            await asyncio.sleep(cut_s)
            assert device.acts == [], first
            assert await home.set(thing) == f"{thing} selected"
            await asyncio.sleep(8.0)
            assert device.acts == [True], "once, for the second try"
            assert [each.result for each in home.outcomes] == ["failed", "done"]

    main()


@pytest.mark.parametrize("cut_s", [0.5, 2.5])
def test_act_that_was_only_delayed_is_carried_out_once(cut_s: float) -> None:
    @in_virtual_time
    async def main() -> None:
        device = Device(reports=False)
        async with far_bell(device) as (home, link):
            link.cut()
            asyncio.get_running_loop().call_later(cut_s, link.mend)
            await home.set("bell")
            await until(lambda: len(home.outcomes) == 1)
            assert home.outcomes[0].result == "done"
            assert device.acts == [True]

    main()


@in_virtual_time
async def test_act_that_had_begun_is_told_as_unknown_when_its_carrier_is_cut_off() -> None:
    device = Device(reports=False, takes_s=2.0)
    async with far_bell(device) as (home, link):
        asking = asyncio.create_task(home.set("bell"))
        await asyncio.sleep(0.5)
        link.cut()
        await asking
        await until(lambda: len(home.outcomes) == 1)
        assert "ended before it told the result: look if it is done" in home.outcomes[0].text
        link.mend()
