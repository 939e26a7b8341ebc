"""Plug-ins in a service: their surroundings, and a guard by which the rest continues."""

import asyncio
import contextlib
import logging
import sys
import threading
import time
import weakref
from collections.abc import Awaitable, Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self, TypeVar

from pydantic import BaseModel

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.runtime.clock import Clock, WallClock
from pointit.runtime.config.plugins import PluginGroup
from pointit.runtime.errors import ConfigError, PointItError, describe
from pointit.runtime.host.state_file import StateFile, state_directory
from pointit.runtime.virtual_time import is_virtual
from pointit.schemas.problems import EVENT_LOOP

if TYPE_CHECKING:
    from pointit.runtime.bus.service_bus import ServiceBus  # cores use this module, and know no bus

log = logging.getLogger(__name__)

T = TypeVar("T", bound=BaseModel)

ResultT = TypeVar("ResultT")

FIRST_WAIT_S = 1.0
"""Delay before the restart after the first failure, s. It doubles after each further one."""
MAX_WAIT_S = 30.0
"""Maximum delay, s. After this time without a failure, earlier failures of a plug-in are forgotten."""
END_TIMEOUT_S = 1.0
"""Timeout for the end of a cancelled plug-in, s."""
LOG_PERIOD_S = 30.0
"""Minimum interval of log records about a failing call, s. It may be called for each frame."""
abandoned: set[asyncio.Task[None]] = set()
"""Tasks of plug-ins that did not end when cancelled. They end with the process."""

STALL_PERIOD_S = 0.25
"""Period of checks, s."""
STALL_S = 0.5
"""Time for which a plug-in may block the loop, s."""
OWN_STALL_S = 3.0
"""The same for our own services, s: doctor calls them silent by then."""
MODULE_BODY = "<module>"
"""Name of the code of a module while it is loaded."""
SHOWN_S = 30.0
"""Time for which health reports it, s."""
_watches: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, "StallWatch"] = weakref.WeakKeyDictionary()


class WarningSink(Protocol):
    """Shows and clears warnings of a part of a service, such as `ServiceBus`."""

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Show `sentence` (problem and remedy) until `clear(code, subject)`. `""` also clears it."""
        ...

    def clear(self, code: str, subject: str = "") -> None:
        """Clear the warning."""
        ...


class HealthSink(WarningSink, Protocol):
    """Receiver of a plug-in's warnings and metrics."""

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Show a metric, as in `("battery", 82.0, "%")`. None removes it."""
        ...

    def reached(self, latency_s: float) -> None:
        """Record the age of captured data when its effect becomes visible."""
        ...


class PluginHealth:
    """One plug-in's part of a service's health. It cannot change the entries of others."""

    def __init__(self, health: "ServiceBus", part: str) -> None:
        """Show warnings and metrics of the plug-in `part` in `health`. `part` is unique in the service."""
        self._health = health
        self._part = part

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Show a warning until it is cleared, by `clear` or `""`."""
        self._health.warn(code, str(sentence), part_of(self._part, subject))  # pyrefly: ignore[unnecessary-type-conversion]  # of a plug-in

    def clear(self, code: str, subject: str = "") -> None:
        """Clear a warning."""
        self._health.clear(code, part_of(self._part, subject))

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Show a metric, with the plug-in's name if another part of the service has one of this name."""
        self._health.set_metric(name, value, unit, self._part)

    def reached(self, latency_s: float) -> None:
        """Record the age of captured data when its effect becomes visible."""
        self._health.reached(latency_s)


def part_of(plugin: str, subject: str = "") -> str:
    """Return the subject of the warnings of `plugin` about its `subject`."""
    return f"plug-in {plugin} {subject}".rstrip()


class NullHealth:
    """Health sink that discards all entries."""

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Discard a warning."""

    def clear(self, code: str, subject: str = "") -> None:
        """Discard the end of a warning."""

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Discard a metric."""

    def reached(self, latency_s: float) -> None:
        """Discard a latency."""


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """The part of a service that its plug-in may use: time, health, stored state. It has no bus."""

    clock: Clock
    """Clock of all stamps. A plug-in never reads the operating system's clock."""
    health: HealthSink
    """Receiver of its warnings and metrics, which `pointit doctor` shows."""
    folder: Path
    """Folder for data that it stores between runs. It may not exist yet."""
    user: str = ""
    """User that owns it, or `""` if all users of the site share it."""
    sensor_from_arm: Quaternion = rotation.IDENTITY
    """IMU sources: the configured mounting of the sensor."""

    def state_file(self, model: type[T]) -> StateFile[T]:
        """Return the plug-in's stored value: a `model` in the file `state.json` of its folder."""
        return StateFile[T].at(self.folder / "state.json", model)

    @classmethod
    def detached(cls, user: str = "") -> Self:
        """Return surroundings outside a site, with wall time and a health sink that discards all entries."""
        folder = state_directory() / "detached" / user
        return cls(clock=WallClock(), health=NullHealth(), folder=folder, user=user)


def guard_of(plugins: PluginGroup[Any], name: str, sink: WarningSink, which: str = "") -> "PluginGuard":
    """Return the guard of the plug-in `name`. It also detects that the plug-in blocks the event loop.

    `which` distinguishes it in warnings from others of that name.
    """
    label = plugins.label(name)
    watch_for_stalls(plugins.module(name), label, sink)
    return PluginGuard(f"{label} ({which})" if which else label, sink)


class RestartDelay:
    """Delay before the restart of what has ended by itself: longer after each failure, up to a limit."""

    def __init__(self) -> None:
        self.failures = 0
        """Number of failures that count."""

    def after_failure_s(self, lasted_s: float = 0.0) -> float:
        """Count a failure after a run of `lasted_s`, and return the time until the restart, s."""
        if lasted_s >= MAX_WAIT_S:
            self.failures = 0
        wait_s = min(FIRST_WAIT_S * 2.0 ** min(self.failures, 10), MAX_WAIT_S)
        self.failures += 1
        return wait_s


class PluginGuard:
    """Runs a plug-in: restarts it with back-off when it fails or ends, and abandons it if it does not end."""

    def __init__(self, label: str, sink: WarningSink) -> None:
        """Guard the plug-in called `label` in warnings, such as `IMU source 'waving' of my-package`."""
        self.label = label
        self._sink = sink
        self._delay = RestartDelay()
        self._logged_s: dict[str, float] = {}
        self.problem = ""
        """Error of its last run, or `""`."""

    async def keep_running(self, run: Callable[[], Awaitable[None]]) -> None:
        """Run `run` again and again until cancelled. It should end only then."""
        while True:
            error: Exception | None = None
            try:
                await self.run(run)
            except Exception as raised:  # noqa: BLE001 - third-party code may raise any error
                error = raised
            await asyncio.sleep(self.failed(error))

    async def run(self, run: Callable[[], Awaitable[None]]) -> None:
        """Run `run` once. After some time without a failure, earlier ones are forgotten."""
        task = asyncio.create_task(_contained(run), name=self.label)
        settled: asyncio.TimerHandle | None = None
        if self._delay.failures:
            settled = asyncio.get_running_loop().call_later(MAX_WAIT_S, self.clear)
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
        _, pending = await asyncio.wait({task}, timeout=END_TIMEOUT_S)
        if pending:
            abandoned.add(task)
            task.add_done_callback(abandoned.discard)
            asyncio._unregister_task(task)  # noqa: SLF001  # the loop's end would wait
            log.error("%s did not end when it was cancelled, and was abandoned", self.label)
            return
        if task.cancelled():
            return
        error = task.exception()
        if error is not None:
            log.error("%s failed while it was ending: %s", self.label, describe(error))

    def made(self, make: Callable[[], ResultT]) -> ResultT:
        """Return the result of `make`, which creates the plug-in.

        Raises:
            ConfigError: If `make` raises any other error.
        """
        try:
            return make()
        except PointItError:
            raise
        except Exception as error:  # code of others, which may raise anything
            raise ConfigError(
                f"{self.label} cannot be started ({describe(error)}); update or uninstall it"
            ) from error

    def call(self, call_name: str, function: Callable[[], ResultT]) -> ResultT | None:
        """Return the result of `function`, or None if it raises. The report names the call `call_name`."""
        topic = f"{self.label}: {call_name}"
        try:
            result = function()
        except Exception as error:  # code of others, which may raise anything
            sentence = f"{topic} failed ({describe(error)}): update or remove it"
            self._sink.warn("plug-in", sentence, topic)
            now_s = time.monotonic()
            before_s = self._logged_s.get(topic)
            if before_s is None or now_s - before_s >= LOG_PERIOD_S:
                self._logged_s[topic] = now_s
                log.exception("%s", sentence, exc_info=error if before_s is None else None)
            return None
        self._sink.clear("plug-in", topic)
        return result

    def failed(self, error: BaseException | None) -> float:
        """Report the end of the plug-in and its `error`, if any. Return the time until its restart, s."""
        wait_s = self._delay.after_failure_s()
        failures = self._delay.failures
        outcome = "ended by itself" if error is None else f"failed ({describe(error)})"
        times = f", {failures} times now" if failures > 1 else ""
        self.problem = f"{self.label} {outcome}{times}; it will be restarted in {wait_s:g} s"
        self._sink.warn("plug-in", self.problem, self.label)
        log.error("%s", self.problem, exc_info=error if failures == 1 else None)
        return wait_s

    def clear(self) -> None:
        """Clear the warning after the plug-in has recovered."""
        self._delay.failures = 0
        self.problem = ""
        self._sink.clear("plug-in", self.label)


async def _contained(run: Callable[[], Awaitable[None]]) -> None:
    try:
        await run()
    except SystemExit as error:  # it would end the whole process
        raise RuntimeError("it called sys.exit") from error


def watch_for_stalls(module: str, label: str, sink: WarningSink, *, is_service: bool = False) -> None:
    """Report `label` in `sink` if code in the package of `module` blocks the loop. Virtual time never stalls.

    `is_service`: of our own code, services are watched only, each by the folder of its module.
    """
    package = module.partition(".")[0]
    if is_service and module.startswith("pointit."):
        package = module.rpartition(".")[0]
    if package != "pointit" and not is_virtual():
        loop = asyncio.get_running_loop()
        _watches.setdefault(loop, StallWatch(loop)).add(package, label, sink)


class StallWatch:
    """Watchdog thread of an event loop. If the loop is late, the running plug-in or service is the cause."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        """Watch `loop`, which runs in this thread, from the first plug-in until it is closed."""
        self._packages: dict[str, weakref.WeakKeyDictionary[WarningSink, str]] = {}
        self._loop = loop
        self._loop_thread = threading.get_ident()

    def add(self, package: str, label: str, sink: WarningSink) -> None:
        """Report the plug-in `label` in `sink` if code of `package` blocks the loop."""
        is_first = not self._packages
        sinks = weakref.WeakKeyDictionary({sink: label})
        sinks.update(self._packages.get(package, {}))
        self._packages = {**self._packages, package: sinks}  # replaced, not changed: the thread reads it
        if is_first:
            threading.Thread(target=self._run, name="stall watch", daemon=True).start()

    def _run(self) -> None:
        while True:
            sign = threading.Event()
            asked_s = time.monotonic()
            try:
                self._loop.call_soon_threadsafe(sign.set)
            except RuntimeError:  # the loop is closed
                return
            if not sign.wait(STALL_S):
                self._report_stall(sign, asked_s)
            time.sleep(STALL_PERIOD_S)

    def _report_stall(self, sign: threading.Event, asked_s: float) -> None:
        # The frame shows what runs now: after the stall, it is gone
        frames = sys._current_frames()  # noqa: SLF001  # documented, for this
        blocking_code = find_blocking_code(frames.get(self._loop_thread), self._packages)
        if blocking_code is None:
            return
        package, position, loaded_module = blocking_code
        is_ours = "." in package
        if is_ours and sign.wait(OWN_STALL_S - STALL_S):
            return
        sinks = dict(self._packages[package])
        labels = " or ".join(sorted(set(sinks.values())))
        log.error("%s blocks the event loop, and all services of this process, at %s", labels, position)

        # Health needs the loop, so it shows the stall after its end, with its duration
        while not sign.wait(STALL_PERIOD_S):
            if self._loop.is_closed():
                return
        remedy = "it must call what blocks in a thread"
        if is_ours and loaded_module:
            remedy = "this machine is busy, or its disk is slow: end other programs there"
        elif is_ours:
            remedy = "report this place"
        purpose = f", which loads {loaded_module}" if loaded_module else ""
        blocked_s = time.monotonic() - asked_s
        duration = f"{blocked_s:.1f} s"
        sentence = f"{labels} has blocked the event loop for {duration} at {position}{purpose}: {remedy}"
        with contextlib.suppress(RuntimeError):  # the loop was closed meanwhile
            for sink in sinks:
                self._loop.call_soon_threadsafe(self._report, sink, sentence, labels)

    def _report(self, sink: WarningSink, sentence: str, label: str) -> None:
        sink.warn(EVENT_LOOP, sentence, label)
        self._loop.call_later(SHOWN_S, sink.clear, EVENT_LOOP, label)


class BlockingCode(NamedTuple):
    """Code that runs in an event loop."""

    package: str
    where: str
    """File, line and function."""
    loaded_module: str = ""
    """Module that it loads, or `""` if it loads none."""


def find_blocking_code(frame: FrameType | None, packages: Collection[str]) -> BlockingCode | None:
    """Return the function of one of `packages` that runs in `frame` or called it, or None.

    The body of a module is no function: who loads it runs, of whatever package the module is.
    """
    loaded_module = ""
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        code = frame.f_code
        if code.co_name == MODULE_BODY:
            loaded_module = module
        else:
            package = _package_of(module, packages)
            if package:
                file = Path(code.co_filename).name
                position = f"{file}:{frame.f_lineno} in {code.co_name}"
                return BlockingCode(package, position, loaded_module)
        frame = frame.f_back
    return None


def _package_of(module: str, packages: Collection[str]) -> str:
    """Return the one of `packages` that contains `module`, or `""` if none does."""
    for package in packages:
        if f"{module}.".startswith(f"{package}."):
            return package
    return ""
