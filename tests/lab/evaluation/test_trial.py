"""Trials of simulated people, one and many at a time."""

import math
import multiprocessing
import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.errors import PointItError
from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.localization.trial import SLACK_S, STRIDE_S, WINDOWS_S, FollowRecording, Reading
from pointit_lab.evaluation.recordings.parallel import map_parallel
from tests.support.pace import within


def following(stamps_s: list[float]) -> FollowRecording:
    ones = np.ones((len(stamps_s), 3))
    return FollowRecording(
        set="s",
        subject="a",
        pointings=Pointings(np.array(stamps_s), ones, ones, ones),
        heads_m=np.cumsum(ones, axis=0),
        eye_height_m=1.6,
        yaw_rad=None,
    )


@given(st.lists(st.floats(0.0, 60.0), min_size=1, max_size=60))
def test_no_window_is_lost(times: list[float]) -> None:
    stamps_s = sorted(times)
    stamps_s[0] = 0.0
    found = [(trial.condition, trial.pointings.stamps_s.tolist()) for trial in following(stamps_s).trials()]
    wanted: list[tuple[str, list[float]]] = []
    for length_s in WINDOWS_S:
        start_s = 0.0
        while start_s < stamps_s[-1] - length_s + SLACK_S + 1e-9:
            inside = [t for t in stamps_s if start_s <= t < start_s + length_s]
            if len(inside) > 1:
                wanted.append((f"{length_s} s", inside))
            start_s += STRIDE_S
    assert found == wanted


def test_a_gap_of_years_takes_no_time() -> None:
    trials = list(following([0.0, 0.5, 0.9, 1e9, 1e9 + 0.5, 1e9 + 1.1]).trials([1]))
    assert [trial.pointings.stamps_s[0] for trial in trials] == [0.0, 1e9]


def test_who_was_too_short_is_noted() -> None:
    reading = Reading()
    reading.follow(Path("short.csv"), following([0.0, 0.3, 0.6]))
    assert reading.trials == []
    assert reading.notes == [
        "short.csv is skipped: its 3 different samples within 0.6 s fill no window of 1 s"
    ]


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
