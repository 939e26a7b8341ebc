"""Checks of a robot driver whose robot comes and goes, and of its end."""

import asyncio

from pointit.plugins import FollowPath
from pointit.testing import lifecycle
from pointit.testing.check import CheckFailedError
from pointit.testing.devices.device import FakeDevice
from pointit.testing.robot.harness import ROBOT_SUITE, STILL_MPS, RobotHarness
from pointit.testing.trial import absent, connected


def notices_loss(harness: RobotHarness) -> bool:
    """Return True if the driver can notice that its robot has vanished."""
    return harness.device is not FakeDevice and harness.example().is_connected


@ROBOT_SUITE.check(
    "Connect in a loop, and forget in `run` what was ordered before the robot was there", notices_loss
)
async def waits_for_robot(harness: RobotHarness) -> None:
    """Waits for a robot that is not there yet, and does nothing that was ordered meanwhile."""
    async with absent(harness.trial()) as trial:
        trial.tell(FollowPath(trial.next(), (trial.place(harness.far_m),)))
        await trial.plug()
        for _ in range(10):
            await trial.exchange()
        if trial.speed_mps() > STILL_MPS:
            raise CheckFailedError("the robot came, and moved by what was ordered before")


@ROBOT_SUITE.check("Report LinkLost(reason), with what to do, as soon as the connection ends", notices_loss)
async def tells_loss(harness: RobotHarness) -> None:
    """Tells that the robot is gone, and reports again when it is back."""
    async with connected(harness.trial()) as trial:
        for _ in range(2):
            trial.losses.clear()
            await trial.device.unplug()
            await trial.until(lambda: bool(trial.losses), "the robot vanished and no LinkLost said so")
            if not trial.losses[-1].reason.strip():
                raise CheckFailedError("the reason of LinkLost is empty")
            await trial.plug("the robot came back")


@ROBOT_SUITE.check(
    "Send the robot's command to stop in `finally` of `run`, and wait until it has left",
    lambda harness: harness.is_moving is not None,
)
async def stops_at_end(harness: RobotHarness) -> None:
    """Stops the robot when it ends."""
    is_moving = harness.is_moving
    if is_moving is None:
        return
    async with connected(harness.trial()) as trial:
        await trial.rise()
        trial.tell(FollowPath(trial.next(), (trial.place(harness.far_m),)))
        await trial.moving()
        await trial.end()
        await trial.until(lambda: not is_moving(trial.device), "the driver ended and the robot went on")


@ROBOT_SUITE.check(
    "Await only what can be cancelled, do not catch CancelledError, and limit the last command"
)
async def cancels(harness: RobotHarness) -> None:
    """Ends within 1 s of being cancelled."""
    await lifecycle.cancels(harness)


@ROBOT_SUITE.check("Keep the newest command alone; a queue grows while the robot is away", alone=True)
async def command_returns_at_once(harness: RobotHarness) -> None:
    """Takes commands while the robot is away, at once, and keeps none of them waiting."""
    loop = asyncio.get_running_loop()
    async with absent(harness.trial()) as trial:
        began_s = loop.time()
        for _ in range(1000):
            trial.tell(FollowPath(trial.next(), (trial.place(1.0),)))
        if loop.time() - began_s > 1.0:
            raise CheckFailedError(f"1000 commands took {loop.time() - began_s:.1f} s")
        await trial.plug()


ROBOT_SUITE.add(
    lifecycle.does_not_block,
    "Call nothing that waits, such as `time.sleep` or a blocking write: use asyncio's streams, or a thread",
    alone=True,
)
ROBOT_SUITE.add(lifecycle.leaves_nothing, lifecycle.CLOSE, alone=True)
