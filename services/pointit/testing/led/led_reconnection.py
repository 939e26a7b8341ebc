"""Checks of an LED output whose device comes and goes, and of its end."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.testing import lifecycle
from pointit.testing.common import require_bounded_memory
from pointit.testing.led.harness import DARK, LED_SUITE, LedHarness, LedTrial, notices_loss
from pointit.testing.trial import absent, connected

STUCK_FRAMES = 20
MANY = 8000


@LED_SUITE.check(
    "Connect in a loop, send the kept frame whenever a connection is open, since nobody shows it again, and "
    "send it again every second: only sending tells that a connection is lost",
    notices_loss,
)
async def reconnects(harness: LedHarness) -> None:
    """Shows the newest frame on a device that comes late, or came back."""
    async with absent(harness.trial()) as trial:
        await trial.plug()
        for _ in range(2):
            await trial.replug()


LED_SUITE.add(lifecycle.warns, lifecycle.WARN, notices_loss)


@LED_SUITE.check(
    "Await only what can be cancelled, do not catch CancelledError, and limit the time of the last frame"
)
async def cancels(harness: LedHarness) -> None:
    """Ends within 1 s of being cancelled."""

    @asynccontextmanager
    async def stuck() -> AsyncGenerator[LedTrial]:
        async with connected(harness.trial()) as trial:
            trial.device.stall()
            for number in range(2, STUCK_FRAMES):
                trial.show(number)
                await asyncio.sleep(0.01)
            yield trial

    await lifecycle.cancels(harness)
    if harness.example().can_stall:
        await lifecycle.require_quick_end(stuck, "while the device read nothing")


@LED_SUITE.check("Send a dark frame in `finally` of `run`, and wait until it has left")
async def dark_at_end(harness: LedHarness) -> None:
    """Switches the strips off when it ends."""
    async with connected(harness.trial()) as trial:
        await trial.end()
        await trial.until(lambda: trial.shown()[-1:] == [DARK], "the strips were left lit")


@LED_SUITE.check(
    "Keep the newest frame alone; a queue without limit grows while the device is away or slow", alone=True
)
async def bounded_memory(harness: LedHarness) -> None:
    """Needs no more memory the longer it runs."""
    async with absent(harness.trial()) as trial:

        async def many() -> None:
            for number in range(MANY):
                trial.show(number + 1)
                if number % 100 == 0:
                    await asyncio.sleep(0)

        await require_bounded_memory(many, f"{MANY} frames without a device")


LED_SUITE.add(
    lifecycle.does_not_block,
    "Call nothing that waits, such as `time.sleep` or a blocking write: use asyncio's streams, or a thread",
    alone=True,
)
LED_SUITE.add(lifecycle.leaves_nothing, lifecycle.CLOSE, alone=True)
