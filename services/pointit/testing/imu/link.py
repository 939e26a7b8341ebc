"""Checks of an IMU source whose device comes and goes, and of its end."""

import asyncio
import time
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.testing.check import CheckFailedError
from pointit.testing.common import require_nothing_left, require_responsive
from pointit.testing.imu.harness import ImuHarness, ImuTrial
from pointit.testing.imu.suite import IMU_SUITE, connected, notices_loss, sends
from pointit.testing.trial import TRIES, Trial, require_quick_end

ABSENT_S = 0.2
SILENCE_S = 0.6
VIRTUAL_SILENCE_S = 120.0
MOST_CPU = 0.15
"""Share of one core above which a source that gets nothing is said to spin. Waiting takes 0.02."""


@IMU_SUITE.add("Catch OSError around connecting, and try again after a pause", sends)
async def waits_for_device(harness: ImuHarness) -> None:
    """Waits for a device that is not there yet."""
    async with ImuTrial(harness) as trial:
        trial.start()
        await asyncio.sleep(ABSENT_S)
        trial.require_running()
        await trial.device.plug()
        await trial.hear("the device came, and no reading was delivered")


@IMU_SUITE.add("Connect in a loop: end of file and OSError lead back to connecting, after a pause", sends)
async def reconnects(harness: ImuHarness) -> None:
    """Reconnects after the device has vanished."""
    async with connected(harness) as trial:
        for time_no in ("first", "second"):
            await trial.device.unplug()
            await asyncio.sleep(ABSENT_S)
            await trial.device.plug()
            await trial.hear(f"after the {time_no} loss, the device came back and no reading was delivered")


@IMU_SUITE.add(
    "Call `deliver(Reconnected())` whenever a connection is open, since a restarted device may have turned "
    "its yaw",
    notices_loss,
)
async def tells_reconnection(harness: ImuHarness) -> None:
    """Tells that the device was connected again."""
    async with connected(harness) as trial:
        before = trial.reconnections
        await trial.device.unplug()
        await asyncio.sleep(ABSENT_S)
        await trial.device.plug()
        await trial.hear("the device came back and no reading was delivered")
        if trial.reconnections == before:
            raise CheckFailedError(
                "the device came back and no `Reconnected` was delivered before its reading"
            )


@IMU_SUITE.add(
    "Call `surroundings.health.warn(topic, sentence)`, which says what to do, and later `clear(topic)`",
    sends,
)
async def warns(harness: ImuHarness) -> None:
    """Warns while the device is away, and no longer when it is back."""
    async with ImuTrial(harness) as trial:
        trial.start()
        await trial.until(lambda: bool(trial.health.warnings), "the device was away and no warning said so")
        await trial.device.plug()
        await trial.hear("the device came, and no reading was delivered")
        await trial.until(
            lambda: not trial.health.warnings,
            "the device was back and a warning stayed",
            trial.send,
        )


@IMU_SUITE.add(
    "Await the next bytes instead of asking for them in a loop, and take silence for no error",
    alone=True,
)
async def silence(harness: ImuHarness) -> None:
    """Waits through silence, without using the processor."""
    async with connected(harness) as trial:
        used = 0.0
        for _ in range(TRIES):
            began_s, cpu_s = time.monotonic(), time.process_time()
            await asyncio.sleep(VIRTUAL_SILENCE_S if harness.virtual_time else SILENCE_S)
            used = (time.process_time() - cpu_s) / max(time.monotonic() - began_s, 1e-3)
            trial.require_running()
            if used <= MOST_CPU or harness.virtual_time:
                break
        else:
            raise CheckFailedError(f"while nothing arrived it used {used:.0%} of a processor core")
        if sends(harness):
            await trial.hear("after a silence, no reading was delivered")


@IMU_SUITE.add("Await only what can be cancelled, do not catch CancelledError, and join no thread for longer")
async def cancels(harness: ImuHarness) -> None:
    """Ends within 1 s of being cancelled."""

    @asynccontextmanager
    async def absent() -> AsyncGenerator[Trial]:
        async with ImuTrial(harness) as trial:
            trial.start()
            await asyncio.sleep(ABSENT_S)
            yield trial

    if sends(harness):
        await require_quick_end(absent, "while it waited for the device")
    await require_quick_end(lambda: connected(harness), "while the device was connected")


@IMU_SUITE.add(
    "Call nothing that waits, such as `time.sleep` or a blocking read: use asyncio's streams, or "
    "`asyncio.to_thread` and a thread of its own",
    alone=True,
)
async def does_not_block(harness: ImuHarness) -> None:
    """Does not hold up the event loop."""

    async def live() -> None:
        async with ImuTrial(harness) as trial:
            trial.start()
            await asyncio.sleep(ABSENT_S)
            await trial.device.plug()
            if sends(harness):
                await trial.hear("the device came, and no reading was delivered")
                await trial.device.unplug()
            await asyncio.sleep(ABSENT_S)

    await require_responsive(live)


@IMU_SUITE.add(
    "Close in `finally` or `async with` what `run` opens, and cancel and await its tasks",
    alone=True,
)
async def leaves_nothing(harness: ImuHarness) -> None:
    """Leaves no task, thread, file or socket when it has ended."""

    async def round_trip() -> None:
        async with connected(harness) as trial:
            if sends(harness):
                await trial.device.unplug()
                await asyncio.sleep(ABSENT_S)
                await trial.device.plug()
                await trial.hear("the device came back and no reading was delivered")

    await require_nothing_left(round_trip)
