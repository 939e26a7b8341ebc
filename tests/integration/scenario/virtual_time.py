"""An event loop in virtual time: nothing is waited for, the next timer is simply due.

Real services run in it unchanged, as fast as the machine computes, and every run is the same.
"""

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar, TypeVarTuple, Unpack

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

START_NS = 1_700_000_000_000_000_000


class _NoWaiting(selectors.DefaultSelector):
    """A selector that looks at files without waiting and lets virtual time pass instead."""

    passed_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        events = super().select(0)
        if not events:
            if timeout is None:
                raise RuntimeError("everything waits for something that will never happen")
            self.passed_s += max(timeout, 0.0)
        return events


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """A loop whose time is that of `_NoWaiting`."""

    def __init__(self) -> None:
        self._virtual = _NoWaiting()
        super().__init__(self._virtual)

    def time(self) -> float:
        return self._virtual.passed_s

    def run_in_executor(
        self, executor: Any, func: Callable[[Unpack[Ts]], T], *args: *Ts
    ) -> asyncio.Future[T]:
        """Call `func` at once: a thread would take another share of virtual time in each run."""
        del executor
        done: asyncio.Future[T] = self.create_future()
        try:
            done.set_result(func(*args))
        except Exception as error:  # noqa: BLE001 - for who awaits it
            done.set_exception(error)
        return done


class VirtualClock:
    """The loop's time as services see it."""

    speed = 1.0

    def now_ns(self) -> int:
        return START_NS + round(asyncio.get_running_loop().time() * 1e9)


def run_virtually(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` to its end in virtual time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)
