"""The output: ports of their own, keep-alives, darkness at the end, late and stuck controllers, current."""

import asyncio
from pathlib import Path

import pytest

from pointit.runtime import ConfigError, Context, MemoryBus, WallClock
from pointit.runtime.health import ServiceBus
from pointit.runtime.memory_bus import Exchange
from pointit.schemas.topics import (
    CURSOR,
    HEALTH,
)
from pointit.services.led_driver.config import LedDriverConfig, OutputConfig
from pointit.services.led_driver.service import LedDriver
from tests.support.bench import ManualClock, memory_bench, until
from tests.support.pty_device import Listener, pty_device
from tests.unit.led_driver.driving import FAST, cursor, next_frame, started


@pytest.mark.parametrize(
    "outputs",
    [
        (OutputConfig(kind="expander"),),
        (OutputConfig(kind="expander", port="x"), OutputConfig(kind="expander", port="x")),
    ],
)
async def test_an_output_without_a_port_of_its_own_is_refused(outputs: tuple[OutputConfig, ...]) -> None:
    bus = MemoryBus(Exchange())
    view = ServiceBus(bus, WallClock(), "led-driver", "led-driver")
    with pytest.raises(ConfigError, match=r"outputs\.\d\.port"):
        LedDriver(LedDriverConfig(outputs=outputs), Context(bus=view, clock=WallClock()))
    await bus.close()


MAGIC = b"UPXL"
SET_SIZE = 4 + 6 + 60 + 4
DRAW_SIZE = 10


def expander(path: Path) -> LedDriverConfig:
    return FAST.model_copy(update={"outputs": (OutputConfig(kind="expander", port=str(path)),)})


def colored(stream: bytes) -> list[bool]:
    """Return for each set-channel frame in a stream of whole frames whether it is not dark."""
    frames = stream.split(MAGIC)[1:]
    return [any(frame[6:66]) for frame in frames if frame[1] == 1]


async def test_the_expander_gets_a_throw_away_frame_keep_alives_and_darkness_at_the_end(
    tmp_path: Path,
) -> None:
    stream = bytearray()
    clock = ManualClock()
    with pty_device(tmp_path / "led") as device, Listener(device, stream.extend):
        async with memory_bench(clock) as bench:
            await started(bench, expander(device.path))
            bench.put(CURSOR, cursor(clock, 0.5), "anna")
            await until(lambda: any(colored(bytes(stream))))
            # the standing clock keeps the cursor; nothing changes, and yet it is sent again
            seen = sum(colored(bytes(stream)))
            await until(lambda: sum(colored(bytes(stream))) >= seen + 2)
            began_s = asyncio.get_running_loop().time()
        assert asyncio.get_running_loop().time() - began_s < 2.0
        await until(lambda: colored(bytes(stream))[-4:] == [True, False, False, False])
        one = 2 * SET_SIZE + DRAW_SIZE
        assert stream[:one] == stream[one : 2 * one]  # the first may be swallowed


async def test_what_an_expander_draws_is_shown_and_said_when_it_is_too_much(tmp_path: Path) -> None:
    clock = ManualClock()
    output = OutputConfig(kind="expander", port=str(tmp_path / "led"), max_current_a=0.05)
    async with memory_bench(clock) as bench:
        reports = bench.collect(HEALTH)
        frames = await started(bench, FAST.model_copy(update={"outputs": (output,)}))
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        await next_frame(frames)
        await until(lambda: any("dimmed to 0.05 A" in text for text in reports[-1].warnings))
        figure = next(figure for figure in reports[-1].figures if figure.name.startswith("current"))
        assert figure.unit == "A"
        assert 0.04 < figure.value <= 0.05
        bench.put(CURSOR, cursor(clock, 9.0), "anna")
        await next_frame(frames)
        await until(lambda: any(figure.value == 0.0 for figure in reports[-1].figures))


async def test_the_expander_may_come_late_and_come_back(tmp_path: Path) -> None:
    stream = bytearray()
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        reports = bench.collect(HEALTH)
        await started(bench, expander(tmp_path / "led"))
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        await until(lambda: bool(reports) and any("is not there" in text for text in reports[-1].warnings))
        with pty_device(tmp_path / "led") as device, Listener(device, stream.extend) as listener:
            await until(lambda: any(colored(bytes(stream))))
            await until(lambda: not reports[-1].warnings)
            with listener.lock:
                device.unplug()
            await until(lambda: bool(reports[-1].warnings))
            stream.clear()
            with listener.lock:
                device.plug()
            await until(lambda: any(colored(bytes(stream))))


async def test_a_stuck_controller_is_said_and_holds_nobody_up(tmp_path: Path) -> None:
    clock = ManualClock()
    with pty_device(tmp_path / "led") as device:  # nobody reads it
        async with memory_bench(clock) as bench:
            reports = bench.collect(HEALTH)
            frames = await started(bench, expander(device.path))
            step = 0

            def said() -> bool:
                nonlocal step
                step += 1
                bench.put(CURSOR, cursor(clock, step % 20 / 10 + 0.05), "anna")
                return bool(reports) and any("no more data" in text for text in reports[-1].warnings)

            await until(said, 20)
            await next_frame(frames)
