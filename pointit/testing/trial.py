"""One run of a plug-in beside its fake device, and the promises of all plug-ins that run."""

import asyncio
import contextlib
import threading
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Self

from pointit.plugins import Surroundings
from pointit.runtime.errors import first_cause
from pointit.runtime.service.plugin_guard import NullHealth
from pointit.testing.bench import START_NS
from pointit.testing.contract import (
    CANCEL_S,
    TRIES,
    CheckFailedError,
    Contract,
    promise,
    require,
    require_nothing_left,
    require_parameters,
    require_responsive,
)
from pointit.testing.devices import FakeDevice

POLL_S = 0.02
ABSENT_S = 0.2
"""Time for which a device is away, s."""
WARN = "Call `surroundings.health.warn(code, sentence)`, which says what to do, and later `clear(code)`"
RETRY = "Connect in a loop: end of file and OSError lead back to connecting, after a pause"


class TrialClock:
    """The loop's time, at another date than the operating system's."""

    speed = 1.0

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()

    def now_ns(self) -> int:
        """Return the time, ns. Any thread may call it."""
        return START_NS + round(self._loop.time() * 1e9)


class TrialHealth(NullHealth):
    """Receiver of a plug-in's warnings."""

    def __init__(self) -> None:
        self.warnings: dict[str, str] = {}
        """Present warnings by code, or code and subject."""
        self.foreign_call = ""
        """First function that the plug-in has called from another thread than the event loop's, or `""`."""
        self._thread = threading.get_ident()

    def note_thread(self, function: str) -> None:
        """Remember `function`, which the plug-in has called, if this is not the event loop's thread."""
        if threading.get_ident() != self._thread:
            self.foreign_call = self.foreign_call or function

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Show a warning until it is cleared, by `clear` or `""`."""
        self.note_thread("health.warn")
        self.warnings[f"{code} {subject}".rstrip()] = sentence
        self.warnings = {key: text for key, text in self.warnings.items() if text}

    def clear(self, code: str, subject: str = "") -> None:
        """Clear a warning."""
        self.warn(code, "", subject)


class DeviceContract(Contract):
    """Promises of a plug-in that runs, with a fake device that stands for the real one."""

    device: Any = FakeDevice
    """Makes a device that is not plugged in: `TcpDevice`, `UdpDevice`, `PtyDevice` or a class of your own."""

    def parameters(self, device: Any) -> Mapping[str, object]:
        """Return the parameters of the plug-in that lead it to `device`."""
        return device.address

    def trial(self) -> "Trial":
        """Return a trial of the plug-in, which has not begun."""
        raise NotImplementedError

    @promise()
    async def test_parameters(self) -> None:
        """Describes itself and its parameters, and refuses those that cannot work, with ConfigError."""
        async with self.trial() as trial:
            require_parameters(self, trial.make)  # made while the device is away

    @promise(real_time=True)
    async def test_does_not_block(self) -> None:
        """Does not hold up the event loop."""

        async def live() -> None:
            async with self.trial() as trial:
                await trial.begin(is_plugged=False)
                await trial.plug()
                await trial.go_through()

        await require_responsive(live)

    @promise()
    async def test_ends(self) -> None:
        """Ends within 1 s of being cancelled, and leaves no task, thread, file or socket."""

        async def round_trip(*, is_plugged: bool = True) -> float:
            async with self.trial() as trial:
                await trial.begin(is_plugged=is_plugged)
                if is_plugged:
                    await trial.go_through()
                return await trial.end()

        async def end() -> None:
            await round_trip()

        for is_plugged in (False, True):
            took_s = [await round_trip(is_plugged=is_plugged)]
            while took_s[-1] >= CANCEL_S and len(took_s) < TRIES:
                took_s.append(await round_trip(is_plugged=is_plugged))
            state = "the device was connected" if is_plugged else "it waited for the device"
            shortest_s = min(took_s)
            require(
                shortest_s < CANCEL_S,
                f"while {state}, it ended {shortest_s:.1f} s after it was cancelled",
                "Await only what can be cancelled, do not catch CancelledError, and limit what is sent last",
            )
        await require_nothing_left(end)


class Trial(ABC):
    """One run of a plug-in beside its fake device, which is not plugged in yet."""

    def __init__(self, contract: DeviceContract) -> None:
        self.device = contract.device()
        self.timeout_s = contract.timeout_s
        parameters = dict(contract.parameters(self.device))
        self.config = contract.plugin.config.model_validate(parameters)
        self.clock = TrialClock()
        self.health = TrialHealth()
        self._folder = TemporaryDirectory()
        folder = Path(self._folder.name) / "state"
        self.surroundings = Surroundings(clock=self.clock, health=self.health, folder=folder, user="anna")
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

    async def begin(self, *, is_plugged: bool = True) -> None:
        """Run the plug-in until it uses its device, or for a moment while the device is away."""
        if is_plugged:
            await self.device.plug()
        await self.start()
        if is_plugged:
            await self.exchange()
        else:
            await asyncio.sleep(ABSENT_S)
            self.require_running()

    async def go_through(self) -> None:
        """Do all that `live` does. Its failures are found by other tests, except that `run` has ended."""
        with contextlib.suppress(CheckFailedError):
            await self.live()
        self.require_running()

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

    async def warned(self, situation: str = "the device was away") -> None:
        """Wait for a warning. Raises CheckFailedError if none comes in the `situation`, a clause."""
        failure = f"{situation} and no warning said so"
        await self.until(lambda: bool(self.health.warnings), failure, WARN)

    async def __aenter__(self) -> Self:
        """Enter."""
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None, /
    ) -> None:
        """End the plug-in, put the device away, and check that `run` ended when it was cancelled."""
        try:
            if kind is None:
                self.require_running()
                await self.end()
                foreign_call = self.health.foreign_call
                require(
                    not foreign_call,
                    f"`{foreign_call}` was called from another thread than the event loop's",
                    "From there use `loop.call_soon_threadsafe`",
                )
            elif self.task is not None:
                self.task.cancel()
                await asyncio.wait([self.task], timeout=CANCEL_S)
        finally:
            await self.device.unplug()
            self.device.close()
            self._folder.cleanup()

    def require_running(self) -> None:
        """Raise CheckFailedError if `run` has returned or raised."""
        if self.task is not None and self.task.done():
            error = failure_of(self.task)
            end = "returned by itself"
            if error is not None:
                end = f"raised {type(error).__name__}: {error}"
            raise CheckFailedError(f"`run` {end}. {RETRY}") from error

    async def until(
        self,
        condition: Callable[[], bool],
        failure: str,
        remedy: str = "",
        act: Callable[[], Awaitable[None]] | None = None,
    ) -> None:
        """Wait for `condition`, while the plug-in runs. `act` is done between looks, such as sending again.

        Raises:
            CheckFailedError: If it does not come true in time, with `failure`, a clause, and `remedy`, or if
                `run` ends.
        """
        loop = asyncio.get_running_loop()
        end_s = loop.time() + self.timeout_s
        while not condition():
            self.require_running()
            is_in_time = loop.time() <= end_s
            require(is_in_time, f"{failure} (waited {self.timeout_s:g} s)", remedy)
            if act is not None:
                await act()
            await asyncio.sleep(POLL_S)

    async def end(self) -> float:
        """Cancel `run`, and return the time until it ends, s. Raises CheckFailedError if it does not."""
        # taken at once, or the end of the trial would end it a second time
        task = self.task
        self.task = None
        if task is None:
            return 0.0
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        task.cancel()
        await asyncio.wait([task], timeout=max(self.timeout_s, 2 * CANCEL_S))
        took_s = loop.time() - began_s
        require(
            task.done(),
            f"`run` was cancelled and still ran {took_s:.1f} s later",
            "Do not catch CancelledError",
        )
        error = failure_of(task)
        if error is not None:
            raise CheckFailedError(
                f"`run` raised {type(error).__name__} when it was cancelled: {error}"
            ) from error
        return took_s


def failure_of(task: asyncio.Task[None]) -> BaseException | None:
    """Return the exception of a `task` that is done, the one to show of a group, or None."""
    error = None if task.cancelled() else task.exception()
    return None if error is None else first_cause(error)
