"""The checks of services."""

import asyncio

from pointit.plugins import ConfigError
from pointit.schemas.topics import ACCOUNTS, CLOCK
from pointit.testing import requirements
from pointit.testing.check import CheckFailedError
from pointit.testing.service.harness import SERVICE_SUITE, ServiceHarness
from pointit.testing.trial import absent, connected

MESSAGES = 50
HEALTH_S = 1.1
"""Time in which a service reports its health once, s."""
SYSTEM = {CLOCK.key, *(topic.key for topic in ACCOUNTS)}
"""Topics that every service uses."""


@SERVICE_SUITE.check(
    "NAME, and `writers` or `server` of its own rows, are the entry point's name; no key is another row's"
)
async def parameters(harness: ServiceHarness) -> None:
    """Has a summary of one line, a description for each parameter, and rows that it may use."""
    requirements.require_parameters(harness.plugin)
    try:
        harness.plugin.check(harness.plugin.make.NAME)
    except ConfigError as error:
        raise CheckFailedError(str(error)) from error


SERVICE_SUITE.add(
    requirements.config_errors,
    "Raise pointit.plugins.ConfigError from `validate_config`, with one sentence: what, where, what to do",
)


@SERVICE_SUITE.check(
    "Declare everything in the constructor, and wait in `run`: do not return, and catch what a device raises"
)
async def starts(harness: ServiceHarness) -> None:
    """Starts, also while its device is away, and runs until it is cancelled."""
    async with absent(harness.trial()):
        pass


@SERVICE_SUITE.check(
    "Call `self.bus.serve` for each in the constructor; raise RefusedError with a sentence if it must refuse",
    lambda harness: bool(harness.plugin.serves),
)
async def answers(harness: ServiceHarness) -> None:
    """Answers the requests that it serves."""
    async with connected(harness.trial()) as trial:
        for request in harness.plugin.serves:
            await trial.ask(request)


@SERVICE_SUITE.check(
    "Handle every message that its type allows; what a handler raises is counted in health, and logged",
    lambda harness: bool(harness.plugin.reads),
)
async def hears(harness: ServiceHarness) -> None:
    """Takes the messages that it reads, also many of them."""
    async with connected(harness.trial()) as trial:
        for _ in range(MESSAGES):
            trial.put_messages()
            await asyncio.sleep(0)
        await asyncio.sleep(HEALTH_S)
        trial.require_running()
        if trial.errors:
            raise CheckFailedError(f"{trial.errors} of its handlers or timers raised")


@SERVICE_SUITE.check(
    "Name each in `reads`, `writes`, `serves` or `asks` of the plug-in: a secured site allows only these"
)
async def uses_declared_rows(harness: ServiceHarness) -> None:
    """Uses only topics and requests that it declares."""
    async with connected(harness.trial()) as trial:
        await trial.live()
        if harness.works is not None:
            await harness.works(trial)
        for what, keys in trial.own_bus.used.items():
            declared = {row.key for row in getattr(harness.plugin, what)}
            extra = sorted(keys - declared - SYSTEM)
            if extra:
                raise CheckFailedError(f"`{what}` does not name {', '.join(extra)}, which it uses")


@SERVICE_SUITE.check("See the test `works` in the harness", lambda harness: harness.works is not None)
async def works(harness: ServiceHarness) -> None:
    """Passes its author's own test."""
    async with connected(harness.trial()) as trial:
        if harness.works is not None:
            await harness.works(trial)


SERVICE_SUITE.add(
    requirements.cancels,
    "Await only what can be cancelled, do not catch CancelledError, and join no thread for longer",
)
SERVICE_SUITE.add(
    requirements.does_not_block,
    "Call nothing that waits, such as `time.sleep` or a blocking read: use asyncio, or `asyncio.to_thread`",
    alone=True,
)
SERVICE_SUITE.add(requirements.leaves_nothing, requirements.CLOSE, alone=True)
