"""The checks of services."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.plugins import Config, ConfigError
from pointit.schemas.topics import CLOCK, HEALTH
from pointit.testing.check import CheckFailedError, Suite
from pointit.testing.common import (
    require_nothing_left,
    require_parameters,
    require_refused,
    require_responsive,
)
from pointit.testing.service.harness import ServiceHarness, ServiceTrial
from pointit.testing.trial import Trial, require_quick_end

LIVES_S = 0.3
MESSAGES = 50
HEALTH_S = 1.1
"""Time in which a service reports its health once, s."""
SYSTEM = {CLOCK.key, HEALTH.key}
"""Topics that every service uses."""

SERVICE_SUITE: Suite[ServiceHarness] = Suite()


@asynccontextmanager
async def started(harness: ServiceHarness) -> AsyncGenerator[ServiceTrial]:
    """Yield a trial whose service is ready, and whose device is plugged in."""
    async with ServiceTrial(harness) as trial:
        await trial.device.plug()
        yield await trial.start()


async def _live(trial: ServiceTrial, harness: ServiceHarness) -> None:
    """Let the service do all that can be done with it from outside."""
    trial.put_messages()
    for request in harness.plugin.serves:
        await trial.ask(request)
    await asyncio.sleep(LIVES_S)


@SERVICE_SUITE.add(
    "NAME, and `writers` or `server` of its own rows, are the entry point's name; no key is another row's",
)
async def parameters(harness: ServiceHarness) -> None:
    """Has a summary of one line, a description for each parameter, and rows that it may use."""
    require_parameters(harness.plugin)
    try:
        harness.plugin.check(harness.plugin.make.NAME)
    except ConfigError as error:
        raise CheckFailedError(str(error)) from error


@SERVICE_SUITE.add(
    "Raise pointit.plugins.ConfigError from `validate_config`, with one sentence: what, where, what to do",
)
async def config_errors(harness: ServiceHarness) -> None:
    """Refuses parameters that cannot work, with ConfigError and nothing else."""

    def make(config: Config) -> None:
        harness.plugin.make.validate_config(config)

    require_refused(make, harness.plugin.config, {})
    for values in harness.wrong_parameters:
        if not require_refused(make, harness.plugin.config, values):
            raise CheckFailedError(f"the parameters {dict(values)!r} were accepted")


@SERVICE_SUITE.add(
    "Declare everything in the constructor, and wait in `run`: do not return, and catch what a device raises",
)
async def starts(harness: ServiceHarness) -> None:
    """Starts, also while its device is away, and runs until it is cancelled."""
    async with ServiceTrial(harness) as trial:
        await trial.start()
        await asyncio.sleep(LIVES_S)
        trial.require_running()


@SERVICE_SUITE.add(
    "Call `self.bus.serve` for each in the constructor; raise RefusedError with a sentence if it must refuse",
    lambda harness: bool(harness.plugin.serves),
)
async def answers(harness: ServiceHarness) -> None:
    """Answers the requests that it serves."""
    async with started(harness) as trial:
        for request in harness.plugin.serves:
            await trial.ask(request)


@SERVICE_SUITE.add(
    "Handle every message that its type allows; what a handler raises is counted in health, and logged",
    lambda harness: bool(harness.plugin.reads),
)
async def hears(harness: ServiceHarness) -> None:
    """Takes the messages that it reads, also many of them."""
    async with started(harness) as trial:
        for _ in range(MESSAGES):
            trial.put_messages()
            await asyncio.sleep(0)
        await asyncio.sleep(HEALTH_S)
        trial.require_running()
        if trial.errors:
            raise CheckFailedError(f"{trial.errors} of its handlers or timers raised")


@SERVICE_SUITE.add(
    "Name each in `reads`, `writes`, `serves` or `asks` of the plug-in: a secured site allows only these",
)
async def uses_declared_rows(harness: ServiceHarness) -> None:
    """Uses only topics and requests that it declares."""
    async with started(harness) as trial:
        await _live(trial, harness)
        if harness.works is not None:
            await harness.works(trial)
        for what, keys in trial.own_bus.used.items():
            declared = {row.key for row in getattr(harness.plugin, what)}
            extra = sorted(keys - declared - SYSTEM)
            if extra:
                raise CheckFailedError(f"`{what}` does not name {', '.join(extra)}, which it uses")


@SERVICE_SUITE.add("See the test `works` in the harness", lambda harness: harness.works is not None)
async def works(harness: ServiceHarness) -> None:
    """Does what its author's own test says."""
    async with started(harness) as trial:
        if harness.works is not None:
            await harness.works(trial)


@SERVICE_SUITE.add(
    "Await only what can be cancelled, do not catch CancelledError, and join no thread for longer",
)
async def cancels(harness: ServiceHarness) -> None:
    """Ends within 1 s of being cancelled."""

    @asynccontextmanager
    async def absent() -> AsyncGenerator[Trial]:
        async with ServiceTrial(harness) as trial:
            yield await trial.start()

    @asynccontextmanager
    async def busy() -> AsyncGenerator[Trial]:
        async with started(harness) as trial:
            await _live(trial, harness)
            yield trial

    await require_quick_end(absent, "after its start")
    await require_quick_end(busy, "after messages and requests")


@SERVICE_SUITE.add(
    "Call nothing that waits, such as `time.sleep` or a blocking read: use asyncio, or `asyncio.to_thread`",
    alone=True,
)
async def does_not_block(harness: ServiceHarness) -> None:
    """Does not hold up the event loop."""

    async def live() -> None:
        async with started(harness) as trial:
            await _live(trial, harness)

    await require_responsive(live)


@SERVICE_SUITE.add(
    "Close in `finally` or `async with` what `run` opens, and cancel and await its tasks",
    alone=True,
)
async def leaves_nothing(harness: ServiceHarness) -> None:
    """Leaves no task, thread, file or socket when it has ended."""

    async def round_trip() -> None:
        async with started(harness) as trial:
            await _live(trial, harness)

    await require_nothing_left(round_trip)
