"""Two hosts with a person and a shard of the selector each, and the site's selector, on one router."""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import AsyncExitStack, asynccontextmanager

from pointit.runtime.clock import WallClock
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch, run_service
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import NS_PER_S, Claim, Health, Hover, Selection, SelectionEvent, topics
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.service import Selector
from tests.support.bench import until
from tests.support.buses import RouterProcess, router_process
from tests.unit.selector.served import cursor, objects

RATE_HZ = 25.0
PACKAGE_M = 1.0
AWAY_M = 8.0
LEFT_S = 0.6
"""Twice the time after which an object that was left can be selected again, s."""
PATIENT = {"objects_stale_after_s": 60.0, "unseen_after_s": 60.0, "longest_gap_s": 2.0}
"""On a busy machine, and with links that are cut."""


class Person:
    """A host of one person: a bus of their own, a shard, and their cursor."""

    def __init__(self, name: str, bus: ZenohBus) -> None:
        self.name = name
        self.bus = bus
        self.at_m = AWAY_M
        self.claims: list[Claim] = []
        self.hovers: list[Hover] = []
        self.events: list[SelectionEvent] = []
        self.selections: list[Selection] = []
        self.warnings: tuple[str, ...] = ()
        self.services: set[str] = set()
        self._cursors = bus.publisher(topics.CURSOR, name)
        bus.subscribe(topics.CLAIM, lambda claim, _user: self.claims.append(claim), name)
        bus.subscribe(topics.HOVER, lambda hover, _user: self.hovers.append(hover), name)
        bus.subscribe(topics.SELECTION_EVENTS, lambda event, _name: self.events.append(event))
        bus.subscribe(topics.SELECTION, lambda selection, _name: self.selections.append(selection))
        bus.subscribe(topics.HEALTH, self._on_health, f"selector.{name}")
        bus.watch(topics.SERVICE_ALIVE, self._on_service)
        bus.announce(topics.USER_ALIVE, name)

    @property
    def toggles(self) -> list[Claim]:
        return list({claim.stamp_ns: claim for claim in self.claims if claim.wish == "toggle"}.values())

    @property
    def away_s(self) -> float:
        """Return for how long they have hovered nothing, s."""
        since = next(
            (index for index, hover in enumerate(self.hovers) if not hover.object_id), len(self.hovers)
        )
        away = self.hovers[since:]
        return (away[-1].stamp_ns - away[0].stamp_ns) / NS_PER_S if away else 0.0

    def point(self, clock: WallClock) -> None:
        self._cursors.put(cursor(clock, self.at_m))

    def _on_health(self, health: Health, _name: str) -> None:
        self.warnings = health.warnings

    def _on_service(self, name: str, *, present: bool) -> None:
        (self.services.add if present else self.services.discard)(name)


class Hall:
    """A site of three hosts on one router: the selector and the conveyor, anna and ben."""

    def __init__(self, router: RouterProcess, site: ZenohBus, *people: Person) -> None:
        self.router = router
        self.site = site
        self.people = people
        self.anna, self.ben = people
        self.clock = WallClock()
        self.events: list[SelectionEvent] = []
        self.tasks: list[asyncio.Task[None]] = []
        self.selections: list[Selection] = []
        site.subscribe(topics.SELECTION_EVENTS, lambda event, _name: self.events.append(event))
        site.subscribe(topics.SELECTION, lambda selection, _name: self.selections.append(selection))
        self._objects = site.publisher(topics.OBJECTS, "conveyor")
        self.selector = self.start(site)
        for person in people:
            self.start(person.bus, person.name)
        self.tasks.append(asyncio.create_task(self._move()))

    def start(self, bus: ZenohBus, user: str = "") -> asyncio.Task[None]:
        config = SelectorConfig.model_validate({**PATIENT, "people": (user,) if user else ()})
        launch = Launch(service=Selector, config=config, name=user)
        task = asyncio.create_task(run_service(launch, bus, self.clock))
        self.tasks.append(task)
        return task

    async def all(self, condition: Callable[[Person], bool], what: str) -> None:
        await until(lambda: all(condition(person) for person in self.people), what=what)

    async def ready(self) -> None:
        """Wait until both shards hover objects and reach the selector."""

        def is_heard(person: Person) -> bool:
            for task in self.tasks:
                if task.done() and not task.cancelled():
                    task.result()  # a selector that has failed is never heard
            return "selector" in person.services

        await self.all(is_heard, "the selector")
        for person in self.people:
            person.hovers.clear()
        await self.all(lambda person: bool(person.hovers), "hovers")
        await self.settled()

    async def settled(self) -> None:
        """Wait until each claim has its event, and all have the same events and the same selection."""
        await self.all(
            lambda person: all(self.answers(person, claim) for claim in person.toggles), "answers to claims"
        )
        await self.all(lambda person: self.numbers(person) == self.numbers(self), "all events")
        await self.all(lambda person: person.selections[-1:] == self.selections[-1:], "the selection")

    def answers(self, person: Person, claim: Claim) -> list[SelectionEvent]:
        told = {event.seq: event for event in self.events}
        return [one for one in told.values() if (one.user, one.stamp_ns) == (person.name, claim.stamp_ns)]

    @staticmethod
    def numbers(reader: "Person | Hall") -> set[int]:
        """Return the numbers of a reader's events, which come in another order after a link was cut."""
        return {event.seq for event in reader.events}

    def check(self) -> None:
        """Check that each claim was decided once, and that each change is its owner's."""
        for person in self.people:
            assert [len(self.answers(person, claim)) for claim in person.toggles] == [1] * len(person.toggles)
        owner = ""
        for event in {event.seq: event for event in self.events}.values():
            if event.event == "selected":
                assert owner == ""
                owner = event.user
            elif event.event == "deselected":
                assert owner == event.user
                owner = ""
        for person in self.people:
            assert [one.user for one in person.selections[-1].objects] == ([owner] if owner else [])

    def point(self) -> None:
        for person in self.people:
            person.at_m = PACKAGE_M

    async def claims(self) -> bool:
        """Wait until everybody has claimed once more, or has noticed that it is of no use.

        Return True if all have claimed.
        """
        before = {person.name: len(person.toggles) for person in self.people}

        def has_claimed(person: Person) -> bool:
            return len(person.toggles) > before[person.name]

        await self.all(lambda person: has_claimed(person) or "selector" not in person.services, "claims")
        return all(has_claimed(person) for person in self.people)

    async def leave(self) -> None:
        """Have everybody point elsewhere for so long that they can select again."""
        for person in self.people:
            person.at_m = AWAY_M
            person.hovers.clear()
        await self.all(lambda person: person.away_s > LEFT_S, "people to leave")

    async def cut(self) -> None:
        await asyncio.to_thread(self.router.stop)
        await self.all(lambda person: "selector" not in person.services, "the cut")

    async def heal(self) -> None:
        await asyncio.to_thread(self.router.start)
        await self.all(lambda person: "selector" in person.services, "the selector again")

    async def stop(self) -> None:
        for task in self.tasks:
            task.cancel()
        await asyncio.wait(self.tasks)

    async def _move(self) -> None:
        while True:
            self._objects.put(objects(self.clock, "a"))
            for person in self.people:
                person.point(self.clock)
            await asyncio.sleep(1.0 / RATE_HZ)


@asynccontextmanager
async def running_hall() -> AsyncGenerator[Hall]:
    """Yield a hall in which both people hover, and can select."""
    async with router_process() as router, AsyncExitStack() as stack:
        buses: list[ZenohBus] = []
        for _ in range(3):
            buses.append(await ZenohBus.open(Link(connect=(router.endpoint,)), patience_s=30))
            stack.push_async_callback(buses[-1].close)
        hall = Hall(router, buses[0], Person("anna", buses[1]), Person("ben", buses[2]))
        stack.push_async_callback(hall.stop)
        await hall.ready()
        yield hall
