"""Checks of what an IMU source delivers, and of its parameters."""

from pointit.testing.check import CheckFailedError
from pointit.testing.common import require_parameters, require_refused
from pointit.testing.imu.harness import OTHER_POSTURE, ImuHarness, ImuTrial
from pointit.testing.imu.suite import IMU_SUITE, connected, delivers_readings, sends
from pointit.testing.trial import Trial


@IMU_SUITE.add("Operators see them in `pointit list plugins` and in the help of imu-bridge")
async def parameters(harness: ImuHarness) -> None:
    """Has a summary of one line and a description for each parameter."""
    require_parameters(harness.plugin)


@IMU_SUITE.add(
    "Raise pointit.plugins.ConfigError from `check` or `make`, with one sentence: what, where, what to do",
)
async def config_errors(harness: ImuHarness) -> None:
    """Refuses parameters that cannot work, with ConfigError and nothing else."""
    plugin = harness.plugin
    around = Trial(harness.device(), harness.patience_s)

    def make(config: object) -> None:
        plugin.check(config)
        plugin.make(config, around.surroundings)

    async with around:
        require_refused(make, plugin.config, {})  # they may be refused, but only so
        for values in harness.wrong_parameters:
            if not require_refused(make, plugin.config, values):
                raise CheckFailedError(f"the parameters {dict(values)!r} were accepted")


@IMU_SUITE.add(
    "Call `deliver(Reading(stamp_ns, (x, y, z, w)))` for each reading; `encode` of the harness and the "
    "source must agree on the order of numbers",
    delivers_readings,
)
async def delivers(harness: ImuHarness) -> None:
    """Delivers the orientation that the device sends, as a unit quaternion x, y, z, w."""
    async with connected(harness) as trial:
        if sends(harness):
            await trial.hear("a second orientation was not delivered", OTHER_POSTURE)
        if trial.wrong:
            raise CheckFailedError(trial.wrong)


@IMU_SUITE.add(
    "Take `stamp_ns` from `surroundings.clock.now_ns()`; the device's own time belongs in `device_time_ns`",
    delivers_readings,
)
async def stamps(harness: ImuHarness) -> None:
    """Stamps readings with the clock of its surroundings, at capture or arrival."""
    trial = ImuTrial(harness)
    began_ns = trial.clock.now_ns()
    async with trial:
        await trial.device.plug()
        trial.start()
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


@IMU_SUITE.add("From another thread use `loop.call_soon_threadsafe(deliver, reading)`")
async def calls_in_the_loop(harness: ImuHarness) -> None:
    """Calls `deliver` and reports health in the event loop's thread."""
    async with connected(harness) as trial:
        if not trial.in_loop:
            raise CheckFailedError("`deliver` was called from another thread")
        if not trial.health.in_loop:
            raise CheckFailedError("health was reported from another thread")
