"""Parts of checks that all kinds of plug-ins share: parameters, memory, leaks, start to end of `run`."""

import asyncio
import contextlib
import gc
import threading
import time
import tracemalloc
from collections.abc import Awaitable, Callable, Generator
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pointit.plugins import Config, ConfigError, Plugin
from pointit.testing.trial import (
    CANCEL_S,
    CheckFailedError,
    DeviceHarness,
    Harness,
    Trial,
    absent,
    current_watch,
    go_through,
    lived,
)

MEMORY_BYTES = 400_000
"""Maximum growth of memory, bytes. A plug-in that exceeds it stores data that it should discard."""
BLOCKED_S = 0.25
"""Time for which a plug-in may hold the event loop up at most, s."""
SETTLED_S = 1.0
"""Time for threads and files to vanish after `run` has ended, s."""
FILES = Path("/proc/self/fd")
LONGEST_SUMMARY = 100


def require_parameters(plugin: Plugin) -> None:
    """Raise CheckFailedError unless the summary is one line and every parameter is described."""
    summary = plugin.summary
    if not summary.strip() or "\n" in summary or len(summary) > LONGEST_SUMMARY:
        raise CheckFailedError(f"the summary is no line of 1 to {LONGEST_SUMMARY} characters: {summary!r}")
    fields = plugin.config.model_fields
    if plugin.argument and plugin.argument not in fields:
        raise CheckFailedError(f"the argument {plugin.argument!r} is no parameter; there are {[*fields]}")
    lacking = _undescribed(plugin.config)
    if lacking:
        raise CheckFailedError(f"parameters without a description: {', '.join(lacking)}")


def _undescribed(kind: type[Config], prefix: str = "") -> list[str]:
    lacking: list[str] = []
    for name, field in kind.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, Config):
            lacking += _undescribed(inner, f"{prefix}{name}.")
        elif not field.description:
            lacking.append(f"{prefix}{name}")
    return lacking


def require_refusals(harness: Harness[Any], make: Callable[[Any], object]) -> None:
    """Raise CheckFailedError unless `make` refuses wrong parameters, by ConfigError or ValidationError."""
    for number, values in enumerate(({}, *harness.wrong_parameters)):
        try:
            make(harness.plugin.config.model_validate(dict(values)))
        except (ConfigError, ValidationError):
            continue
        except Exception as error:
            name = type(error).__name__
            raise CheckFailedError(
                f"the parameters {dict(values)!r} raised {name} instead of ConfigError: {error}"
            ) from error
        if number > 0:  # the defaults may be accepted or not
            raise CheckFailedError(f"the parameters {dict(values)!r} were accepted")


async def require_bounded_memory(act: Callable[[], Awaitable[None]], action: str) -> None:
    """Raise CheckFailedError if Python holds more memory after `act`, in words `action`, than before."""
    gc.collect()
    with _traced_memory():
        before, _ = tracemalloc.get_traced_memory()
        await act()
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    if after - before > MEMORY_BYTES:
        raise CheckFailedError(f"after {action} it held {(after - before) / 1e6:.1f} MB more")


_tracing_lock = threading.Lock()
_tracing = 0
"""Number of checks that trace memory: one that was given up may end during the next."""


@contextlib.contextmanager
def _traced_memory() -> Generator[None]:
    """Trace what Python holds, until the last one that traces ends."""
    global _tracing  # noqa: PLW0603 - tracemalloc is one for the process
    with _tracing_lock:
        _tracing += 1
        tracemalloc.start()
    try:
        yield
    finally:
        with _tracing_lock:
            _tracing -= 1
            if not _tracing:
                tracemalloc.stop()


def _present() -> tuple[set[str], int]:
    """Return the threads, tasks and number of files that are open."""
    names = {
        f"thread {each.name!r}"
        for each in threading.enumerate()
        if not each.name.startswith("asyncio_")  # the loop's own
    }
    names |= {f"task {each.get_coro()}" for each in asyncio.all_tasks() if each is not asyncio.current_task()}
    return names, len(list(FILES.iterdir())) if FILES.is_dir() else 0


async def require_nothing_left(round_trip: Callable[[], Awaitable[None]]) -> None:
    """Raise CheckFailedError if a second `round_trip` leaves more threads, tasks or files than the first."""
    await round_trip()
    gc.collect()
    gc.disable()  # an object that only the collector closes is one that nobody closed
    try:
        before, files_before = _present()
        await round_trip()
        end_s = time.monotonic() + SETTLED_S
        while True:
            names, files = _present()
            if not names - before and files <= files_before:
                return
            if time.monotonic() > end_s:
                break
            await asyncio.sleep(0.01)
    finally:
        gc.enable()
    left = sorted(names - before)
    if files > files_before:
        left.append(f"{files - files_before} open file{'s' if files - files_before > 1 else ''} or sockets")
    raise CheckFailedError(f"these were left when `run` had ended: {', '.join(left)}")


async def require_responsive(act: Callable[[], Awaitable[None]]) -> None:
    """Raise CheckFailedError, which names the place in the code, if `act` holds the event loop up."""
    watch = current_watch.get()
    watch.start()
    await act()
    watch.stop()
    if watch.longest_s > BLOCKED_S:
        raise CheckFailedError(f"the event loop stood still for {watch.longest_s:.1f} s in {watch.where}")


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
