"""Shards of the selector on Zenoh: one owner of each object, and no event lost, when links are cut."""

import asyncio
from collections.abc import AsyncGenerator

import pytest
import pytest_asyncio

from pointit.schemas import NS_PER_S
from pointit.services.selector import arbiter, selection_engine
from pointit.services.selector.selection_engine import NO_ARBITER
from tests.integration.selector.hall import Hall, running_hall
from tests.support.bench import until

PATIENCE_NS = 60 * NS_PER_S


@pytest_asyncio.fixture
async def hall(monkeypatch: pytest.MonkeyPatch) -> AsyncGenerator[Hall]:
    # no claim is given up because the machine is slow
    monkeypatch.setattr(arbiter, "MAX_CLAIM_AGE_NS", PATIENCE_NS)
    monkeypatch.setattr(selection_engine, "GIVE_UP_NS", 2 * PATIENCE_NS)
    async with running_hall() as running:
        yield running


@pytest.mark.parametrize("is_frozen", [False, True])
async def test_router_dying_between_claim_and_decision_loses_no_event(hall: Hall, *, is_frozen: bool) -> None:
    """Frozen, it has the claims of both and no decision when it dies."""
    have_claimed = False
    for _ in range(3):
        if is_frozen:
            hall.router.freeze()
        hall.point()
        have_claimed |= await hall.claims()
        await hall.cut()
        await hall.heal()
        await hall.settled()
        hall.check()
        await hall.leave()
    assert have_claimed, "no round had claims of both"


async def test_shards_hover_and_lose_nothing_while_the_selector_is_gone(
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
