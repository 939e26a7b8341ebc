"""One life of a conveyor on a bus."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.schemas import Environment, SetFeeding, topics
from pointit.services.conveyor_sim.service import ConveyorSim
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.unit.conveyor_sim.rooms import FORK, config


class Shift:
    """All that the conveyor tells, by topic."""

    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        self.bench = bench
        self.bus = bench.bus
        self.clock = clock
        self.lists = bench.collect(topics.OBJECTS)
        self.events = bench.collect(topics.SELECTION_EVENTS)
        self.states = bench.collect(topics.CONVEYOR_STATE)
        self.health = bench.collect(topics.HEALTH)

    @property
    def ids(self) -> list[str]:
        return [tracked.id for tracked in self.lists[-1].objects]

    def warns(self, warning: str) -> bool:
        return any(warning in text for text in self.health[-1].warnings)

    async def go(self, seconds: float, step_s: float = 0.5) -> None:
        """Let time pass, with a report in each step."""
        for _ in range(round(seconds / step_s)):
            self.clock.advance(step_s)
            await until(lambda: bool(self.lists) and self.lists[-1].stamp_ns == self.clock.now_ns())

    async def switch(self, *, feeding: bool) -> str:
        return (await self.bus.call(topics.SET_FEEDING, SetFeeding(feeding=feeding))).message


@asynccontextmanager
async def shift(
    clock: ManualClock | None = None, room: Environment = FORK, **changes: object
) -> AsyncGenerator[Shift]:
    """Run a conveyor until it has reported its packages."""
    clock = clock or ManualClock()
    async with memory_bench(clock) as bench:
        one = Shift(bench, clock)
        bench.start(ConveyorSim, config(**{"rate_hz": 100.0, **changes}))
        bench.put(topics.MAP, room)
        await until(lambda: bool(one.lists))
        yield one
