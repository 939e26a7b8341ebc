"""Read-only processes, such as a page on another machine: other processes receive nothing from them."""

import dataclasses
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ButtonEvent, Health
from pointit.schemas.topics import BUTTON, HEALTH, SERVICE_ALIVE
from tests.integration.access.secured import link_of, make_site, routed
from tests.support.bench import until


def looking_on(link: Link, role: str) -> Link:
    """Return a link in another role, whose router would let it write."""
    assert link.credentials is not None
    file = link.credentials.link.model_copy(update={"role": role})
    return dataclasses.replace(link, credentials=dataclasses.replace(link.credentials, link=file))


def news_of(bus: ZenohBus) -> list[object]:
    """Return a list that fills with whose reports are heard and who comes and goes."""
    found: list[object] = []
    bus.subscribe(HEALTH, lambda _message, name: found.append(name))
    bus.watch(SERVICE_ALIVE, lambda name, present: found.append((name, present)))
    return found


@pytest_asyncio.fixture(params=["dashboard", "operator", "web"])
async def buses(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> AsyncIterator[tuple[str, ZenohBus, ZenohBus]]:
    role = str(request.param)
    site = make_site(tmp_path_factory.mktemp("site") / "lab", names={"supervisor": "supervisor"})
    with routed(site):
        link = link_of(site, "supervisor")
        mine = await ZenohBus.open(looking_on(link, role), patience_s=30)
        other = await ZenohBus.open(link, patience_s=30)
        yield role, mine, other
        await other.close()
        await mine.close()


async def test_what_an_onlooker_tells_of_itself_stays_in_its_process(
    buses: tuple[str, ZenohBus, ZenohBus],
) -> None:
    role, mine, other = buses
    here, there = news_of(mine), news_of(other)
    marks: list[str] = []
    other.subscribe(BUTTON, lambda _message, name: marks.append(name))
    announced = mine.announce(SERVICE_ALIVE, "web.2")
    late: list[tuple[str, bool]] = []
    mine.watch(SERVICE_ALIVE, lambda name, present: late.append((name, present)))
    report = mine.publisher(HEALTH, "web.2")
    mark = mine.publisher(BUTTON, "end")
    everything = {("web.2", True), "web.2"}

    def put() -> None:
        report.put(Health(stamp_ns=1, service="web", instance="web.2", pid=1))
        mark.put(ButtonEvent(stamp_ns=1))

    def is_told() -> bool:
        put()
        return everything <= set(here) and late == [("web.2", True)] and len(marks) > 2

    await until(is_told)
    if role == "web":  # who is no onlooker is heard: the same would show above
        await until(lambda: everything <= set(there))
    else:
        assert there == []
    announced.close()
    await until(lambda: here[-1] == late[-1] == ("web.2", False))
