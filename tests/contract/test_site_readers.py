"""All that show a site show the same: seven situations of leaving and coming back, and a lost router."""

import asyncio
import contextlib
import functools
import inspect
import time
from collections.abc import AsyncGenerator, Callable, Generator
from types import SimpleNamespace
from typing import Any

import pytest

from pointit.api.site import Site as ApiSite
from pointit.bridges.foxglove import service as foxglove_service
from pointit.bridges.foxglove.config import FoxgloveConfig
from pointit.bridges.ros2 import service as ros2_service
from pointit.bridges.ros2.config import Ros2Config
from pointit.bridges.web.model.site_model import SiteModel
from pointit.cli.inspect import topics as echo
from pointit.cli.inspect.doctor import SiteObserver
from pointit.cli.inspect.trace import Tracer
from pointit.launch.run.monitor import Monitor, RunScore
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import WallClock
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Context
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, Health, Message, Selection, TrackedObjects, UserPose
from pointit.schemas.topics import CURSOR, HEALTH, OBJECTS, POSE, SELECTION, SERVICE_ALIVE, USER_ALIVE, Topic
from pointit.site.following import follow_site
from pointit.site.site_state import SiteState
from pointit.speech.interpreter import Interpreter
from tests.support.bench import background, until
from tests.support.buses import router_process, settled, site_of
from tests.unit.ros2.graph_of_one import FakeBackend

TOPICS: tuple[Topic[Any], ...] = (CURSOR, POSE, HEALTH, OBJECTS, SELECTION)
SERVICES = frozenset(("pui", "selector"))
Names = Callable[[], set[str]]


class Readers:
    """The names that each reader shows now, by topic."""

    def __init__(self) -> None:
        self.names: dict[str, dict[Topic[Any], Names]] = {}
        self.present: dict[str, Callable[[], frozenset[str]]] = {}
        self.ticks: list[Callable[[], object]] = []

    async def show_present(self, *instances: str) -> None:
        """Wait until all readers show that of the services of this test `instances` are present."""

        def shown() -> dict[str, frozenset[str]]:
            return {reader: each() & SERVICES for reader, each in self.present.items()}

        await until(
            lambda: all(each == set(instances) for each in shown().values()), what=lambda: f"{shown()}"
        )

    @contextlib.contextmanager
    def doing(self, step: Callable[[], object]) -> Generator[None]:
        """Do `step` again and again while `show` waits."""
        self.ticks.append(step)
        yield
        self.ticks.remove(step)

    async def show(self, topic: Topic[Any], *names: str) -> None:
        """Wait until all readers show `names` of `topic`, and no others."""

        def shown() -> dict[str, set[str]]:
            for tick in self.ticks:
                tick()
            return {reader: each[topic]() for reader, each in self.names.items() if topic in each}

        await until(
            lambda: all(each == set(names) for each in shown().values()),
            what=lambda: f"{topic.key} of {names}: {shown()}",
        )


@contextlib.asynccontextmanager
async def readers_on(bus: Any, monkeypatch: pytest.MonkeyPatch) -> AsyncGenerator[Readers]:
    """Yield page, ROS bridge, Foxglove, monitor of a run, API, doctor, speech, echo and trace on one bus."""

    async def opened(*_: object, **_named: object) -> FakeBackend:
        return FakeBackend()

    monkeypatch.setattr(ros2_service, "opened", opened)
    monkeypatch.setattr(foxglove_service, "LOOK_S", 3600.0)  # no viewer comes
    clock = WallClock()
    now_s = asyncio.get_running_loop().time

    def context(name: str) -> Context:
        return Context(bus=ServiceBus(bus, clock, name, name, ""), clock=clock)

    page = SiteModel("web", now_s())

    def take(topic: Topic[Any], message: Message, name: str) -> None:
        page.take(topic, name, message, clock.now_ns(), now_s())

    for topic in TOPICS:
        bus.subscribe(topic, functools.partial(take, topic))
    follow_site(page.state, bus, now_s, ())
    ros = ros2_service.Ros2(Ros2Config(), context("ros2"))
    people = ros._state.people
    foxglove = foxglove_service.Foxglove(FoxgloveConfig(), context("foxglove"))
    monitor = Monitor(RunScore(()), clock)
    monitor.attach(bus)
    doctor = SiteObserver()
    follow_site(doctor._site, bus, now_s, (HEALTH,))
    speech = Interpreter(bus, clock, "anna")._room
    tracer = Tracer(bus, "anna")
    echoed = SiteState()
    monkeypatch.setattr(echo, "SiteState", lambda: echoed)

    address = SimpleNamespace(join=lambda: contextlib.nullcontext(bus))

    async def echoing() -> None:
        await inspect.unwrap(echo.echo.callback or print)(address, "selection", count=None, as_json=True)

    async with ApiSite.on(bus, clock) as site, background(ros.run()), background(echoing()):
        newest = site.latest
        by_topic = {CURSOR: newest.cursor, POSE: newest.pose, HEALTH: newest.health}
        latest: dict[Topic[Any], Any] = {**by_topic, OBJECTS: newest.objects, SELECTION: newest.selection}
        readers = Readers()
        readers.names = {
            "page": {topic: lambda topic=topic: set(page.cache.names(topic)) for topic in TOPICS},
            "ros2": {
                CURSOR: lambda: {name for name, each in people.items() if each.cursor},
                POSE: lambda: {name for name, each in people.items() if each.pose},
                SELECTION: lambda: {""} if ros._state.selection else set(),
            },
            "foxglove": {
                topic: lambda topic=topic: {
                    each.name for each in foxglove._mirrored.values() if each.topic is topic
                }
                for topic in TOPICS
            },
            "monitor": {
                CURSOR: lambda: set(monitor.cursors),
                POSE: lambda: set(monitor.poses),
                HEALTH: lambda: set(monitor.health),
                SELECTION: lambda: set(monitor.site.all(SELECTION)),
            },
            "api": {topic: lambda newest=newest: set(newest) for topic, newest in latest.items()},
            "doctor": {HEALTH: lambda: set(doctor._site.all(HEALTH))},
            "speech": {OBJECTS: lambda: set(speech.objects)},
        }
        readers.present = {
            "page": lambda: page.present,
            "foxglove": lambda: foxglove._site.services,
            "monitor": lambda: monitor.site.services,
            "doctor": lambda: doctor._site.services,
            "speech": lambda: speech.site.services,
            "echo": lambda: echoed.services,
            "trace": lambda: tracer._site.services,
        }
        readers.ticks = [
            lambda: page.tick(now_s()),
            lambda: foxglove._site.tick(now_s()),
            lambda: speech.site.tick(now_s()),
        ]
        for each in readers.names["api"].values():
            each()  # received from now on
        yield readers
        monitor.detach()


class Writer:
    """Puts messages, each newer than the one before."""

    def __init__(self, bus: Any) -> None:
        self._bus = bus
        self._publishers: dict[tuple[str, str], Any] = {}

    def put(self, topic: Topic[Any], name: str) -> None:
        now_ns = time.time_ns()
        messages: dict[Topic[Any], Message] = {
            CURSOR: Cursor(stamp_ns=now_ns),
            POSE: UserPose(stamp_ns=now_ns, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0),
            HEALTH: Health(stamp_ns=now_ns, service=name or "web", instance=name or "web", pid=1),
            OBJECTS: TrackedObjects(stamp_ns=now_ns, objects=()),
            SELECTION: Selection(stamp_ns=now_ns),
        }
        key = topic.key, name
        if key not in self._publishers:
            self._publishers[key] = self._bus.publisher(topic, name)
        self._publishers[key].put(messages[topic])


@pytest.mark.parametrize("kind", ["memory", "zenoh-peer"])
async def test_all_readers_show_the_same_when_writers_leave_and_return(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with site_of(kind) as site, readers_on(site.b, monkeypatch) as readers:
        await site.settle()
        writer = Writer(site.a)
        anna, _ = (site.a.announce(USER_ALIVE, user) for user in ("anna", "ben"))
        pui, _ = (site.a.announce(SERVICE_ALIVE, instance) for instance in ("pui", "selector"))
        await readers.show_present("pui", "selector")
        for topic, name in ((CURSOR, "anna"), (CURSOR, "ben"), (POSE, "anna"), (OBJECTS, "conveyor")):
            writer.put(topic, name)
        for instance in ("pui", "selector"):
            writer.put(HEALTH, instance)
        writer.put(SELECTION, "")
        await readers.show(CURSOR, "anna", "ben")
        await readers.show(POSE, "anna")
        await readers.show(HEALTH, "pui", "selector")
        await readers.show(SELECTION, "")

        anna.close()
        await readers.show(CURSOR, "ben")
        await readers.show(POSE)
        writer.put(CURSOR, "anna")  # late
        writer.put(CURSOR, "clara")
        await readers.show(CURSOR, "ben", "clara")
        site.a.announce(USER_ALIVE, "anna")  # she repeats no state
        await readers.show(POSE, "anna")
        await readers.show(CURSOR, "ben", "clara")

        pui.close()
        await readers.show_present("selector")
        await readers.show(CURSOR)
        await readers.show(HEALTH, "selector")
        writer.put(CURSOR, "ben")  # late
        writer.put(HEALTH, "pui")
        writer.put(HEALTH, "keeper")
        await readers.show(HEALTH, "keeper", "selector")
        await readers.show(CURSOR)
        site.a.announce(SERVICE_ALIVE, "pui")
        await readers.show_present("pui", "selector")
        writer.put(CURSOR, "anna")
        await readers.show(CURSOR, "anna")

        writer.put(OBJECTS, "robots")
        await readers.show(OBJECTS)  # both are silent


async def test_all_readers_show_the_same_after_a_lost_router(monkeypatch: pytest.MonkeyPatch) -> None:
    async with contextlib.AsyncExitStack() as stack:
        router = await stack.enter_async_context(router_process())
        link = Link(connect=(router.endpoint,))
        a, b = [await ZenohBus.open(link, patience_s=30) for _ in range(2)]
        stack.push_async_callback(a.close)
        stack.push_async_callback(b.close)
        readers = await stack.enter_async_context(readers_on(b, monkeypatch))
        await settled(a, b)
        writer = Writer(a)
        a.announce(USER_ALIVE, "anna")
        for instance in SERVICES:
            a.announce(SERVICE_ALIVE, instance)
        await readers.show_present(*SERVICES)
        keys = (CURSOR, "anna"), (POSE, "anna"), (HEALTH, "pui"), (SELECTION, "")
        with readers.doing(lambda: [writer.put(*key) for key in keys]):  # the first may be lost
            for topic, name in keys:
                await readers.show(topic, name)
        router.stop()
        for topic, _name in keys:
            await readers.show(topic)
        await readers.show_present()
        router.start()
        await readers.show_present(*SERVICES)
        await readers.show(POSE, "anna")
        await readers.show(SELECTION, "")
        with readers.doing(lambda: writer.put(HEALTH, "pui")):
            await readers.show(HEALTH, "pui")
        await readers.show(CURSOR)
