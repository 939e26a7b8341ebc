"""An event loop in virtual time that runs the handles of simulated processes."""

import asyncio
import heapq
from collections.abc import Callable, Iterable
from typing import Any

from pointit.runtime.virtual_time import VirtualTimeLoop
from tests.simulation.kernel.process import PROCESS, START_NS

MIN_WAIT_S = 2e-6
"""Shortest wait, s. As with a machine's timers, code that halves its wait each time arrives in the end."""
MIN_CANCELLED_TO_PRUNE = 1000


class SimulationLoop(VirtualTimeLoop):
    """A `VirtualTimeLoop` that looks at no files, keeps the order of equal times, and obeys processes.

    It runs no handle of a process that was killed, and keeps those of a process that stands still.
    """

    _ready: Any

    def __init__(self) -> None:
        super().__init__()
        self._timers: list[tuple[float, int, asyncio.TimerHandle]] = []
        self._timer_count = 0
        self._cancelled = 0

    def call_at(
        self, when: float, callback: Callable[..., object], *args: Any, context: Any = None
    ) -> asyncio.TimerHandle:
        """Call back at the virtual time `when`, s; several of one time in the order of these calls."""
        timer = asyncio.TimerHandle(when, callback, args, self, context)
        self._timer_count += 1
        heapq.heappush(self._timers, (when, self._timer_count, timer))
        return timer

    def _timer_handle_cancelled(self, handle: asyncio.TimerHandle) -> None:
        del handle
        self._cancelled += 1
        if self._cancelled > max(MIN_CANCELLED_TO_PRUNE, len(self._timers) // 2):
            self._timers = [each for each in self._timers if not each[2].cancelled()]
            heapq.heapify(self._timers)
            self._cancelled = 0

    def call_soon_threadsafe(
        self, callback: Callable[..., object], *args: Any, context: Any = None
    ) -> asyncio.Handle:
        """Call back soon: there is one thread."""
        return self.call_soon(callback, *args, context=context)

    def create_task(self, coro: Any, **options: Any) -> asyncio.Task[Any]:
        """Return a new task, which belongs to the process of its context."""
        task: asyncio.Task[Any] = super().create_task(coro, **options)
        context = options.get("context")
        process = PROCESS.get() if context is None else context.get(PROCESS)
        if process is not None:
            process.add_task(task)
        return task

    def run_first(self, handles: Iterable[asyncio.Handle]) -> None:
        """Run `handles`, in their order, before all that are ready."""
        self._ready.extendleft(reversed(list(handles)))

    def _run_once(self) -> None:
        """Run all handles that are ready. If there are none, let time pass to the next timer."""
        ready = self._ready
        if not ready:
            self._pass_time()
        for _ in range(len(ready)):
            handle = ready.popleft()
            if handle._cancelled:
                continue
            process = handle._context.get(PROCESS)
            if process is None or not process.refuses(handle):
                handle._run()

    def _pass_time(self) -> None:
        timers = self._timers
        while timers and timers[0][2].cancelled():
            heapq.heappop(timers)
            self._cancelled -= 1
        if not timers:
            raise RuntimeError("everything waits for something that will never happen")
        now_s = self.virtual.passed_s
        if timers[0][0] > now_s:
            now_s = max(timers[0][0], now_s + MIN_WAIT_S)
            self.virtual.passed_s = now_s
            self.virtual.now_ns = START_NS + round(now_s * 1e9)
        while timers and timers[0][0] <= now_s:
            timer = heapq.heappop(timers)[2]
            if timer.cancelled():
                self._cancelled -= 1
            else:
                self._ready.append(timer)
