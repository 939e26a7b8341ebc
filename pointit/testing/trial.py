"""Checks of a plug-in and one run of it, with a watchdog for code that blocks the loop."""

import asyncio
import contextlib
import ctypes
import sys
import threading
import time
import traceback
import warnings
from abc import ABC, abstractmethod
from collections.abc import (
    AsyncGenerator,
    Awaitable,
    Callable,
    Coroutine,
    Generator,
    Iterator,
    Mapping,
    Sequence,
)
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, contextmanager
from contextvars import ContextVar
from dataclasses import InitVar, dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType, TracebackType
from typing import Any, Generic, Self, TypeVar

from pointit.plugins import Plugin, Surroundings
from pointit.runtime.clock import START_NS, VirtualTimeLoop
from pointit.runtime.errors import first_cause
from pointit.testing.devices import FakeDevice

BEAT_S = 0.01
LOOK_S = 0.02
END_WITHIN_S = 2.0
"""Time for a loop to close after its result is known, s."""

P = TypeVar("P", bound=Plugin)
H = TypeVar("H", bound="Harness[Any]")
AT_ONCE = 16
"""Checks that run at the same time: most of them wait."""
TIMEOUT_FACTORS = 6.0
"""A check that has not come to an end within this many times the harness's timeout hangs."""
CheckFunction = Callable[[H], Coroutine[Any, Any, None]]

T = TypeVar("T", bound="Trial")
CANCEL_S = 1.0
"""Time within which a plug-in must have ended after it was cancelled, s."""
ABSENT_S = 0.2
"""Time for which a device is away, s."""


class LoopWatch:
    """Measures how long the event loop of another thread stands still.

    Time in which this machine did not even run the watching thread does not count, so that a busy machine is
    not mistaken for a blocking plug-in.
    """

    longest_s = 0.0
    """Longest time for which the loop has stood still, s."""
    where = ""
    """Location in the code at which it stood still."""

    def __init__(self) -> None:
        self._beat_s = 0.0
        self._excused_s = 0.0
        self._last_wakeup_s = 0.0
        self._thread = 0
        self._handle: asyncio.Handle | None = None

    def start(self) -> None:
        """Watch the running loop from now on."""
        self._thread = threading.get_ident()
        self._beat()

    def stop(self) -> None:
        """Watch no longer."""
        if self._handle is not None:
            self._handle.cancel()
        self._beat_s = 0.0

    def _beat(self) -> None:
        self._excused_s = 0.0
        self._beat_s = time.monotonic()
        self._handle = asyncio.get_running_loop().call_later(BEAT_S, self._beat)

    def look(self) -> None:
        """Update the longest time for which the loop was blocked.

        Called from another thread, every `LOOK_S`.
        """
        now_s = time.monotonic()
        if self._last_wakeup_s:
            self._excused_s += max(0.0, now_s - self._last_wakeup_s - LOOK_S)
        self._last_wakeup_s = now_s
        beat_s = self._beat_s
        blocked_s = now_s - beat_s - self._excused_s - BEAT_S
        if beat_s and blocked_s > self.longest_s:
            self.longest_s, self.where = blocked_s, place(self._thread)


current_watch: ContextVar[LoopWatch] = ContextVar("current_watch")
"""Watch of the running check."""


def place(thread: int) -> str:
    """Return the place in the code where a thread is, without the machinery of asyncio around it."""
    frames: dict[int, FrameType] = getattr(sys, "_current_frames")()  # noqa: B009 - no other way
    frame = frames.get(thread)
    if frame is None:
        return "nowhere"
    lines = [
        line
        for line in traceback.extract_stack(frame)
        if "asyncio" not in line.filename and "/threading.py" not in line.filename
    ]
    line = lines[-1] if lines else traceback.extract_stack(frame)[-1]
    return f"{line.filename}, line {line.lineno}, in {line.name}: `{line.line}`"


def run_in_own_loop(
    main: Callable[[], Coroutine[Any, Any, None]], *, limit_s: float, virtual_time: bool = False
) -> str:
    """Run `main()` in a new loop in a new thread, and raise what it raises.

    Returns:
        Empty, or the place in the code where it hung after `limit_s`. That is counted in looks of the
        watching thread, which a busy machine runs seldom, too.
    """
    outcome: list[BaseException | None] = []
    finished = threading.Event()
    watch = LoopWatch()

    async def watched() -> None:
        current_watch.set(watch)
        try:
            await main()
            outcome.append(None)
        except BaseException as error:  # noqa: BLE001 - raised again by the caller's thread
            outcome.append(error)
        finally:
            watch.stop()
            finished.set()  # before the loop closes, which waits for tasks that cannot be cancelled

    def work() -> None:
        with (
            contextlib.suppress(BaseException),
            asyncio.Runner(loop_factory=VirtualTimeLoop if virtual_time else None) as runner,
        ):
            runner.run(watched())

    thread = threading.Thread(target=work, name="plug-in check", daemon=True)
    thread.start()
    identity = thread.ident or 0
    for _ in range(round(limit_s / LOOK_S)):
        if finished.wait(LOOK_S):
            break
        watch.look()
    hung = "" if outcome else place(identity)
    thread.join(END_WITHIN_S if outcome else 0.0)
    if thread.is_alive():
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(identity), ctypes.py_object(SystemExit))
    if outcome and outcome[0] is not None:
        raise outcome[0]
    return hung


@dataclass(frozen=True, kw_only=True)
class Harness(Generic[P]):
    """A plug-in with the data that its checks need."""

    plugin: P
    wrong_parameters: tuple[Mapping[str, object], ...] = ()
    """Parameters that the plug-in must refuse."""
    virtual_time: bool = False
    """True if plug-in and device wait for timers of the event loop alone: checks then take no time."""
    timeout_s: float = 10.0
    """Time that the plug-in may take to start, to connect, to notice a loss, and to warn, s."""
    patience_s: InitVar[float | None] = None
    """Old name of `timeout_s`."""

    def __post_init__(self, patience_s: float | None) -> None:
        """Set `timeout_s` from its old name, with a warning."""
        if patience_s is not None:
            sentence = (
                "Harness(patience_s=) is now timeout_s=; the next minor version takes the new name only"
            )
            warnings.warn(sentence, DeprecationWarning, stacklevel=3)
            object.__setattr__(self, "timeout_s", patience_s)


@dataclass(frozen=True, kw_only=True)
class Check:
    """One check of one plug-in."""

    name: str
    promise: str
    """Clause about the plug-in that must hold: `ends within 1 s of being cancelled`."""
    remedy: str
    """Change that helps if it does not hold, in one sentence."""
    alone: bool
    """True if it measures the whole process, so that no other check may run meanwhile."""
    function: Callable[[], None]

    def __str__(self) -> str:
        """Return the name, which makes a readable `ids=str` of pytest."""
        return self.name

    def run(self) -> None:
        """Run the check in a separate thread and event loop, so that it cannot block the caller.

        Raises:
            CheckFailedError: If the promise does not hold. The message has the observation and the remedy.
        """
        try:
            self.function()
        except CheckFailedError as error:
            raise CheckFailedError(f"{self.name}: {error}. {self.remedy}") from error.__cause__


class CheckFailedError(AssertionError):
    """A plug-in breaks a promise. The message has the promise, the observation and the remedy."""


@contextmanager
def called(function: str) -> Generator[None]:
    """Raise CheckFailedError if `function` of the plug-in, which is called in the block, raises anything."""
    try:
        yield
    except Exception as error:
        raise CheckFailedError(f"`{function}` raised {type(error).__name__}: {error}") from error


def run_checks(checks: Sequence[Check]) -> Iterator[tuple[Check, str]]:
    """Run `checks`, most of them at the same time. Yield each with its error message, or `""`."""
    with ThreadPoolExecutor(max_workers=AT_ONCE) as pool:
        found = {check.name: pool.submit(problem, check) for check in checks if not check.alone}
    for check in checks:
        yield check, found[check.name].result() if check.name in found else problem(check)


def problem(check: Check) -> str:
    """Run `check`. Return its error message, or `""` if the promise holds."""
    try:
        check.run()
    except CheckFailedError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - of a harness, which is code of others, too
        return f"{check.name}: the harness raised {type(error).__name__}: {error}. Correct it"
    return ""


class Suite(Generic[H]):
    """The checks of one kind of plug-in, each a function of its harness."""

    def __init__(self) -> None:
        self._rows: list[tuple[Callable[[H], bool], Callable[[H], Check]]] = []

    def add(
        self,
        function: CheckFunction[H],
        remedy: str,
        applies: Callable[[H], bool] = lambda _harness: True,
        *,
        alone: bool = False,
    ) -> None:
        """Add `function` as a check of its name. Its docstring is the promise.

        Args:
            function: raises CheckFailedError, with a clause that says what happened, if it does not hold.
            remedy: what to do then.
            applies: returns False for a harness with which it cannot be found out.
            alone: True if it measures the whole process.
        """
        sentence = function.__doc__ or ""
        promise = f"{sentence[:1].lower()}{sentence[1:].removesuffix('.')}"

        def bound(harness: H) -> Check:
            return Check(
                name=function.__name__,
                promise=promise,
                remedy=remedy,
                alone=alone,
                function=partial(_run, function, harness),
            )

        self._rows.append((applies, bound))

    def check(
        self, remedy: str, applies: Callable[[H], bool] = lambda _harness: True, *, alone: bool = False
    ) -> Callable[[CheckFunction[H]], None]:
        """Return a decorator that adds a function, as `add` does."""
        return partial(self.add, remedy=remedy, applies=applies, alone=alone)

    def checks(self, harness: H) -> list[Check]:
        """Return the checks that apply to `harness`."""
        return [bound(harness) for applies, bound in self._rows if applies(harness)]


def _run(function: CheckFunction[H], harness: H) -> None:
    limit_s = TIMEOUT_FACTORS * harness.timeout_s
    raised: list[BaseException] = []

    def on_error(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        # of protocols, timers and readers: asyncio logs it, and nobody awaits them
        if "exception" in context and "future" not in context:
            raised.append(context["exception"])
        else:
            loop.default_exception_handler(context)

    async def main() -> None:
        asyncio.get_running_loop().set_exception_handler(on_error)
        await function(harness)

    hung = run_in_own_loop(main, limit_s=limit_s, virtual_time=harness.virtual_time)
    if hung:
        raise CheckFailedError(f"did not come to an end within {limit_s:g} s: {hung}")
    for error in raised:
        line = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{line.filename}, line {line.lineno}, in {line.name}"
        raise CheckFailedError(f"a callback raised {type(error).__name__}: {error}, in {where}") from error


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
        """Present warnings by code, or code and subject."""
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

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Show a warning until it is cleared, by `clear` or `""`."""
        self.note_thread("health.warn")
        key = f"{code} {subject}".rstrip()
        if sentence:
            self.warnings[key] = sentence
        else:
            self.warnings.pop(key, None)

    def clear(self, code: str, subject: str = "") -> None:
        """Clear a warning."""
        self.warn(code, "", subject)

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
        self, kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None, /
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
