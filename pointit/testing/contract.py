"""Contracts of plug-ins: classes whose tests a plug-in's own test class inherits, and what they measure."""

import asyncio
import functools
import gc
import logging
import threading
import time
import traceback
import tracemalloc
from collections.abc import Awaitable, Callable, Coroutine, Generator, Iterator, Mapping
from contextlib import contextmanager
from logging.handlers import MemoryHandler
from pathlib import Path
from typing import Any, TypeVar
from unittest import SkipTest

from pydantic import ValidationError

from pointit.plugins import Config, ConfigError
from pointit.runtime.virtual_time import VirtualTimeLoop

C = TypeVar("C", bound="Contract")

TIMEOUT_FACTORS = 6.0
"""A test that has not come to an end within this many times the contract's timeout hangs."""
STUBBORN_S = 1.0
"""Time for the tasks of a failed test to end, s."""
MAX_MEMORY_BYTES = 400_000
"""Maximum growth of memory, bytes. A plug-in that exceeds it stores data that it should discard."""
MAX_BLOCKED_S = 0.25
"""Maximum time for which a plug-in may hold up the event loop, s."""
SETTLED_S = 1.0
"""Time for threads and files to vanish after a plug-in has ended, s."""
CANCEL_S = 1.0
"""Time within which a plug-in must have ended after it was cancelled, s."""
TRIES = 3
"""A time is only too long if it is so in each of this many tries: a busy machine makes any of them slow."""
MAX_SUMMARY = 100
FILES = Path("/proc/self/fd")
CLOSE = "Close in `finally` or `async with` what the plug-in opens, and cancel and await its tasks"


class CheckFailedError(AssertionError):
    """A plug-in breaks a promise. The message has the observation and the remedy."""


class Contract:
    """Tests of the promises of one kind of plug-in. A class that inherits it says which plug-in."""

    plugin: Any
    """Plug-in that is tested."""
    wrong_parameters: tuple[Mapping[str, object], ...] = ()
    """Parameters that the plug-in must refuse."""
    virtual_time: bool = False
    """True if plug-in and device wait for timers of the event loop alone: tests then take no time."""
    timeout_s: float = 10.0
    """Time that the plug-in may take to start, to connect, to notice a loss, and to warn, s."""


def require_plugin(contract: type[Contract]) -> None:
    """Raise ConfigError unless `contract` names a plug-in."""
    if not hasattr(contract, "plugin"):
        raise ConfigError(f"{contract.__name__} names no plug-in: add a line such as `plugin = SOURCE`")


def require(condition: object, problem: str, remedy: str = "") -> None:
    """Raise CheckFailedError with `problem`, a clause, and `remedy`, a sentence, unless `condition` holds."""
    if not condition:
        raise CheckFailedError(f"{problem}. {remedy}" if remedy else problem)


@contextmanager
def called(function: str) -> Generator[None]:
    """Raise CheckFailedError if `function` of the plug-in, which is called in the block, raises anything."""
    try:
        yield
    except Exception as error:
        problem = f"{type(error).__name__}: {error}"
        raise CheckFailedError(f"`{function}` raised {problem}") from error


def promise(
    applies: Callable[[Any], bool] = lambda _contract: True, *, real_time: bool = False
) -> Callable[[Callable[[C], Coroutine[Any, Any, None]]], Callable[[C], None]]:
    """Return a decorator that makes a test of an asynchronous method, whose docstring is the promise.

    Args:
        applies: returns False for a contract with which it cannot be found out. The test is skipped then.
        real_time: True if it measures the operating system's time, also where the contract has virtual time.
    """

    def decorated(method: Callable[[C], Coroutine[Any, Any, None]]) -> Callable[[C], None]:
        @functools.wraps(method)
        def test(self: C) -> None:
            require_plugin(type(self))
            if not applies(self):
                raise SkipTest("the device of the contract cannot show it")
            has_virtual_time = self.virtual_time and not real_time
            loop = VirtualTimeLoop() if has_virtual_time else asyncio.new_event_loop()
            _run(loop, method(self), TIMEOUT_FACTORS * self.timeout_s)

        return test

    return decorated


def _run(loop: asyncio.AbstractEventLoop, test: Coroutine[Any, Any, None], limit_s: float) -> None:
    """Run `test` in `loop`, which does not wait for tasks that cannot be cancelled."""
    raised: list[BaseException] = []

    def on_error(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        # of protocols, timers and readers: asyncio logs it, and nobody awaits them
        error = context.get("exception")
        if error is None or "future" in context:
            loop.default_exception_handler(context)
        elif not isinstance(error, asyncio.CancelledError):  # of a stream that the end of the test cancels
            raised.append(error)

    async def limited() -> None:
        try:
            async with asyncio.timeout(limit_s):
                await test
        except TimeoutError as error:
            raise CheckFailedError(f"did not come to an end within {limit_s:g} s") from error
        finally:
            remaining = asyncio.all_tasks() - {asyncio.current_task()}
            for task in remaining:
                task.cancel()
            if remaining:
                await asyncio.wait(remaining, timeout=STUBBORN_S)

    loop.set_exception_handler(on_error)
    try:
        loop.run_until_complete(limited())
        loop.run_until_complete(loop.shutdown_asyncgens())
    finally:
        loop.close()
    for error in raised:
        line = traceback.extract_tb(error.__traceback__)[-1]
        position = f"{line.filename}, line {line.lineno}, in {line.name}"
        problem = f"{type(error).__name__}: {error}"
        raise CheckFailedError(f"a callback raised {problem}, in {position}") from error


def require_parameters(contract: Contract, make: Callable[[Any], object]) -> None:
    """Require a description of the plug-in and of its parameters, and that `make` refuses wrong ones."""
    plugin = contract.plugin
    summary = plugin.summary
    fields = plugin.config.model_fields
    is_line = bool(summary.strip()) and "\n" not in summary
    require(
        is_line and len(summary) <= MAX_SUMMARY,
        f"the summary is no line of 1 to {MAX_SUMMARY} characters: {summary!r}",
        "Operators see it in `pointit plugin list`",
    )
    has_parameter = not plugin.argument or plugin.argument in fields
    names = [*fields]
    require(has_parameter, f"the argument {plugin.argument!r} is no parameter; there are {names}")
    lacking = ", ".join(_undescribed(plugin.config))
    require(not lacking, f"parameters without a description: {lacking}", "Operators see it in the help")
    # A plug-in may refuse parameters when it is made, but only as a mistake of the configuration
    for values in ({}, *contract.wrong_parameters):
        try:
            make(plugin.config.model_validate(dict(values)))
        except (ConfigError, ValidationError):
            continue
        except Exception as error:
            kind = type(error).__name__
            sentence = f"the parameters {dict(values)!r} raised {kind} instead of ConfigError"
            remedy = "Raise it where the plug-in is made, with one sentence; connect in `run`"
            raise CheckFailedError(f"{sentence}: {error}. {remedy}") from error
        require(
            not values,  # the defaults may be accepted or not
            f"the parameters {dict(values)!r} were accepted",
            "Limit them by `Field(gt=…, le=…)`, or raise pointit.plugins.ConfigError",
        )


def _undescribed(kind: type[Config], prefix: str = "") -> Iterator[str]:
    for name, field in kind.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, Config):
            yield from _undescribed(inner, f"{prefix}{name}.")
        elif not field.description:
            yield f"{prefix}{name}"


async def require_bounded_memory(act: Callable[[], Awaitable[None]], action: str, remedy: str) -> None:
    """Require that Python holds no more memory after `act`, in words `action`, than before."""
    gc.collect()
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        await act()
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    growth = after - before
    growth_mb = growth / 1e6
    require(growth <= MAX_MEMORY_BYTES, f"after {action} it held {growth_mb:.1f} MB more", remedy)


async def require_nothing_left(act: Callable[[], Awaitable[None]]) -> None:
    """Require that a second `act` leaves no more threads, tasks and files than the first."""
    await act()
    gc.collect()
    gc.disable()  # an object that only the collector closes is one that nobody closed
    try:
        names_before, files_before = _present()
        await act()
        end_s = time.monotonic() + SETTLED_S
        names, files = _present()
        # threads and sockets may end a moment later
        while names - names_before or files > files_before:
            if time.monotonic() >= end_s:
                break
            await asyncio.sleep(0.01)
            names, files = _present()
    finally:
        gc.enable()
    remaining = sorted(names - names_before)
    if files > files_before:
        remaining.append(f"{files - files_before} open files or sockets")
    listed = ", ".join(remaining)
    require(not remaining, f"these were left when it had ended: {listed}", CLOSE)


def _present() -> tuple[set[str], int]:
    """Return the threads and tasks, without those of the loop, and the number of files that are open."""
    names = set[str]()
    for thread in threading.enumerate():
        if not thread.name.startswith("asyncio_"):
            names.add(f"thread {thread.name!r}")
    for task in asyncio.all_tasks() - {asyncio.current_task()}:
        names.add(f"task {task.get_coro()}")
    file_count = len(list(FILES.iterdir())) if FILES.is_dir() else 0
    return names, file_count


async def require_responsive(act: Callable[[], Awaitable[None]]) -> None:
    """Require that `act` does not hold up the event loop. The error has asyncio's name of the callback."""
    loop = asyncio.get_running_loop()
    logger = logging.getLogger("asyncio")
    loop.slow_callback_duration = MAX_BLOCKED_S
    slow: list[str] = []
    for _ in range(TRIES):
        records = MemoryHandler(capacity=1_000_000)
        logger.addHandler(records)
        loop.set_debug(True)
        try:
            await asyncio.sleep(0)  # of this step, and of the one that ends it, asyncio takes no time
            await act()
            await asyncio.sleep(0)
        finally:
            loop.set_debug(False)
            logger.removeHandler(records)

        # One quick try is enough: a busy machine may slow down the others
        messages = [record.getMessage() for record in records.buffer if record.msg.startswith("Executing ")]
        slow = messages
        if not slow:
            return
    require(
        not slow,
        f"the event loop stood still: {slow[0]}",
        "Call nothing that waits, such as `time.sleep`: use asyncio's streams, or `asyncio.to_thread`",
    )
