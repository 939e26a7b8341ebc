"""Simulated machines, and processes with a clock, files and a life of their own.

A process is a context: all handles and tasks that begin in it belong to it. One that is killed runs no
further handle, no `finally` and no `except`, as after SIGKILL. One that stands still runs its handles later.
"""

import asyncio
import contextvars
from collections.abc import Callable, Coroutine
from typing import Any, Protocol

from tests.simulation.kernel.timeline import Timeline

START_NS = 1_700_000_000_000_000_000
"""True time 0 of each simulation, Unix ns."""
READING_NS = 200
"""Duration of reading a clock, ns, so that two readings in one instant differ."""
MIN_TASKS_TO_PRUNE = 200
_ROUNDING_S = 1e-9

PROCESS: contextvars.ContextVar["Process | None"] = contextvars.ContextVar("simulated process", default=None)


class _Closable(Protocol):
    def close(self) -> None: ...


class Host:
    """A machine: a clock and a disk."""

    def __init__(self, name: str, timeline: Timeline) -> None:
        self.name = name
        self.offset_ns = 0
        """Error of its clock, ns."""
        self.drift_ppm = 0.0
        self.reading_ns = READING_NS
        self.disk_is_full = False
        self.disk_delay_s = 0.0
        """Duration of each write, s."""
        self._timeline = timeline
        self._read_at_ns = 0
        self._readings = 0

    def now_ns(self) -> int:
        """Return the time of its clock, Unix ns."""
        true_ns = round(self._timeline.now_s * 1e9)
        if true_ns != self._read_at_ns:
            self._read_at_ns = true_ns
            self._readings = 0
        self._readings += 1
        read_ns = true_ns + self.reading_ns * self._readings
        return START_NS + read_ns + self.offset_ns + round(read_ns * self.drift_ppm * 1e-6)


class Process:
    """A simulated process. It is the `Clock` of its services, too."""

    speed = 1.0

    def __init__(self, timeline: Timeline, name: str, host: Host, pid: int) -> None:
        self.name = name
        self.host = host
        self.pid = pid
        self.is_dead = False
        self.is_still = False
        self.zenoh_is_alive = True
        """False while it is stopped by a signal: then Zenoh's threads stand still, too."""
        self.tasks: list[asyncio.Task[Any]] = []
        """Also keeps the tasks of a killed process from being collected, which would run their `finally`."""
        self.stores: list[_Closable] = []
        """Databases that it has open."""
        self.kill_point: tuple[str, int] | None = None
        """Kind of the point at which it is to be killed, and how many more of them it passes."""
        self.on_death: list[Callable[[], object]] = []
        self.on_resumed: list[Callable[[], object]] = []
        self.disk_time_s = 0.0
        """Time that writes have taken, s. `time.perf_counter` shows it."""
        self.main: asyncio.Task[Any] | None = None
        self.began_s = timeline.now_s
        self.context = contextvars.copy_context()
        self.context.run(PROCESS.set, self)
        self._timeline = timeline
        self._held: list[asyncio.Handle] = []
        self._still_until_s = 0.0

    def now_ns(self) -> int:
        """Return the time as its services see it, Unix ns."""
        return self.host.now_ns()

    def begin(self, make: Callable[[], Coroutine[Any, Any, object]]) -> asyncio.Task[object]:
        """Run the coroutine that `make` returns as its main task."""
        work = self.context.run(make)
        self.main = self._timeline.loop.create_task(work, name=self.name, context=self.context)
        return self.main

    def add_task(self, task: asyncio.Task[Any]) -> None:
        """Remember a task that began in it."""
        self.tasks.append(task)
        count = len(self.tasks)
        if count > MIN_TASKS_TO_PRUNE and count % 100 == 0:
            self.tasks = [each for each in self.tasks if not each.done()]

    def refuses(self, handle: asyncio.Handle) -> bool:
        """Return True if `handle` must not run now. One of a process that stands still runs later."""
        if self.is_dead:
            return True
        if self.is_still:
            self._held.append(handle)
            return True
        return False

    def stand_still(self, duration_s: float, *, by_signal: bool) -> None:
        """Stand still, as after SIGSTOP (`by_signal`), or as in a call that blocks the loop."""
        if self.is_dead:
            return
        if by_signal:
            self.zenoh_is_alive = False
        until_s = self._timeline.now_s + duration_s
        if self.is_still and until_s <= self._still_until_s:
            return
        self.is_still = True
        self._still_until_s = until_s
        self._timeline.after(duration_s, self._resume_if_due)

    def _resume_if_due(self) -> None:
        if self._timeline.now_s >= self._still_until_s - _ROUNDING_S:
            self.resume()

    def resume(self) -> None:
        """Run the handles that were held back, in their order, and go on."""
        if self.is_dead or not self.is_still:
            return
        self.is_still = False
        self.zenoh_is_alive = True
        loop: Any = self._timeline.loop
        loop.run_first(self._held)
        self._held = []
        for callback in self.on_resumed:
            callback()

    def kill(self, reason: str) -> None:
        """End at once, as by SIGKILL."""
        if self.is_dead:
            return
        self.is_dead = True
        self._timeline.note("kill", f"{self.name} ({reason})")
        for store in self.stores:
            store.close()
        for callback in self.on_death:
            callback()

    def pass_point(self, kind: str) -> None:
        """Pass a point at which it may be killed: around a message, a commit, a file, a reply."""
        if self.kill_point is None or self.is_dead:
            return
        awaited, left = self.kill_point
        if awaited != kind:
            return
        if left > 1:
            self.kill_point = (kind, left - 1)
            return
        self.kill_point = None
        self.kill(f"at {kind}")
