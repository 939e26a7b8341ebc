"""A source of orientations beside wrists within its reach, in virtual time; and scenario_3 with one."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

import pointit
from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.plugins import ImuSource, Surroundings
from pointit.runtime.virtual_time import VirtualClock
from pointit.services.imu_bridge.ble.ble_source import BleSource
from pointit.services.imu_bridge.sources import Item
from pointit_lab.devices.wrists.wrist import SimulatedWrist
from tests.devices.bumble_radio import air
from tests.devices.bumble_wrist import BumbleWrist
from tests.devices.red_segments import Follower
from tests.support.bench import background
from tests.support.running_source import Health

POSTURE = rotation.from_azimuth_elevation(0.7, -0.3)
PATIENCE_S = 60.0
RATE_HZ = 100.0
REST_S = 8.0
"""Time for which the arm rests ahead, so that a fusion on the host finds its period and bias, s."""
T = TypeVar("T")


class Warnings(Health):
    """Health that keeps every warning."""

    def __init__(self) -> None:
        super().__init__()
        self.all: list[str] = []

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        super().warn(code, sentence, subject)
        if sentence:
            self.all.append(sentence)


@dataclass
class Session:
    """Items that a source has delivered, with the loop's time, and its wrists."""

    source: BleSource
    wrists: list[BumbleWrist]
    health: Warnings
    items: list[tuple[float, Item]] = field(default_factory=list[tuple[float, Item]])
    task: asyncio.Task[None] | None = None

    @property
    def wrist(self) -> BumbleWrist:
        return self.wrists[0]

    def of(self, kind: type[T]) -> list[T]:
        """Return the delivered items of a kind."""
        return [item for _, item in self.items if isinstance(item, kind)]

    def times_s(self, kind: type[Any]) -> list[float]:
        return [at_s for at_s, item in self.items if isinstance(item, kind)]

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait for `condition`."""
        async with asyncio.timeout(PATIENCE_S):
            while not condition():
                assert self.task is not None
                assert not self.task.done()
                await asyncio.sleep(0.01)

    async def end(self) -> None:
        """Cancel the source, and wait for its end."""
        assert self.task is not None
        self.task.cancel()
        await asyncio.wait({self.task})
        assert self.task.cancelled()


@asynccontextmanager
async def worn(
    plugin: ImuSource,
    *simulated: SimulatedWrist,
    rate_hz: float = RATE_HZ,
    parameters: Mapping[str, object] | None = None,
) -> AsyncGenerator[Session]:
    """Run a source with wrists within reach, which advertise and stream a posture.

    `parameters` have values, or functions of the wrists that return them.
    """
    async with air() as around, contextlib.AsyncExitStack() as stack:
        wrists = [await around.wrist(each) for each in simulated]
        health = Warnings()
        surroundings = Surroundings(
            clock=VirtualClock(), health=health, folder=Surroundings.detached().folder, user="anna"
        )
        values = {name: each(wrists) if callable(each) else each for name, each in (parameters or {}).items()}
        config = plugin.config.model_validate({"adapter": around.adapter, **values})
        plugin.check(config)
        source = plugin.make(config, surroundings)
        assert isinstance(source, BleSource)
        session = Session(source, wrists, health)
        for wrist in wrists:
            await wrist.appear()
            await stack.enter_async_context(background(wrist.stream(rate_hz, lambda: POSTURE)))
        loop = asyncio.get_running_loop()
        running = source.run(lambda item: session.items.append((loop.time(), item)))
        session.task = asyncio.create_task(running)
        stack.push_async_callback(session.end)
        yield session


async def require_selection(name: str, simulated: SimulatedWrist, rate_hz: float = RATE_HZ) -> None:
    """Play scenario_3 with the source `name`, whose wrist follows red segments, until two are selected.

    They must be those that it follows.
    """
    async with air() as around:
        wrist = await around.wrist(simulated)
        await wrist.appear()
        settings = {f"imu-bridge.{name}.adapter": around.adapter}
        run = pointit.run("scenario_3", seed=1, imu=[f"{name}:{wrist.address}"], settings=settings)
        async with run as site:
            follower = Follower(site)

            def posture() -> Quaternion:
                is_resting = asyncio.get_running_loop().time() < REST_S
                return rotation.IDENTITY if is_resting else follower.orientation()

            async with background(wrist.stream(rate_hz, posture)), asyncio.timeout(PATIENCE_S):
                async for event in site.selections():
                    assert (event.event, event.user) == ("selected", "user1")
                    assert event.object_id == follower.target
                    follower.done.add(event.object_id)
                    if len(follower.done) == 2:
                        return
