"""Shards and bridges under the identities of people and services, at a router with rules."""

import asyncio
import contextlib
import dataclasses
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from pointit.bridges.agv_tracker.config import AgvTrackerConfig
from pointit.bridges.agv_tracker.service import AgvTracker
from pointit.bridges.foxglove.config import FoxgloveConfig
from pointit.bridges.foxglove.service import Foxglove
from pointit.runtime.clock import WallClock
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch, run_service
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ButtonEvent, Cursor, Health, PointingRay, SetWorkspace, UserPose, topics
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.service import Selector
from tests.integration.access.secured import link_of, make_site, routed
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import change


class SecuredSite:
    """The site's pui and selector; anna and ben, who may run their own shards; who looks on."""

    def __init__(self, buses: dict[str, ZenohBus]) -> None:
        self.buses = buses
        self.running: list[asyncio.Task[None]] = []
        self.shards: set[str] = set()
        self.health: dict[str, Health] = {}
        self.cursors: list[Cursor] = []
        self.hovers: list[Any] = []
        looking = buses["operator"]
        shards = self.shards
        looking.watch(topics.SHARD_ALIVE, lambda name, *, present: change(shards, name, here=present))
        looking.subscribe(topics.HEALTH, lambda health, name: self.health.__setitem__(name, health))
        looking.subscribe(topics.CURSOR, lambda cursor, _user: self.cursors.append(cursor), "anna")
        looking.subscribe(topics.HOVER, lambda hover, _user: self.hovers.append(hover), "anna")

    def start(self, who: str, service: Any, config: Any, name: str = "") -> None:
        launch = Launch(service=service, config=config, name=name)
        self.running.append(asyncio.create_task(run_service(launch, self.buses[who], WallClock())))

    async def point(self) -> None:
        bus = self.buses["anna"]
        clock = WallClock()
        bus.announce(topics.USER_ALIVE, "anna")
        origin_m = (0.0, 0.0, 0.0)
        bus.publisher(topics.POSE, "anna").put(
            UserPose(stamp_ns=clock.now_ns(), position_m=origin_m, yaw_rad=0.0)
        )
        rays = bus.publisher(topics.RAY, "anna")
        while True:
            origin_m = (0.0, 0.0, 1.6)
            direction = (0.6, 0.0, -0.8)
            rays.put(PointingRay(stamp_ns=clock.now_ns(), origin_m=origin_m, direction=direction))
            await asyncio.sleep(0.01)


@pytest_asyncio.fixture
async def site(tmp_path: Path) -> AsyncIterator[SecuredSite]:
    folder = make_site(tmp_path / "lab")
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(routed(folder))
        buses: dict[str, ZenohBus] = {}
        for name in ("anna", "ben", "services", "operator"):
            buses[name] = await ZenohBus.open(link_of(folder, name), patience_s=30)
            stack.push_async_callback(buses[name].close)
        site = SecuredSite(buses)
        site.start("services", Pui, PuiConfig())
        site.start("services", Selector, SelectorConfig())
        site.running.append(asyncio.create_task(site.point()))
        try:
            yield site
        finally:
            for task in site.running:
                task.cancel()
            await asyncio.gather(*site.running, return_exceptions=True)


async def test_a_person_may_run_their_own_shards(site: SecuredSite) -> None:
    config = PuiConfig(people=("anna",), workspace="horizontal")  # by which its cursors are told
    site.start("anna", Pui, config, "anna")
    site.start("anna", Selector, SelectorConfig(people=("anna",)), "anna")
    await until(lambda: site.shards == {"pui.anna", "selector.anna"}, what="the shards")
    await until(lambda: bool(site.cursors) and site.cursors[-1].surface_id.startswith("workspace/"))
    await until(lambda: bool(site.hovers), what="hovers")
    await until(lambda: {"pui.anna", "selector.anna"} <= site.health.keys(), what="their health")
    await site.buses["operator"].call(topics.SET_WORKSPACE, SetWorkspace(kind="sphere"), "anna")
    await until(lambda: site.cursors[-1].surface_id == "workspace/sphere")
    await until(lambda: not any(health.warnings for health in site.health.values()), what="no complaint")


@pytest.mark.parametrize("name", ["anna", "ben"])
async def test_nobody_serves_another_person(site: SecuredSite, name: str) -> None:
    config = PuiConfig(people=("anna", "ben"), workspace="horizontal")
    site.start("ben", Pui, config, name)
    await until(lambda: bool(site.cursors), what="anna's cursors by the site")
    await until(lambda: "pui.ben" in site.shards, what="his own")
    site.cursors.clear()
    await until(lambda: len(site.cursors) > 50)
    assert site.shards == {"pui.ben"}
    assert not any(cursor.surface_id.startswith("workspace/") for cursor in site.cursors)


def looking_on(link: Link, role: str) -> Link:
    """Return a link in another role, whose router would let it write."""
    assert link.credentials is not None
    file = link.credentials.link.model_copy(update={"role": role})
    return dataclasses.replace(link, credentials=dataclasses.replace(link.credentials, link=file))


def news_of(bus: ZenohBus) -> list[object]:
    """Return a list that fills with whose reports are heard and who comes and goes."""
    found: list[object] = []
    bus.subscribe(topics.HEALTH, lambda _message, name: found.append(name))
    bus.watch(topics.SERVICE_ALIVE, lambda name, *, present: found.append((name, present)))
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


async def test_messages_of_an_onlooker_stay_in_its_process(buses: tuple[str, ZenohBus, ZenohBus]) -> None:
    role, mine, other = buses
    here = news_of(mine)
    there = news_of(other)
    marks: list[str] = []
    other.subscribe(topics.BUTTON, lambda _message, name: marks.append(name))
    announced = mine.announce(topics.SERVICE_ALIVE, "web.2")
    late: list[tuple[str, bool]] = []
    mine.watch(topics.SERVICE_ALIVE, lambda name, *, present: late.append((name, present)))
    report = mine.publisher(topics.HEALTH, "web.2")
    mark = mine.publisher(topics.BUTTON, "end")
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


@pytest.mark.parametrize(
    ("service", "identity"),
    [(service, name) for service in (Foxglove, AgvTracker) for name in ("services", service.NAME)],
)
async def test_bridge_reports_by_the_services_identity_and_by_its_own(
    service: Any, identity: str, tmp_path: Path
) -> None:
    configs = {
        "foxglove": FoxgloveConfig(port=0),
        "agv-tracker": AgvTrackerConfig(broker=f"127.0.0.1:{free_port()}"),
    }
    folder = make_site(
        tmp_path / "lab",
        names={
            "services": "services",
            service.NAME: "service",
            "operator": "operator",
            "supervisor": "supervisor",
        },
    )
    health: dict[str, Health] = {}
    running_names: set[str] = set()
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(routed(folder))
        buses: dict[str, ZenohBus] = {}
        for name in (identity, "operator"):
            buses[name] = await ZenohBus.open(link_of(folder, name), patience_s=30)
            stack.push_async_callback(buses[name].close)
        operator = buses["operator"]
        operator.subscribe(topics.HEALTH, lambda message, name: health.__setitem__(name, message))
        operator.watch(
            topics.SERVICE_ALIVE, lambda name, *, present: change(running_names, name, here=present)
        )
        launch = Launch(service=service, config=configs[service.NAME])
        running = asyncio.create_task(run_service(launch, buses[identity], WallClock()))
        refused = f"{identity} may not "
        try:
            await until(
                lambda: {service.NAME} <= health.keys() & running_names, what="its health and presence"
            )
            await until(lambda: not any(refused in each for each in health[service.NAME].warnings))
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
