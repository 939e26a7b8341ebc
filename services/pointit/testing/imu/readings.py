"""Checks of what an IMU source delivers, and of its parameters."""

from pointit.testing import lifecycle
from pointit.testing.check import CheckFailedError
from pointit.testing.common import require_parameters
from pointit.testing.imu.harness import IMU_SUITE, OTHER_POSTURE, ImuHarness, sends
from pointit.testing.trial import connected


@IMU_SUITE.check("Operators see them in `pointit list plugins` and in the help of imu-bridge")
async def parameters(harness: ImuHarness) -> None:
    """Has a summary of one line and a description for each parameter."""
    require_parameters(harness.plugin)


IMU_SUITE.add(
    lifecycle.config_errors,
    "Raise pointit.plugins.ConfigError from `check` or `make`, with one sentence: what, where, what to do",
)


@IMU_SUITE.check(
    "Call `deliver(Reading(stamp_ns, (x, y, z, w)))` for each reading; `encode` of the harness and the "
    "source must agree on the order of numbers",
    lambda harness: harness.delivers,
)
async def delivers(harness: ImuHarness) -> None:
    """Delivers the orientation that the device sends, as a unit quaternion x, y, z, w."""
    async with connected(harness.trial()) as trial:
        if sends(harness):
            await trial.hear("a second orientation was not delivered", OTHER_POSTURE)
        if trial.wrong:
            raise CheckFailedError(trial.wrong)


@IMU_SUITE.check(
    "Take `stamp_ns` from `surroundings.clock.now_ns()`; the device's own time belongs in `device_time_ns`",
    lambda harness: harness.delivers,
)
async def stamps(harness: ImuHarness) -> None:
    """Stamps readings with the clock of its surroundings, at capture or arrival."""
    async with harness.trial() as trial:
        began_ns = trial.clock.now_ns()
        await trial.device.plug()
        await trial.start()
        await trial.until(lambda: trial.count > 4, "fewer than five readings were delivered", trial.send)
        now_ns = trial.clock.now_ns()
        last_ns = began_ns
        for each in trial.readings:
            if not began_ns <= each.stamp_ns <= now_ns:
                raise CheckFailedError(
                    f"a reading has the stamp {each.stamp_ns!r}; it arrived between {began_ns} and {now_ns}"
                )
            if each.stamp_ns < last_ns:
                raise CheckFailedError(f"a stamp went back by {(last_ns - each.stamp_ns) / 1e6:.3f} ms")
            last_ns = each.stamp_ns


@IMU_SUITE.check("From another thread use `loop.call_soon_threadsafe(deliver, reading)`")
async def calls_in_the_loop(harness: ImuHarness) -> None:
    """Calls `deliver` and reports health in the event loop's thread."""
    async with connected(harness.trial()) as trial:
        trial.health.require_in_loop()
