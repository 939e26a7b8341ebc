"""Checks of an LED output whose device comes and goes, and of its end."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.testing.check import CheckFailedError
from pointit.testing.common import MEMORY_BYTES, memory_growth, require_nothing_left, require_responsive
from pointit.testing.led.harness import DARK, LedHarness, LedTrial, pattern
from pointit.testing.led.suite import LED_SUITE, can_stall, lit, notices_loss
from pointit.testing.trial import Trial, require_quick_end

ABSENT_S = 0.2
STUCK_FRAMES = 20
MANY = 8000


@LED_SUITE.add(
    "Connect in a loop, and send the kept frame whenever a connection is open: nobody shows it again",
    notices_loss,
)
async def reconnects(harness: LedHarness) -> None:
    """Shows the newest frame on a device that comes late, or came back."""
    async with LedTrial(harness) as trial:
        trial.start()
        trial.show(pattern(1))
        await asyncio.sleep(ABSENT_S)
        trial.require_running()
        await trial.device.plug()
        await trial.see(pattern(1), "the device came, and did not get the newest frame")
        for _ in range(2):
            await trial.device.unplug()
            await asyncio.sleep(ABSENT_S)
            trial.require_running()
            await trial.device.plug()
            await trial.see(pattern(1), "the device came back, and did not get the newest frame")


@LED_SUITE.add(
    "Call `surroundings.health.warn(topic, sentence)`, which says what to do, and later `clear(topic)`",
    notices_loss,
)
async def warns(harness: LedHarness) -> None:
    """Warns while the device is away, and no longer when it is back."""
    async with LedTrial(harness) as trial:
        trial.start()
        trial.show(pattern(1))
        await trial.until(lambda: bool(trial.health.warnings), "the device was away and no warning said so")
        await trial.device.plug()
        await trial.see(pattern(1), "the device came, and did not get the newest frame")
        await trial.until(lambda: not trial.health.warnings, "the device was back and a warning stayed")
        if not trial.health.in_loop:
            raise CheckFailedError("health was reported from another thread than the event loop's")


@LED_SUITE.add(
    "Await only what can be cancelled, do not catch CancelledError, and limit the time of the last frame",
)
async def cancels(harness: LedHarness) -> None:
    """Ends within 1 s of being cancelled."""

    @asynccontextmanager
    async def absent() -> AsyncGenerator[Trial]:
        async with LedTrial(harness) as trial:
            trial.start()
            trial.show(pattern(1))
            await asyncio.sleep(ABSENT_S)
            yield trial

    @asynccontextmanager
    async def stuck() -> AsyncGenerator[Trial]:
        async with lit(harness) as trial:
            trial.device.stall()
            for number in range(2, STUCK_FRAMES):
                trial.show(pattern(number))
                await asyncio.sleep(0.01)
            yield trial

    await require_quick_end(absent, "while it waited for the device")
    await require_quick_end(lambda: lit(harness), "while the device was connected")
    if can_stall(harness):
        await require_quick_end(stuck, "while the device read nothing")


@LED_SUITE.add("Send a dark frame in `finally` of `run`, and wait until it has left")
async def dark_at_end(harness: LedHarness) -> None:
    """Switches the strips off when it ends."""
    async with lit(harness) as trial:
        await trial.end()
        await trial.until(lambda: trial.shown()[-1:] == [DARK], "the strips were left lit")


@LED_SUITE.add(
    "Keep the newest frame alone; a queue without limit grows while the device is away or slow",
    alone=True,
)
async def bounded_memory(harness: LedHarness) -> None:
    """Needs no more memory the longer it runs."""
    async with LedTrial(harness) as trial:
        trial.start()
        trial.show(pattern(1))

        async def many() -> None:
            for number in range(MANY):
                trial.show(pattern(number + 1))
                if number % 100 == 0:
                    await asyncio.sleep(0)

        grown = await memory_growth(many)
        if grown > MEMORY_BYTES:
            raise CheckFailedError(f"after {MANY} frames without a device it held {grown / 1e6:.1f} MB more")


@LED_SUITE.add(
    "Call nothing that waits, such as `time.sleep` or a blocking write: use asyncio's streams, or a thread",
    alone=True,
)
async def does_not_block(harness: LedHarness) -> None:
    """Does not hold up the event loop."""

    async def live() -> None:
        async with LedTrial(harness) as trial:
            trial.start()
            trial.show(pattern(1))
            await asyncio.sleep(ABSENT_S)
            await trial.device.plug()
            await trial.see(pattern(1), "the device came, and did not get the newest frame")
            await trial.device.unplug()
            trial.show(pattern(2))
            await asyncio.sleep(ABSENT_S)

    await require_responsive(live)


@LED_SUITE.add(
    "Close in `finally` or `async with` what `run` opens, and cancel and await its tasks",
    alone=True,
)
async def leaves_nothing(harness: LedHarness) -> None:
    """Leaves no task, thread, file or socket when it has ended."""

    async def round_trip() -> None:
        async with lit(harness) as trial:
            if notices_loss(harness):
                await trial.device.unplug()
                await asyncio.sleep(ABSENT_S)
                await trial.device.plug()
                await trial.see(pattern(1), "the device came back, and did not get the newest frame")

    await require_nothing_left(round_trip)
