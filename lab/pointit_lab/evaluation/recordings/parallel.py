"""Work distributed over processes, which end when it is done, cancelled, or the parent process is gone."""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from typing import TypeVar

from pointit.runtime.errors import PointItError

Piece = TypeVar("Piece")
Result = TypeVar("Result")

END_TIMEOUT_S = 1.0
"""Time to wait for a terminated process."""

_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""One thread per process: the processes use all cores, and more threads would disturb the times."""


def map_parallel(
    work: Callable[[Piece], Result], pieces: Iterable[Piece], jobs: int
) -> Generator[tuple[int, Result]]:
    """Yield the index of each piece and the result of `work`, in order of completion.

    Closing the generator, or an exception in its consumer, ends all processes at once.

    Args:
        work: function of a module other than `__main__`, since each process imports it.
        pieces: picklable arguments.
        jobs: number of processes.

    Raises:
        PointItError: If a process ended unexpectedly.
    """
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)
    others = multiprocessing.active_children()
    finished = False
    try:
        with _for_children():
            futures: dict[Future[Result], int] = {}
            for number, piece in enumerate(pieces):
                futures[pool.submit(work, piece)] = number
        for future in as_completed(futures):
            yield futures[future], future.result()
        finished = True
    except BrokenProcessPool as error:
        raise PointItError(
            "a process of the evaluation ended unexpectedly; is there too little memory for --jobs?"
        ) from error
    finally:
        if not finished:
            ours = [process for process in multiprocessing.active_children() if process not in others]
            for process in ours:
                process.terminate()
            for process in ours:
                process.join(END_TIMEOUT_S)
                if process.is_alive():
                    process.kill()
                    process.join()
            if sys.version_info < (3, 11, 5):  # gh-94777: its thread may wait for ever to write to them
                getattr(pool, "_call_queue")._reader.close()  # noqa: B009, SLF001
        # wait for the pool's thread: at exit Python would wake it by a pipe that it may be closing
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """Leave Ctrl-C to the parent process, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, name="parent watch", daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextlib.contextmanager
def _for_children() -> Generator[None]:
    """Make processes started inside ignore Ctrl-C from the start, and use one thread each."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    # only the main thread may set handlers, and only it receives Ctrl-C
    is_main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN) if is_main else None
    try:
        yield
    finally:
        if is_main:
            signal.signal(signal.SIGINT, handler)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
