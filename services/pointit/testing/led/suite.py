"""The suite of checks of LED outputs, and the state of an output from which they start."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.testing.check import Suite
from pointit.testing.led.harness import LedHarness, LedTrial, pattern

LED_SUITE: Suite[LedHarness] = Suite()


def notices_loss(harness: LedHarness) -> bool:
    """Return True if the output can notice that its device has vanished."""
    return harness.makes(lambda device: device.is_connected)


def can_stall(harness: LedHarness) -> bool:
    """Return True if the device can stop reading."""
    return harness.makes(lambda device: device.can_stall)


@asynccontextmanager
async def lit(harness: LedHarness) -> AsyncGenerator[LedTrial]:
    """Yield a trial whose device shows the first pattern."""
    async with LedTrial(harness) as trial:
        await trial.device.plug()
        trial.start()
        trial.show(pattern(1))
        await trial.see(pattern(1), "the first frame did not reach the device")
        yield trial
