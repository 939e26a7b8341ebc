"""A selector on a bus, people whose cursors stay somewhere, and all that it tells."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.runtime.clock import Clock
from pointit.schemas import Cursor, Health, TrackedObjects, topics
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.service import Selector
from tests.support.bench import Bench, ManualClock, memory_bench
from tests.unit.selector.room import cursor_on_strip, on_strip


def objects(clock: Clock, *ids: str) -> TrackedObjects:
    """Return `ids`, from a on, as objects at 1, 2, … m of strip 0."""
    listed = tuple(on_strip(name, ord(name) - ord("a") + 1.0) for name in ids)
    return TrackedObjects(stamp_ns=clock.now_ns(), objects=listed)


def cursor(clock: Clock, position_m: float) -> Cursor:
    return cursor_on_strip(clock.now_ns(), position_m)


async def stay(bench: Bench, clock: ManualClock, user: str, position_m: float, *ids: str) -> None:
    """Keep the cursor there for a second at 25 Hz, with `ids` listed."""
    for _ in range(25):
        clock.advance(0.04)
        bench.put(topics.OBJECTS, objects(clock, *ids), "conveyor")
        await bench.settle(3)
        bench.put(topics.CURSOR, cursor(clock, position_m), user)
        await bench.settle(3)


class Served:
    """All that a selector tells, by topic."""

    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        self.bench = bench
        self.bus = bench.bus
        self.clock = clock
        self.selections = bench.collect(topics.SELECTION)
        self.events = bench.collect(topics.SELECTION_EVENTS)
        self.health: list[Health] = bench.collect(topics.HEALTH)
        self.hovers = {user: bench.collect(topics.HOVER, user) for user in ("anna", "ben")}
        self.cues = {user: bench.collect(topics.FEEDBACK, user) for user in ("anna", "ben")}

    @property
    def told(self) -> list[tuple[str, str, str]]:
        """Return the events: what, object and person."""
        return [(event.event, event.object_id, event.user) for event in self.events]

    @property
    def owners(self) -> list[tuple[str, str]]:
        return [(one.id, one.user) for one in self.selections[-1].objects]

    async def stay(self, user: str, position_m: float, *ids: str) -> None:
        await stay(self.bench, self.clock, user, position_m, *ids)

    def warns(self, warning: str) -> bool:
        return any(warning in text for report in self.health[-1:] for text in report.warnings)


@asynccontextmanager
async def served(clock: ManualClock | None = None, **config: object) -> AsyncGenerator[Served]:
    clock = clock or ManualClock()
    async with memory_bench(clock) as bench:
        site = Served(bench, clock)
        bench.start(Selector, SelectorConfig.model_validate(config))
        await bench.settle()
        yield site
