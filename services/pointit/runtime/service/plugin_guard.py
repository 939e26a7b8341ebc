"""Guard of a plug-in: its faults are named in health and cost the rest of its service nothing."""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar, cast

from pointit.runtime.config.plugins import PluginGroup
from pointit.runtime.errors import ConfigError, PointItError
from pointit.runtime.service.stall_watch import watch_for_stalls
from pointit.runtime.service.surroundings import WarningSink

T = TypeVar("T")

log = logging.getLogger(__name__)

FIRST_WAIT_S = 1.0
"""Wait after the first failure, s. It doubles with each further one."""
MAX_WAIT_S = 30.0
"""Longest wait, s. After running for as long without a failure, a plug-in counts as sound again."""
END_PATIENCE_S = 1.0
"""Time in which a plug-in must end when it is cancelled, s."""
LOG_PERIOD_S = 30.0
"""At most one log record about a call that raises in this time, s; it may be made for each frame."""

abandoned: set[asyncio.Task[None]] = set()
"""Plug-ins that did not end when they were cancelled. They end with the process."""


def guard_of(plugins: PluginGroup[Any], name: str, health: WarningSink, which: str = "") -> "PluginGuard":
    """Return the guard of the plug-in `name`, which is also watched for blocking the event loop.

    `which` distinguishes it in warnings from others of that name.
    """
    label = plugins.label(name)
    watch_for_stalls(plugins.module(name), label, health)
    return PluginGuard(f"{label} ({which})" if which else label, health)


class PluginGuard:
    """Runs a plug-in: restarts it with back-off when it fails or ends, and abandons it if it does not end."""

    def __init__(self, label: str, health: WarningSink) -> None:
        """Guard the plug-in called `label` in warnings, such as `IMU source 'waving' of my-package`."""
        self.label = label
        self._health = health
        self._failures = 0
        self._logged_s: dict[str, float] = {}
        self.problem = ""
        """Problem of its last run, or `""`."""

    async def keep_running(self, run: Callable[[], Awaitable[None]]) -> None:
        """Run `run` again and again until cancelled. It should end only then."""
        while True:
            error: Exception | None = None
            try:
                await self.run(run)
            except Exception as raised:  # noqa: BLE001 - code of others, which may raise anything
                error = raised
            await asyncio.sleep(self.failed(error))

    async def run(self, run: Callable[[], Awaitable[None]]) -> None:
        """Run `run` once. After some time without a failure, earlier ones are forgotten."""
        task = asyncio.create_task(_contained(run), name=self.label)
        settled = asyncio.get_running_loop().call_later(MAX_WAIT_S, self.clear) if self._failures else None
        try:
            await asyncio.wait({task})
        except asyncio.CancelledError:
            await self._cancel(task)
            raise
        finally:
            if settled is not None:
                settled.cancel()
        if not task.cancelled():  # by itself
            task.result()

    async def _cancel(self, task: asyncio.Task[None]) -> None:
        task.cancel()
        if (await asyncio.wait({task}, timeout=END_PATIENCE_S))[1]:
            abandoned.add(task)
            task.add_done_callback(abandoned.discard)
            asyncio._unregister_task(task)  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - the loop's end would wait
            log.error("%s does not end when it is cancelled, and is abandoned", self.label)
        elif not task.cancelled() and (error := task.exception()) is not None:
            log.error("%s failed at its end: %s", self.label, describe(error))

    def made(self, make: Callable[[], T]) -> T:
        """Return the result of `make` of the plug-in.

        Raises:
            ConfigError: If it raises anything else.
        """
        try:
            return make()
        except PointItError:
            raise
        except Exception as error:  # code of others, which may raise anything
            raise ConfigError(
                f"{self.label} cannot be started ({describe(error)}); update or uninstall it"
            ) from error

    def call(self, what: str, function: Callable[[], T]) -> T | None:
        """Return the result of `function`, called `what`, or None if it raises, which is reported."""
        topic = f"{self.label}: {what}"
        try:
            result = function()
        except Exception as error:  # code of others, which may raise anything
            sentence = f"{topic} failed ({describe(error)}): update or remove it"
            self._health.warn(topic, sentence)
            now_s, before_s = time.monotonic(), self._logged_s.get(topic)
            if before_s is None or now_s - before_s >= LOG_PERIOD_S:
                self._logged_s[topic] = now_s
                log.exception("%s", sentence, exc_info=error if before_s is None else None)
            return None
        self._health.clear(topic)
        return result

    def failed(self, error: BaseException | None) -> float:
        """Report that it ended, by `error` if that is not None. Return the time until its restart, s."""
        wait_s = min(FIRST_WAIT_S * 2.0 ** min(self._failures, 10), MAX_WAIT_S)
        self._failures += 1
        how = "ended by itself" if error is None else f"failed ({describe(error)})"
        times = f", {self._failures} times now" if self._failures > 1 else ""
        self.problem = f"{self.label} {how}{times}; it is started again after {wait_s:g} s"
        self._health.warn(self.label, self.problem)
        log.error("%s", self.problem, exc_info=error if self._failures == 1 else None)
        return wait_s

    def clear(self) -> None:
        """Take the warning back: it runs well again."""
        self._failures, self.problem = 0, ""
        self._health.clear(self.label)


def describe(error: BaseException) -> str:
    """Return the class and the message of `error`, in one line."""
    return f"{type(error).__name__}: {error}".partition("\n")[0][:200].rstrip(": ")


def first_cause(error: Exception, kind: type[Exception] = Exception) -> Exception | None:
    """Return the first error of a `kind` that is `error` or in it, if it is a group, or None."""
    if isinstance(error, ExceptionGroup):
        inner = cast("ExceptionGroup[Exception]", error).exceptions
        return next((found for each in inner if (found := first_cause(each, kind)) is not None), None)
    return error if isinstance(error, kind) else None


async def _contained(run: Callable[[], Awaitable[None]]) -> None:
    try:
        await run()
    except SystemExit as error:  # would end the whole process
        raise RuntimeError("it called sys.exit") from error
