"""A source that a test moves, in imu-bridge on a bus in memory and in virtual time."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from unittest import mock

from pointit.runtime.config.config import Config
from pointit.runtime.service.surroundings import HealthSink, NullHealth, Surroundings
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import Feedback
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.reading import Deliver, Item
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.imu_bridge.sources import SOURCES, ImuSource
from tests.support.bench import Bench, memory_bench


class Puppet:
    """Delivers what a test says, and remembers cues with their time."""

    def __init__(self) -> None:
        self.deliver: Deliver | None = None
        self.health: HealthSink = NullHealth()
        self.cues: list[tuple[float, Feedback]] = []

    async def run(self, deliver: Deliver) -> None:
        self.deliver = deliver
        await asyncio.Event().wait()

    def cue(self, cue: Feedback) -> None:
        self.cues.append((asyncio.get_running_loop().time(), cue))

    def give(self, *items: Item) -> None:
        assert self.deliver is not None
        for item in items:
            self.deliver(item)


@asynccontextmanager
async def with_puppet() -> AsyncGenerator[tuple[Bench, Puppet]]:
    """Yield a bench with the wrist of anna, and its source."""
    puppet = Puppet()

    def make(_config: Config, around: Surroundings) -> Puppet:
        puppet.health = around.health
        return puppet

    source = ImuSource(summary="", config=Config, make=make)
    with mock.patch.object(SOURCES, "get", return_value=source):
        async with memory_bench(VirtualClock()) as bench:
            bench.start(ImuBridge, ImuBridgeConfig(source="page"), user="anna")
            await asyncio.sleep(0.1)
            yield bench, puppet


def virtually(test: Callable[[Bench, Puppet], Awaitable[None]]) -> None:
    """Run `test` with a bench and a puppet in virtual time."""

    async def run() -> None:
        async with with_puppet() as (bench, puppet):
            await test(bench, puppet)

    run_virtually(run())
