"""A selector and a carrier that are killed while an act runs: it ends with its result, or without one."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
import pytest_asyncio

from pointit.runtime.errors import RefusedError
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ActOutcome, Environment, Selection, SetThing, topics
from pointit.schemas.environment import Thing
from pointit.services.pui.tracked_objects import TRACKER, listing
from pointit.site.following import follow_site
from pointit.site.site_state import SiteState
from tests.support.bench import until
from tests.support.cli_site import Site

pytestmark = pytest.mark.slow

SIZE_M = (0.2, 0.2, 0.2)
RADIO = Thing(id="radio", mode="switch", lamp="radio_lamp", center_m=(1.0, 2.0, 1.0), size_m=SIZE_M)
ROOM = Environment(stamp_ns=1, name="shop", things=(RADIO,))


class Shop:
    """A radio that a program switches, which ends when the file `go` is there."""

    def __init__(self, site: Site, stack: AsyncExitStack, folder: Path) -> None:
        self.site = site
        self.folder = folder
        self._stack = stack
        self.outcomes: list[ActOutcome] = []
        self.selections: list[Selection] = []
        self.shown = SiteState()
        self.things = self.shown.all(topics.THING_STATES)
        bus = site.bus
        bus.subscribe(topics.OUTCOMES, lambda outcome, _: self.outcomes.append(outcome))
        bus.subscribe(topics.SELECTION, lambda selection, _: self.selections.append(selection))
        follow_site(self.shown, bus, asyncio.get_running_loop().time, (topics.THING_STATES,))
        bus.publisher(topics.MAP).put(ROOM)

    async def hear(self, *results: tuple[str, str]) -> None:
        """Wait until these are the results and codes of all outcomes: they may come after the selection."""
        told = self.outcomes
        await until(lambda: [(each.result, each.code) for each in told] == [*results], what="the outcomes")

    async def list_objects(self) -> None:
        """List the things as pui does."""
        publisher = self.site.bus.publisher(topics.OBJECTS, TRACKER)
        while True:
            publisher.put(listing(ROOM, time.time_ns()))
            await asyncio.sleep(0.1)

    async def start_carrier(self) -> asyncio.subprocess.Process:
        file = self.folder / "radio.sh"
        file.write_text(
            f"echo $1 >> {self.folder}/told\nuntil test -e {self.folder}/go; do sleep .05; done\n"
        )
        react = self.site.command("things", "react", f"radio=sh {file} {{state}}")
        process = await self._stack.enter_async_context(react)
        await until(lambda: bool(self.things), what="the carrier's things")
        return process

    async def start_selector(self) -> asyncio.subprocess.Process:
        before = len(self.selections)
        process = await self._stack.enter_async_context(
            self.site.python("-m", "pointit.services", "selector")
        )
        await until(lambda: len(self.selections) > before, what="the selector")
        return process

    async def switch(self) -> str:
        """Switch the radio once the selector knows it and its carrier, and return the reply."""
        while True:
            try:
                reply = await self.site.bus.call(topics.SET_THING, SetThing(thing="radio"), "anna")
            except RefusedError as error:
                is_known = "is placed" not in str(error) and "is not known yet" not in str(error)
                if is_known:
                    raise
                await asyncio.sleep(0.05)
            else:
                return reply.message

    @property
    def radio(self) -> list[bool]:
        """Return for each selected object whether its act is pending."""
        return [each.is_pending for each in self.selections[-1].objects]


@pytest_asyncio.fixture
async def shop(endpoint: str, tmp_path: Path) -> AsyncIterator[Shop]:
    site = Site(bus=await ZenohBus.open(Link(listen=(endpoint,))), endpoint=endpoint)
    async with AsyncExitStack() as stack:
        shop = Shop(site, stack, tmp_path)
        listed = asyncio.create_task(shop.list_objects(), name="objects")
        try:
            yield shop
        finally:
            (tmp_path / "go").touch()  # programs of a killed carrier go on
            listed.cancel()
            await site.stop()


@pytest.mark.parametrize("is_early", [True, False])
async def test_act_is_done_once_and_reported_by_the_next_selector(shop: Shop, *, is_early: bool) -> None:
    await shop.start_carrier()
    selector = await shop.start_selector()
    assert (await shop.switch()).endswith("did not tell the result yet")

    selector.kill()
    await selector.wait()
    if is_early:  # nobody hears the result
        (shop.folder / "go").touch()
        await until(
            lambda: all(each.things[0].last for each in shop.things.values()), what="the end of the act"
        )
    await shop.start_selector()

    (shop.folder / "go").touch()
    await until(lambda: shop.radio == [False], what="the result")
    await shop.hear(("done", ""))
    assert [(each.object_id, each.user) for each in shop.outcomes] == [("radio", "anna")]
    assert (shop.folder / "told").read_text() == "on\n"


async def test_act_is_undone_when_its_carrier_and_selector_are_killed(
    shop: Shop,
) -> None:
    carrier = await shop.start_carrier()
    selector = await shop.start_selector()
    await shop.switch()
    for process in (selector, carrier):
        process.kill()
        await process.wait()
    await until(lambda: not shop.things, what="the things of a dead carrier to be gone")
    await shop.start_selector()
    assert shop.radio == [True]
    await until(lambda: shop.radio == [], what="the switch to go back")
    await shop.hear(("failed", "no_answer"))


async def test_act_fails_when_its_carrier_is_killed_until_another_starts(shop: Shop) -> None:
    carrier = await shop.start_carrier()
    await shop.start_selector()
    await shop.switch()
    carrier.kill()
    await until(lambda: shop.radio == [] and not shop.things, what="the end of the carrier")
    await shop.hear(("failed", "unavailable"))
    with pytest.raises(RefusedError, match="has ended: start it again"):
        await shop.switch()
    (shop.folder / "go").touch()
    await shop.start_carrier()
    assert await shop.switch() == "radio selected"
    await shop.hear(("failed", "unavailable"), ("done", ""))
