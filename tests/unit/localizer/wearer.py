"""A person beside a localizer on a bus: what it says, what they ask it, and where they point."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

from pointit.geometry.vector import Vec3
from pointit.runtime.clock import Clock, sleep
from pointit.schemas import Environment, Lamp, Localization, Message, SetPose, StartLocalization
from pointit.schemas import topics as at
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.service import Localizer
from tests.support.bench import Bench, memory_bench, until
from tests.unit.localizer.person import LAB, LAMPS, ROOM, USER, Person

FOUR = (*LAMPS, Lamp(id="led_3", position_m=LAB[3]))


class Wearer:
    """Points at what the localizer names, or ahead."""

    def __init__(self, bench: Bench, person: Person) -> None:
        self.bench = bench
        self.person = person
        self.poses = bench.collect(at.POSE, USER)
        self.progress = bench.collect(at.LOCALIZATION, USER)
        self.anchors = bench.collect(at.ANCHOR, USER)
        self.health = bench.collect(at.HEALTH)

    async def put(self, topic: at.Topic[Any], message: Message) -> None:
        self.bench.put(topic, message, USER)
        await self.bench.settle()

    async def call(self, request: at.Request[Any, Any], query: Any) -> str:
        answer = await self.bench.bus.call(request, query, USER)
        await self.bench.settle()
        return str(answer.message)

    async def start(self, method: str | None = None) -> str:
        query = StartLocalization.model_validate({"method": method})
        return await self.call(at.START_LOCALIZATION, query)

    async def set_pose(self, position_m: Vec3, yaw_rad: float = 0.0, **fields: Any) -> None:
        await self.call(at.SET_POSE, SetPose(position_m=position_m, yaw_rad=yaw_rad, **fields))

    async def live(self) -> None:
        """Point, 50 rays a second of the clock."""
        clock = self.bench.clock
        places = {lamp.id: lamp.position_m for lamp in FOUR}
        while True:
            self.bench.put(
                at.RAY, self.person.ray(places.get(self.lit, (3.0, 3.0, 1.2)), clock.now_ns()), USER
            )
            await sleep(clock, 0.02)

    @property
    def lit(self) -> str:
        """The lamp that is to be lit, or `""`."""
        return self.progress[-1].target_id if self.progress else ""

    @property
    def phase(self) -> str:
        return self.progress[-1].phase if self.progress else ""

    async def until_phase(self, phase: str, target_index: int | None = None) -> Localization:
        def reached() -> bool:
            last = self.progress[-1]
            return last.phase == phase and target_index in (None, last.target_index)

        await until(reached, what=f"{phase}, was {self.progress[-1]}")
        return self.progress[-1]

    @property
    def warnings(self) -> tuple[str, ...]:
        return self.health[-1].warnings if self.health else ()

    def figure(self, name: str) -> float | None:
        return next((figure.value for figure in self.health[-1].figures if figure.name == name), None)

    async def until_warned(self, sentence: str) -> None:
        await until(lambda: any(sentence in text for text in self.warnings), what=sentence)


@asynccontextmanager
async def worn(
    config: LocalizerConfig,
    clock: Clock | None = None,
    person: Person | None = None,
    environment: Environment | None = ROOM,
) -> AsyncGenerator[Wearer]:
    """Yield `person` at a localizer that has the map `environment`."""
    async with memory_bench(clock) as bench:
        wearer = Wearer(bench, person or Person())
        if environment is not None:
            bench.put(at.MAP, environment)
        bench.start(Localizer, config, USER)
        await bench.settle()
        yield wearer
