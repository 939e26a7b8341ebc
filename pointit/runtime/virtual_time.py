"""An event loop in virtual time.

Real services run in it unchanged, as fast as the machine computes, and every run is the same.
"""

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar, TypeVarTuple, Unpack

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

START_NS = 1_700_000_000_000_000_000
"""Time of a `VirtualClock` when its loop begins, Unix ns."""


class _NoWaiting(selectors.DefaultSelector):
    """A selector that looks at files without waiting and lets virtual time pass instead."""

    passed_s = 0.0
    now_ns = START_NS
    is_paused = False

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        may_wait = timeout is None or timeout > 0
        if self.is_paused and may_wait:
            return super().select(None)
        events = super().select(0)
        if not events:
            if timeout is None:
                raise RuntimeError("everything waits for something that will never happen")
            if timeout > 0.0:
                self.passed_s += timeout
                self.now_ns = START_NS + round(self.passed_s * 1e9)
        return events


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """A loop whose time passes only where all its tasks wait, and then at once."""

    def __init__(self) -> None:
        self.virtual = _NoWaiting()
        super().__init__(self.virtual)

    def time(self) -> float:
        """Return the virtual time, s."""
        return self.virtual.passed_s

    def pause(self, is_paused: bool) -> None:
        """Run all due work without advancing the time. Later work waits until another thread calls."""
        self.virtual.is_paused = is_paused

    def run_in_executor(
        self, executor: Any, func: Callable[[Unpack[Ts]], T], *args: *Ts
    ) -> asyncio.Future[T]:
        """Call `func` at once: a thread would take another share of virtual time in each run."""
        del executor
        done: asyncio.Future[T] = self.create_future()
        try:
            done.set_result(func(*args))
        except Exception as error:  # noqa: BLE001 - raised where it is awaited
            done.set_exception(error)
        return done

    def set_default_executor(self, executor: Any) -> None:
        """Ignore it: no executor is used, and the loop could not wait for its threads at the end."""


def is_virtual() -> bool:
    """Return True if the running loop is in virtual time."""
    return isinstance(asyncio.get_running_loop(), VirtualTimeLoop)


class VirtualClock:
    """The time of the running loop as services see it."""

    speed = 1.0

    def now_ns(self) -> int:
        """Return the time, Unix ns."""
        loop: Any = asyncio.get_running_loop()
        now_ns: int = loop.virtual.now_ns
        return now_ns


def run_virtually(main: Coroutine[Any, Any, T]) -> T:
    """Run the coroutine `main` to its end in virtual time, as `asyncio.run` does in real time.

    Time passes at once where all tasks wait, so an hour takes as long as its computing takes, and the same
    seed gives the same run. Only what this process does itself can be waited for, no network.
    """
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)
