"""Blocking calls in threads that need not be joined at the end: a name look-up may take 20 s.

Threads of asyncio (`asyncio.to_thread`) are joined when the loop ends, whether their result is still needed
or not. Threads of this module are abandoned. Zenoh, however, must not return to a Python that is shutting
down, which would abort the process. So a program ends by `exit_now`, and any other process waits at exit.
"""

import asyncio
import atexit
import contextlib
import functools
import logging
import os
import sys
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from typing import NoReturn, TypeVar

T = TypeVar("T")
EXIT_TIMEOUT_S = 15.0
"""Time that the exit of another process waits for each thread. Zenoh takes 10 s at most."""

_threads: weakref.WeakSet[threading.Thread] = weakref.WeakSet()


async def in_daemon_thread(
    work: Callable[[], T], name: str, *, discard: Callable[[T], None] | None = None
) -> T:
    """Return the result of `work`, or raise its error. Cancelling does not wait for it.

    `discard` gets, also in a thread, a result that arrives after cancellation.
    """
    outcome: Future[T] = Future()

    def run() -> None:
        try:
            result = work()
        except Exception as error:  # noqa: BLE001 - passed to the awaiting caller
            with contextlib.suppress(InvalidStateError):  # cancelled meanwhile
                outcome.set_exception(error)
            return
        try:
            outcome.set_result(result)
        except InvalidStateError:
            if discard is not None:
                discard(result)

    _start(run, name)
    try:
        return await asyncio.wrap_future(outcome)
    except asyncio.CancelledError:
        # it may have come already, and we were cancelled before the loop handed it over
        is_late = not outcome.cancel() and outcome.exception() is None
        if is_late and discard is not None:
            _start(functools.partial(discard, outcome.result()), name)
        raise


def _start(run: Callable[[], None], name: str) -> None:
    thread = threading.Thread(target=run, name=name, daemon=True)
    _threads.add(thread)
    thread.start()


def has_running_threads() -> bool:
    """Return True if an abandoned thread is still running."""
    return any(thread.is_alive() for thread in _threads)


def exit_now(code: int) -> NoReturn:
    """End the process at once with `code`. All resources must be closed by now."""
    logging.shutdown()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # the stream is closed, or its reader is
            stream.flush()
    os._exit(code)


@atexit.register
def _wait() -> None:
    for thread in list(_threads):
        thread.join(EXIT_TIMEOUT_S)
