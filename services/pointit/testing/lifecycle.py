"""Checks that several kinds of plug-ins share: of parameters, and from the start to the end of `run`."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import Any

from pointit.testing.check import CheckFailedError
from pointit.testing.common import require_nothing_left, require_refusals, require_responsive
from pointit.testing.trial import CANCEL_S, DeviceHarness, Trial, absent, go_through, lived

TRIES = 3
"""A time is only too long if it is so in each of this many tries: a busy machine makes any of them slow."""
WARN = "Call `surroundings.health.warn(topic, sentence)`, which says what to do, and later `clear(topic)`"
CLOSE = "Close in `finally` or `async with` what `run` opens, and cancel and await its tasks"


async def config_errors(harness: DeviceHarness[Any]) -> None:
    """Refuses parameters that cannot work, with ConfigError and nothing else."""
    async with harness.trial() as trial:
        require_refusals(harness, trial.make)


async def warns(harness: DeviceHarness[Any]) -> None:
    """Warns while the device is away, and no longer when it is back."""
    async with harness.trial() as trial:
        await trial.start()
        await trial.until(lambda: bool(trial.health.warnings), "the device was away and no warning said so")
        await trial.plug()
        await trial.until(
            lambda: not trial.health.warnings, "the device was back and a warning stayed", trial.exchange
        )
        trial.health.require_in_loop()


async def cancels(harness: DeviceHarness[Any]) -> None:
    """Ends within 1 s of being cancelled."""
    await require_quick_end(lambda: absent(harness.trial()), "while it waited for the device")
    await require_quick_end(lambda: lived(harness.trial()), "while the device was connected")


async def does_not_block(harness: DeviceHarness[Any]) -> None:
    """Does not hold up the event loop."""

    async def live() -> None:
        async with absent(harness.trial()) as trial:
            await trial.plug()
            await go_through(trial)

    await require_responsive(live)


async def leaves_nothing(harness: DeviceHarness[Any]) -> None:
    """Leaves no task, thread, file or socket when it has ended."""

    async def round_trip() -> None:
        async with lived(harness.trial()):
            pass

    await require_nothing_left(round_trip)


async def require_quick_end(begin: Callable[[], AbstractAsyncContextManager[Trial]], state: str) -> None:
    """Raise CheckFailedError unless a plug-in ends in time from `state`, in which `begin` enters a trial."""
    took_s: list[float] = []
    for _ in range(TRIES):
        async with begin() as trial:
            took_s.append(await trial.end())
        if took_s[-1] < CANCEL_S:
            return
    raise CheckFailedError(f"{state}, it ended {min(took_s):.1f} s after it was cancelled")
