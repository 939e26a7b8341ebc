"""Work distributed over processes, which end when it is done, cancelled, or the parent process is gone."""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing.connection import wait
from typing import Any, TypeVar

from pointit.runtime.errors import PointItError

Piece = TypeVar("Piece")
Result = TypeVar("Result")

END_TIMEOUT_S = 1.0
"""Time to wait for a terminated process."""

_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""One thread per process: the processes use all cores, and more threads would disturb the times."""


def map_in_order(
    work: Callable[[Piece], Result],
    pieces: Sequence[Piece],
    *,
    jobs: int,
    chunk: int = 1,
    tick: Callable[[int, int], object],
) -> list[Result]:
    """Return the results of `work` on `pieces`, in their order.

    Args:
        work: function of a module other than `__main__`, or such one with some arguments.
        pieces: picklable arguments.
        jobs: number of processes. 1: this one alone, as for a single chunk.
        chunk: pieces that a process does at once.
        tick: called with the number of finished pieces and of all.

    Raises:
        PointItError: If a process ended unexpectedly.
    """
    starts = range(0, len(pieces), chunk)
    chunks = [pieces[start : start + chunk] for start in starts]
    work_all = partial(_work_all, work)
    tick(0, len(pieces))

    # lazily, in this process or in others: `tick` is called as chunks are finished
    numbered_results: Iterable[tuple[int, list[Result]]]
    if jobs == 1 or len(chunks) < 2:
        numbered_results = enumerate(map(work_all, chunks))
    else:
        numbered_results = map_parallel(work_all, chunks, jobs)
    results: dict[int, list[Result]] = {}
    done = 0
    for number, chunk_results in numbered_results:
        results[number] = chunk_results
        done += len(chunk_results)
        tick(done, len(pieces))

    # processes finish in any order
    ordered: list[Result] = []
    for number in range(len(chunks)):
        ordered += results[number]
    return ordered


def _work_all(work: Callable[[Piece], Result], pieces: Sequence[Piece]) -> list[Result]:
    return [work(piece) for piece in pieces]


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
    # spawned: a fork of a process with threads may hang
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin)
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
            children = multiprocessing.active_children()
            workers = [process for process in children if process not in others]
            # all at once, then the wait for each
            for process in workers:
                process.terminate()
            for process in workers:
                process.join(END_TIMEOUT_S)
                if process.is_alive():
                    process.kill()
                    process.join()
            thread: Any = getattr(pool, "_executor_manager_thread")  # noqa: B009
            if sys.version_info < (3, 11, 5) and thread is not None:
                # gh-94777: it may wait for ever to write to them. While it ends, it closes the pipe itself
                thread.join(END_TIMEOUT_S)
                if thread.is_alive():
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
    handler = None
    if is_main:
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
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
