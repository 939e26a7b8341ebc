"""Trials: one run of a plug-in in surroundings whose clock, health and device belong to the check."""

import asyncio
import contextlib
import threading
from abc import ABC, abstractmethod
from collections.abc import AsyncGenerator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Self, TypeVar

from pointit.plugins import Surroundings
from pointit.runtime.errors import first_cause
from pointit.runtime.virtual_time import START_NS
from pointit.testing.check import CheckFailedError, Harness, P
from pointit.testing.devices import FakeDevice

T = TypeVar("T", bound="Trial")
LOOK_S = 0.02
CANCEL_S = 1.0
"""Time within which a plug-in must have ended after it was cancelled, s."""
ABSENT_S = 0.2
"""Time for which a device is away, s."""


class TrialClock:
    """The loop's time, at another date than the operating system's."""

    speed = 1.0

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()

    def now_ns(self) -> int:
        """Return the time, ns. Any thread may call it."""
        return START_NS + round(self._loop.time() * 1e9)


class TrialHealth:
    """Receiver of a plug-in's warnings. Notes whether they come in the event loop's thread."""

    def __init__(self) -> None:
        self.warnings: dict[str, str] = {}
        """Present warnings by topic."""
        self._foreign_folder = ""
        self._thread = threading.get_ident()

    def note_thread(self, function: str) -> None:
        """Remember `function`, which the plug-in has called, if this is not the event loop's thread."""
        if threading.get_ident() != self._thread:
            self._foreign_folder = self._foreign_folder or function

    def require_in_loop(self) -> None:
        """Raise CheckFailedError if the plug-in has called something from another thread."""
        if self._foreign_folder:
            raise CheckFailedError(
                f"`{self._foreign_folder}` was called from another thread than the event loop's"
            )

    def warn(self, topic: str, sentence: str) -> None:
        """Show a warning until it is cleared, by `clear` or `""`."""
        self.note_thread("health.warn")
        if sentence:
            self.warnings[topic] = sentence
        else:
            self.warnings.pop(topic, None)

    def clear(self, topic: str) -> None:
        """Clear a warning."""
        self.warn(topic, "")

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:  # noqa: ARG002 - as the bus
        """Store a metric."""
        self.note_thread("health.set_metric")

    def reached(self, latency_s: float) -> None:  # noqa: ARG002 - as the bus
        """Store a latency."""
        self.note_thread("health.reached")


@dataclass(frozen=True, kw_only=True)
class DeviceHarness(Harness[P]):
    """A plug-in that runs, with a fake device that stands for the real one."""

    device: Callable[[], FakeDevice] = FakeDevice
    """Makes a device that is not plugged in: `TcpDevice`, `UdpDevice`, `PtyDevice` or one of your own."""
    parameters: Callable[[Any], Mapping[str, object]] = lambda _device: {}
    """Parameters of the plug-in that lead it to the device given."""

    def trial(self) -> "Trial":
        """Return a trial of the plug-in, which has not begun."""
        raise NotImplementedError

    def example(self) -> FakeDevice:
        """Return a closed device, which shows the capabilities of its kind."""
        device = self.device()
        device.close()
        return device


class Trial(ABC):
    """One run of a plug-in beside its fake device, which is not plugged in yet."""

    def __init__(self, harness: DeviceHarness[Any]) -> None:
        self.device = harness.device()
        self.timeout_s = harness.timeout_s
        self.config = harness.plugin.config.model_validate(dict(harness.parameters(self.device)))
        self.clock = TrialClock()
        self.health = TrialHealth()
        self._folder = TemporaryDirectory()
        self.surroundings = Surroundings(
            clock=self.clock, health=self.health, folder=Path(self._folder.name) / "state", user="anna"
        )
        self.task: asyncio.Task[None] | None = None

    @abstractmethod
    def make(self, config: Any) -> object:
        """Create the plug-in. Raises its errors."""

    @abstractmethod
    async def start(self) -> None:
        """Run the plug-in in the background. Raises CheckFailedError if it cannot be made."""

    @abstractmethod
    async def exchange(self, situation: str = "the device was connected") -> None:
        """Wait until something passes between plug-in and device, if anything can.

        Raises:
            CheckFailedError: If nothing passes in the `situation`, a clause.
        """

    @abstractmethod
    async def live(self) -> None:
        """Do all that can happen to the plug-in while it runs. Raises CheckFailedError if it fails."""

    async def plug(self, situation: str = "the device came") -> None:
        """Plug the device in, and exchange something."""
        await self.device.plug()
        await self.exchange(situation)

    async def replug(self) -> None:
        """Unplug the device for a moment, and exchange something."""
        await self.device.unplug()
        await asyncio.sleep(ABSENT_S)
        self.require_running()
        await self.plug("the device came back")

    async def __aenter__(self) -> Self:
        """Enter."""
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """End the plug-in, put the device away, and check that `run` ended when it was cancelled."""
        try:
            if kind is None:
                self.require_running()
                await self.end()
            elif self.task is not None:
                self.task.cancel()
                await asyncio.wait([self.task], timeout=CANCEL_S)
        finally:
            await self.device.unplug()
            self.device.close()
            self._folder.cleanup()

    def require_running(self) -> None:
        """Raise CheckFailedError if `run` has returned or raised."""
        if self.task is None or not self.task.done():
            return
        error = failure_of(self.task)
        if error is None:
            raise CheckFailedError("`run` returned by itself")
        raise CheckFailedError(f"`run` raised {type(error).__name__}: {error}") from error

    async def until(
        self, condition: Callable[[], bool], failure: str, act: Callable[[], Awaitable[None]] | None = None
    ) -> None:
        """Wait for `condition`, while the plug-in runs.

        Args:
            condition: looked at every few milliseconds.
            failure: what is wrong if it does not come true in the harness's patience.
            act: done between looks, such as sending once more.

        Raises:
            CheckFailedError: If it does not come true, or `run` ends.
        """
        loop = asyncio.get_running_loop()
        end_s = loop.time() + self.timeout_s
        while not condition():
            self.require_running()
            if loop.time() > end_s:
                raise CheckFailedError(f"{failure} (waited {self.timeout_s:g} s)")
            if act is not None:
                await act()
            await asyncio.sleep(LOOK_S)

    async def end(self) -> float:
        """Cancel `run`, and return the time until it ends, s. Raises CheckFailedError if it does not."""
        task, self.task = self.task, None
        if task is None:
            return 0.0
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        task.cancel()
        await asyncio.wait([task], timeout=max(self.timeout_s, 2 * CANCEL_S))
        if not task.done():
            raise CheckFailedError(f"`run` was cancelled and still ran {loop.time() - began_s:.1f} s later")
        error = failure_of(task)
        if error is not None:
            raise CheckFailedError(
                f"`run` raised {type(error).__name__} when it was cancelled: {error}"
            ) from error
        return loop.time() - began_s


def failure_of(task: asyncio.Task[None]) -> BaseException | None:
    """Return the exception of a `task` that is done, the one to show of a group, or None."""
    error = None if task.cancelled() else task.exception()
    return None if error is None else first_cause(error)


async def go_through(trial: Trial) -> None:
    """Run all events on `trial` and ignore their results. Separate checks test these.

    Raises:
        CheckFailedError: If `run` has ended.
    """
    with contextlib.suppress(CheckFailedError):
        await trial.live()
    trial.require_running()


@asynccontextmanager
async def absent(trial: T) -> AsyncGenerator[T]:
    """Run the plug-in of `trial` while its device is away."""
    async with trial:
        await trial.start()
        await asyncio.sleep(ABSENT_S)
        trial.require_running()
        yield trial


@asynccontextmanager
async def connected(trial: T) -> AsyncGenerator[T]:
    """Run the plug-in of `trial` until it uses its device."""
    async with trial:
        await trial.device.plug()
        await trial.start()
        await trial.exchange()
        yield trial


@asynccontextmanager
async def lived(trial: T) -> AsyncGenerator[T]:
    """Run the plug-in of `trial` with its device, and let all happen to it that can."""
    async with connected(trial):
        await go_through(trial)
        yield trial
