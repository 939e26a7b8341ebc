"""Shared parts of the tests of the service: a fast driver, a map of two strips, objects on them."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.schemas import Cursor, Environment, Strip, StripsFrame, TrackedObjects
from pointit.schemas.topics import MAP, STRIPS_FRAME
from pointit.services.led_driver.config import LedDriverConfig, StyleConfig
from pointit.services.led_driver.service import LedDriver
from pointit.testing import UdpDevice
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.unit.led_driver.stage import item

FAST = LedDriverConfig(
    max_rate_hz=1000, patience_s=0, style=StyleConfig(kind_colors={"red": (200, 0, 0)}, tail_s=0.0)
)
MAP_MESSAGE = Environment(
    stamp_ns=1,
    name="test",
    strips=(
        Strip(id="a", line_m=((0, 0, 0), (2, 0, 0)), pixels=20),
        Strip(id="b", line_m=((0, 0, 0), (2, 0, 0)), pixels=20, direction=-1),
    ),
)


def cursor(clock: ManualClock, position_m: float, strip_id: str = "a") -> Cursor:
    return Cursor(
        stamp_ns=clock.now_ns() - 5_000_000, surface="strip", surface_id=strip_id, position_m=position_m
    )


def package(clock: ManualClock, *, speed_mps: float = 0.0) -> TrackedObjects:
    moving = item(0.5, 0.4, id="p1", surface_id="a", surface_speed_mps=speed_mps)
    return TrackedObjects(stamp_ns=clock.now_ns(), objects=(moving,))


def pixels(frame: StripsFrame, strip_id: str) -> dict[int, tuple[int, ...]]:
    data = next(strip.rgb for strip in frame.strips if strip.id == strip_id)
    return {k: tuple(data[3 * k : 3 * k + 3]) for k in range(20) if any(data[3 * k : 3 * k + 3])}


async def started(bench: Bench, config: LedDriverConfig = FAST) -> list[StripsFrame]:
    frames = bench.collect(STRIPS_FRAME)
    bench.start(LedDriver, config)
    await bench.settle()
    bench.put(MAP, MAP_MESSAGE)
    await until(lambda: len(frames) == 1)
    return frames


@asynccontextmanager
async def driven(
    config: LedDriverConfig = FAST,
) -> AsyncGenerator[tuple[Bench, ManualClock, list[StripsFrame]]]:
    """Run a driver that has the map. Yield the bench, its clock, and the frames, of which one is drawn."""
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        yield bench, clock, await started(bench, config)


@asynccontextmanager
async def receiver() -> AsyncGenerator[UdpDevice]:
    """Yield a device that receives datagrams."""
    device = UdpDevice()
    await device.plug()
    yield device
    await device.unplug()
    device.close()


async def next_frame(frames: list[StripsFrame]) -> StripsFrame:
    count = len(frames)
    await until(lambda: len(frames) > count)
    return frames[-1]
