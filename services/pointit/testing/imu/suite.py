"""The suite of checks of IMU sources, and the states of a source from which they start."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.testing.check import Suite
from pointit.testing.imu.harness import ImuHarness, ImuTrial

IMU_SUITE: Suite[ImuHarness] = Suite()


def sends(harness: ImuHarness) -> bool:
    """Return True if there is a fake device that sends."""
    return harness.encode is not None


def delivers_readings(harness: ImuHarness) -> bool:
    """Return True if the source has readings of its own."""
    return harness.delivers


def notices_loss(harness: ImuHarness) -> bool:
    """Return True if the source can notice that its device has vanished."""
    return sends(harness) and harness.makes(lambda device: device.is_connected)


@asynccontextmanager
async def connected(harness: ImuHarness) -> AsyncGenerator[ImuTrial]:
    """Yield a trial that has delivered a first reading."""
    async with ImuTrial(harness) as trial:
        await trial.device.plug()
        trial.start()
        if sends(harness):
            await trial.hear("no reading of the device was delivered")
        elif harness.delivers:
            await trial.until(lambda: trial.count > 0, "no reading was delivered")
        yield trial
