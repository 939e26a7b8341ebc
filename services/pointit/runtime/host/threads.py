"""A blocking call in a thread that nobody waits for at the end: a look-up of a name may take 20 s.

Threads of asyncio's own (`asyncio.to_thread`) are waited for when the loop ends, whether their work is still
wanted or not. What runs here is left behind instead; but Zenoh must not return to a Python that is about to
end, which would abort the process. So a program ends by `exit_now`, and any other process waits at its exit.
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

EXIT_PATIENCE_S = 15.0
"""How long the exit of another process waits for each thread; Zenoh takes 10 s at most."""

_threads: weakref.WeakSet[threading.Thread] = weakref.WeakSet()


async def in_daemon_thread(
    work: Callable[[], T], name: str, *, discard: Callable[[T], None] | None = None
) -> T:
    """Return what `work` returns, or raise what it raises; cancelling does not wait for it.

    Args:
        work: may block for any time.
        name: of its thread.
        discard: gets a result that comes when nobody wants it any more, in a thread, too.
    """
    outcome: Future[T] = Future()

    def run() -> None:
        try:
            result = work()
        except Exception as error:  # noqa: BLE001 - handed over to whoever awaits
            with contextlib.suppress(InvalidStateError):  # nobody does any more
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
    """Return True if a thread is left behind."""
    return any(thread.is_alive() for thread in _threads)


def exit_now(code: int) -> NoReturn:
    """End the process with `code`, at once: what it has to close is closed by now."""
    logging.shutdown()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # nobody reads it any more; it is closed
            stream.flush()
    os._exit(code)


@atexit.register
def _wait() -> None:
    for thread in list(_threads):
        thread.join(EXIT_PATIENCE_S)
