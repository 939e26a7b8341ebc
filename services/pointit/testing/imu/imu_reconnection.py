"""Checks of an IMU source whose device comes and goes, and of its end."""

import asyncio
import statistics
import time
from typing import cast

from pointit.testing import lifecycle
from pointit.testing.check import CheckFailedError
from pointit.testing.devices.udp import UdpDevice
from pointit.testing.imu.harness import IMU_SUITE, ImuHarness, sends
from pointit.testing.trial import ABSENT_S, absent, connected

SILENCE_S = 0.4
VIRTUAL_SILENCE_S = 120.0
MOST_CPU = 0.06
"""Share of one core above which a source that gets nothing is said to spin. Waiting takes 0.02; who spins
gets what a busy machine leaves of a core."""


@IMU_SUITE.check("Catch OSError around connecting, and try again after a pause", sends)
async def waits_for_device(harness: ImuHarness) -> None:
    """Waits for a device that is not there yet."""
    async with absent(harness.trial()) as trial:
        await trial.plug()


@IMU_SUITE.check(
    "Catch OSError around opening the port, warn, and try again after a pause",
    lambda harness: sends(harness) and isinstance(harness.example(), UdpDevice),
)
async def waits_for_port(harness: ImuHarness) -> None:
    """Waits while another program has its port, warns meanwhile, and listens when it is free."""
    async with harness.trial() as trial:
        with cast("UdpDevice", trial.device).take_program_port():
            await trial.start()
            await trial.until(
                lambda: bool(trial.health.warnings), "another program had its port and no warning said so"
            )
            await asyncio.sleep(ABSENT_S)
            trial.require_running()
        await trial.plug("the port became free")


@IMU_SUITE.check("Connect in a loop: end of file and OSError lead back to connecting, after a pause", sends)
async def reconnects(harness: ImuHarness) -> None:
    """Reconnects after the device has vanished."""
    async with connected(harness.trial()) as trial:
        for _ in range(2):
            await trial.replug()


@IMU_SUITE.check(
    "Call `deliver(Reconnected())` whenever a connection is open, since a restarted device may have turned "
    "its yaw",
    lambda harness: sends(harness) and harness.example().is_connected,
)
async def tells_reconnection(harness: ImuHarness) -> None:
    """Tells that the device was connected again."""
    async with connected(harness.trial()) as trial:
        before = trial.reconnections
        await trial.replug()
        if trial.reconnections == before:
            raise CheckFailedError(
                "the device came back and no `Reconnected` was delivered before its reading"
            )


IMU_SUITE.add(lifecycle.warns, lifecycle.WARN, sends)


@IMU_SUITE.check(
    "Await the next bytes instead of asking for them in a loop, and take silence for no error", alone=True
)
async def silence(harness: ImuHarness) -> None:
    """Waits through silence, without using the processor."""
    async with connected(harness.trial()) as trial:
        if harness.virtual_time:
            await asyncio.sleep(VIRTUAL_SILENCE_S)
            trial.require_running()
            return
        shares: list[float] = []
        for _ in range(lifecycle.TRIES):
            began_s, cpu_s = time.monotonic(), time.process_time()
            await asyncio.sleep(SILENCE_S)
            shares.append((time.process_time() - cpu_s) / (time.monotonic() - began_s))
            trial.require_running()
        used = statistics.median(shares)  # a garbage collection is no polling
        if used > MOST_CPU:
            raise CheckFailedError(f"while nothing arrived it used {used:.0%} of a processor core")
        await trial.exchange("a silence ended")


IMU_SUITE.add(
    lifecycle.cancels,
    "Await only what can be cancelled, do not catch CancelledError, and join no thread for longer",
)
IMU_SUITE.add(
    lifecycle.does_not_block,
    "Call nothing that waits, such as `time.sleep` or a blocking read: use asyncio's streams, or "
    "`asyncio.to_thread` and a thread of its own",
    alone=True,
)
IMU_SUITE.add(lifecycle.leaves_nothing, lifecycle.CLOSE, alone=True)
