"""Run of a task until it ends or a signal arrives, with exit code and a timeout for the end."""

import asyncio
import contextlib
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Coroutine, Generator
from typing import Any

from pointit.runtime.errors import first_cause

EXIT_FAILED = 1
END_TIMEOUT_S = 5.0
"""Time from a signal until the process is killed, s. Ending takes well below 2 s."""
MAX_CROWDING = 12.0
"""Maximum factor of `END_TIMEOUT_S` for machines on which many processes share each core."""
SWITCH_INTERVAL_S = 0.0001
"""Python's thread switch interval: with the default, a busy loop delays Zenoh's threads by tens of ms."""

STARTED_S = 5.0
"""Time after the start at which existing objects are frozen, s. By then a process has created its permanent
objects. Full garbage collections, which block a process of 20 users for about 50 ms, skip frozen objects."""


def exit_with_parent() -> None:
    """End this process when its standard input closes: no child survives a killed parent."""

    def wait() -> None:
        while os.read(sys.stdin.fileno(), 1024):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, name="parent watch", daemon=True).start()


def run_until_shutdown(work: Coroutine[Any, Any, int]) -> int:
    """Run `work` until it ends or Ctrl-C or SIGTERM arrives. Return its exit code.

    A signal cancels the work. The exit code is then 0, since a requested end is no failure. Where Ctrl-C
    would kill the process (`SIG_DFL`), a second one is ignored.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    runner = asyncio.Runner()
    with _cut_off(runner.get_loop()) as cut_off, runner:  # closing the runner waits for threads
        return runner.run(_until_signal(work, cut_off))


async def _until_signal(work: Coroutine[Any, Any, int], cut_off: threading.Timer) -> int:
    loop = asyncio.get_running_loop()
    task = loop.create_task(work, name="main")
    loop.call_later(STARTED_S, gc.freeze)
    asked = False

    def ask() -> None:
        nonlocal asked
        if asked:
            return  # a second Ctrl-C must not cancel the clean-up
        asked = True
        cut_off.start()
        task.cancel()

    with _signals(loop, ask, lambda: asked):
        try:
            return await task
        except asyncio.CancelledError:
            if not asked:
                raise
            return 0
        except BaseExceptionGroup as group:
            raise first_cause(group) from group


@contextlib.contextmanager
def _cut_off(loop: asyncio.AbstractEventLoop) -> Generator[threading.Timer]:
    """Yield a timer that, once started, ends the process if the body takes too long to end."""
    has_ended = threading.Event()

    def end() -> None:
        # a process with a small share of a core is slow, not stuck
        timeout_s = END_TIMEOUT_S * crowding()
        if has_ended.wait(timeout_s - END_TIMEOUT_S):
            return
        names = ", ".join(sorted(task.get_name() for task in asyncio.all_tasks(loop)))
        sys.stderr.write(f"Error: did not end within {timeout_s:.1f} s: {names}\n")
        sys.stderr.flush()
        os._exit(EXIT_FAILED)

    timer = threading.Timer(END_TIMEOUT_S, end)
    timer.daemon = True
    try:
        yield timer
    finally:
        timer.cancel()
        has_ended.set()


def crowding() -> float:
    """Return the number of processes that share a core of this machine, from 1 to `MAX_CROWDING`."""
    try:
        load = os.getloadavg()[0]
    except (AttributeError, OSError):  # Windows has none
        return 1.0
    return min(MAX_CROWDING, max(1.0, load / (os.cpu_count() or 1)))


@contextlib.contextmanager
def _signals(
    loop: asyncio.AbstractEventLoop, ask: Callable[[], None], was_asked: Callable[[], bool]
) -> Generator[None]:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        for number in before:
            loop.add_signal_handler(number, ask)
    except NotImplementedError:  # Windows: asyncio.run turns Ctrl-C into a cancellation by itself
        yield
        return
    try:
        yield
    finally:
        for number, handler in before.items():
            loop.remove_signal_handler(number)
            if was_asked() and number == signal.SIGINT and handler is signal.SIG_DFL:
                # another one must not kill the process before it reports its end
                signal.signal(number, signal.SIG_IGN)
            elif handler is not None:  # a handler that Python did not set
                signal.signal(number, handler)  # a shell starts background processes with SIGINT ignored
