"""Shards of the selector on Zenoh: one owner of each object, and no event lost, when links are cut."""

import asyncio
from collections.abc import AsyncGenerator

import pytest
import pytest_asyncio

from pointit.services.selector.shard_engine import NO_ARBITER
from tests.integration.selector.hall import Hall, running_hall
from tests.support.bench import until


@pytest_asyncio.fixture
async def hall() -> AsyncGenerator[Hall]:
    async with running_hall() as running:
        yield running


async def test_two_hosts_that_dwell_on_one_package_get_one_owner(hall: Hall) -> None:
    hall.point()
    await until(lambda: bool(hall.anna.toggles and hall.ben.toggles), what="both to dwell")
    await hall.settled()
    hall.check()
    assert sorted(event.event for event in hall.events) == ["refused", "selected"]


@pytest.mark.parametrize("is_frozen", [False, True])
async def test_a_router_that_dies_between_claim_and_decision_loses_no_event(
    hall: Hall, *, is_frozen: bool
) -> None:
    """Frozen, it has the claims of both and no decision when it dies."""
    for count in range(1, 4):
        if is_frozen:
            hall.router.freeze()
        hall.point()
        await hall.claims(count)
        await hall.cut()
        await hall.heal()
        await hall.settled()
        hall.check()
        await hall.leave()


async def test_while_the_selector_is_gone_shards_hover_and_say_so_and_nothing_is_lost_when_it_is_back(
    hall: Hall,
) -> None:
    hall.point()
    await until(lambda: bool(hall.anna.toggles), what="a claim")
    hall.selector.cancel()
    await asyncio.wait([hall.selector])
    await hall.all(lambda person: any(NO_ARBITER in text for text in person.warnings), "the warning")
    for person in hall.people:
        person.hovers.clear()
    await hall.all(lambda person: any(hover.object_id == "a" for hover in person.hovers), "a hover")
    hall.start(hall.site)
    await hall.ready()
    hall.check()
    await hall.all(lambda person: not any(NO_ARBITER in text for text in person.warnings), "no warning")
    await hall.leave()
    hall.point()
    before = len(hall.events)
    await until(lambda: len(hall.events) > before, what="another decision")
    await hall.settled()
    hall.check()
