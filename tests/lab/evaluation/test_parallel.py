"""Work in other processes: all of it is done, and all processes end, whatever happens."""

import math
import multiprocessing
import os
import threading
import time

import pytest

from pointit.runtime.errors import PointItError
from pointit_lab.evaluation.recordings.parallel import map_parallel
from tests.support.pace import within


def assert_all_end() -> None:
    """A process that was killed is gone when the system says so."""
    began = time.monotonic()
    while multiprocessing.active_children():
        assert time.monotonic() - began < 40.0
        time.sleep(0.01)


def test_each_piece_comes_back_with_its_number() -> None:
    assert dict(map_parallel(math.sqrt, [4.0, 9.0, 16.0], 2)) == {0: 2.0, 1: 3.0, 2: 4.0}
    assert_all_end()


def test_who_stops_reading_waits_for_nobody() -> None:
    work = map_parallel(time.sleep, [0.0, 50.0, 50.0, 50.0], 2)
    assert next(work) == (0, None)
    began = time.monotonic()
    work.close()
    assert_all_end()
    assert within(time.monotonic() - began, 40.0)  # nobody slept to the end


def test_no_thread_of_the_pool_is_left_for_the_end_of_python() -> None:
    """There it would be woken by a pipe that it may be closing: a traceback from `threading._shutdown`."""
    before = set(threading.enumerate())
    work = map_parallel(time.sleep, [0.0, 50.0, 50.0, 50.0], 2)
    next(work)
    work.close()
    assert set(threading.enumerate()) <= before


def test_an_error_in_the_work_is_the_readers() -> None:
    with pytest.raises(ValueError, match="math domain"):
        list(map_parallel(math.sqrt, [-1.0], 1))
    assert_all_end()


def test_a_process_that_dies_is_told_in_a_sentence() -> None:
    with pytest.raises(PointItError, match="ended unexpectedly"):
        list(map_parallel(os._exit, [3], 1))
