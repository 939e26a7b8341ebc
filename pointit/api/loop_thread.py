"""An event loop in a thread of its own, for callers without one: scripts and notebooks."""

import asyncio
import concurrent.futures
import threading
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from pointit.runtime.errors import BusClosedError, PointItError
from pointit.runtime.virtual_time import VirtualTimeLoop

T = TypeVar("T")


class LoopThread:
    """Runs coroutines for other threads. Its virtual time passes only while one of them waits."""

    def __init__(self, *, virtual: bool = False) -> None:
        self._virtual = virtual
        self._calls: set[concurrent.futures.Future[Any]] = set()
        self._loop: asyncio.AbstractEventLoop
        self._ready: concurrent.futures.Future[None] = concurrent.futures.Future()
        self._stop = asyncio.Event()
        self._waiting = 0
        self._thread = threading.Thread(target=self._run_loop, name="pointit", daemon=True)
        self._thread.start()
        self._ready.result()

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Return the result of `work`, which is cancelled by Ctrl-C.

        Raises:
            BusClosedError: If the thread has ended.
            RuntimeError: If this is the thread itself, which would wait for itself.
        """
        if threading.current_thread() is self._thread:
            work.close()
            raise RuntimeError("the loop of the site cannot wait for itself; call this from another thread")
        counted = self._counted(work)
        try:
            call = asyncio.run_coroutine_threadsafe(counted, self._loop)
        except RuntimeError as error:  # the loop is closed
            counted.close()
            work.close()
            raise closed_error() from error
        # The loop may end between the two steps, and would then never run the call
        self._calls.add(call)
        try:
            if not self._thread.is_alive():
                call.cancel()
            return call.result()
        except concurrent.futures.CancelledError as error:
            raise closed_error() from error
        except PointItError as error:
            # Its sentence is for people: no frames of this thread and no error of a library stand above it.
            raise error.with_traceback(None) from None
        except BaseException:
            call.cancel()
            raise
        finally:
            self._calls.discard(call)

    def call(self, work: Callable[[], T]) -> T:
        """Return the result of `work`, called in the loop."""

        async def called() -> T:
            return work()

        return self.run(called())

    def close(self) -> None:
        """End the loop with all its tasks, and the thread."""
        # `_stop` belongs to the loop, which is the only one that may set it
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end)
            self._thread.join()

    def _run_loop(self) -> None:
        make = VirtualTimeLoop if self._virtual else asyncio.new_event_loop
        try:
            with asyncio.Runner(loop_factory=make) as runner:
                runner.run(self._until_closed())
        except BaseException as error:
            if self._ready.done():
                raise
            self._ready.set_exception(error)  # such as too many open files
        finally:
            for call in list(self._calls):
                call.cancel()

    async def _until_closed(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._count_waiting(0)
        self._ready.set_result(None)
        await self._stop.wait()

    def _end(self) -> None:
        self._count_waiting(1)  # time passes until all has ended
        self._stop.set()

    async def _counted(self, work: Coroutine[Any, Any, T]) -> T:
        self._count_waiting(1)
        try:
            return await work
        finally:
            self._count_waiting(-1)

    def _count_waiting(self, change: int) -> None:
        self._waiting += change
        if isinstance(self._loop, VirtualTimeLoop):
            self._loop.pause(not self._waiting)


def closed_error() -> BusClosedError:
    """Return the error for the use of a closed object."""
    return BusClosedError("the site is closed; open it again with `pointit.open` or `pointit.connect`")
