"""An event loop in a thread of its own, for callers without one: scripts and notebooks."""

import asyncio
import concurrent.futures
import threading
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from pointit.runtime.errors import BusClosedError
from pointit.runtime.virtual_time import VirtualTimeLoop

T = TypeVar("T")


class LoopThread:
    """Runs coroutines for other threads. Its virtual time passes only while one of them waits."""

    def __init__(self, *, virtual: bool = False) -> None:
        """Start the thread."""
        self._virtual = virtual
        self._calls: set[concurrent.futures.Future[Any]] = set()
        self._ready: concurrent.futures.Future[asyncio.AbstractEventLoop] = concurrent.futures.Future()
        self._stop = asyncio.Event()
        self._waiting = 0
        self._thread = threading.Thread(target=self._live, name="pointit", daemon=True)
        self._thread.start()
        self._loop = self._ready.result()

    def call(self, work: Coroutine[Any, Any, T]) -> T:
        """Return the result of `work`, which is cancelled by Ctrl-C.

        Raises:
            BusClosedError: If the thread has ended.
            RuntimeError: If this is the thread itself, which would wait for itself.
        """
        if threading.current_thread() is self._thread:
            work.close()
            raise RuntimeError("the loop of the site cannot wait for itself; call this from another thread")
        counted = self._count(work)
        try:
            call = asyncio.run_coroutine_threadsafe(counted, self._loop)
        except RuntimeError as error:  # the loop is closed
            counted.close()
            work.close()
            raise closed_error() from error
        self._calls.add(call)
        try:
            if not self._thread.is_alive():
                call.cancel()
            return call.result()
        except concurrent.futures.CancelledError as error:
            raise closed_error() from error
        except BaseException:
            call.cancel()
            raise
        finally:
            self._calls.discard(call)

    def do(self, work: Callable[[], T]) -> T:
        """Return the result of `work`, called in the loop."""

        async def called() -> T:
            return work()

        return self.call(called())

    def close(self) -> None:
        """End the loop with all its tasks, and the thread."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end)
            self._thread.join()

    def _live(self) -> None:
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
        loop = asyncio.get_running_loop()
        self._pause(loop, is_paused=True)
        self._ready.set_result(loop)
        await self._stop.wait()

    def _end(self) -> None:
        self._waiting += 1  # time passes until all has ended
        self._pause(self._loop, is_paused=False)
        self._stop.set()

    async def _count(self, work: Coroutine[Any, Any, T]) -> T:
        self._waiting += 1
        self._pause(self._loop, is_paused=False)
        try:
            return await work
        finally:
            self._waiting -= 1
            self._pause(self._loop, is_paused=not self._waiting)

    @staticmethod
    def _pause(loop: asyncio.AbstractEventLoop, *, is_paused: bool) -> None:
        if isinstance(loop, VirtualTimeLoop):
            loop.pause(is_paused)


def closed_error() -> BusClosedError:
    """Return the error of who uses what is closed."""
    return BusClosedError("the site is closed; open it again with `pointit.open` or `pointit.connect`")
