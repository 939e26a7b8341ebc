"""Solvers beside each other: what the rows say, and that other processes do the work."""

import dataclasses
import math
import multiprocessing
import os
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.errors import PointItError
from pointit.services.localizer.estimation.estimator import Pointings, Refusal, Solution, SolverSettings
from pointit_lab.evaluation.datasets import read_trials
from pointit_lab.evaluation.honesty.simulated_people import followers
from pointit_lab.evaluation.localization.localization import (
    BASELINE_TRIALS,
    OURS,
    SOLVERS,
    judged,
    localization_rows,
)
from pointit_lab.evaluation.localization.scoring import UNTIL, Key, Outcome, rows_of, until_taken_rows
from pointit_lab.evaluation.localization.trial import (
    SLACK_S,
    STRIDE_S,
    WINDOWS_S,
    FollowRecording,
    TrialReading,
)
from pointit_lab.evaluation.recordings.parallel import map_parallel
from pointit_lab.evaluation.recordings.row import Row
from tests.support import there
from tests.support.data import data_file
from tests.support.pace import within
from tests.support.published_recordings import Stand, write_acts, write_track


def outcome(
    error_m: float = 0.1,
    *,
    sigma_m: float = 0.2,
    yaw_deg: float = 2.0,
    subject: str = "a",
    condition: str = "2 s",
    solver: str = OURS,
    refused: str = "",
    bound_m: float = math.nan,
) -> Outcome:
    return Outcome(
        key=Key(set="s", subject=subject, condition=condition), solver=solver, solve_ms=3.0,
        refused=refused, position_m=math.nan if refused else error_m,
        yaw_deg=math.nan if refused else yaw_deg, position_sigma_m=math.nan if refused else sigma_m,
        yaw_sigma_deg=math.nan if refused else 1.5, bound_m=bound_m,
    )  # fmt: skip


def silent(done: int, of: int) -> None:
    """Say nothing."""
    del done, of


def row(rows: Sequence[Row], **wanted: str) -> Row:
    found = [row for row in rows if all(getattr(row, name) == value for name, value in wanted.items())]
    assert len(found) == 1, (wanted, found)
    return found[0]


def test_a_row_sums_up_what_was_accepted() -> None:
    outcomes = [
        outcome(0.1, bound_m=0.2),
        outcome(0.3, yaw_deg=-2.0, bound_m=0.3),
        outcome(0.5, yaw_deg=4.0, bound_m=math.inf),
        outcome(1.2, sigma_m=0.4),
        outcome(refused="too few rays"),
    ]
    only = row(rows_of(outcomes), subject="a")
    assert (only.n, only.refused) == (5, 1)
    assert there(only.position_m).median == pytest.approx(0.4)
    assert (there(only.yaw_deg).median, only.share_above_1m) == pytest.approx((2.0, 1 / 4))
    assert only.misled == pytest.approx(1 / 4)
    assert there(only.every_m).median == pytest.approx(0.4)  # the refused one had no pose at all
    assert (only.within_2_sigma, only.yaw_within_2_sigma) == pytest.approx((2 / 4, 3 / 4))
    assert only.bound_m == pytest.approx(0.25)
    assert there(only.solve_ms).median == 3.0


def at(start_s: float, window_s: int, error_m: float, *, taken: bool) -> Outcome:
    found = outcome(error_m, condition=f"{window_s} s")
    return dataclasses.replace(found, recording="r", start_s=start_s, taken_m=error_m if taken else math.inf)


def test_share_of_taken_poses_over_a_metre_off_is_reported() -> None:
    outcomes = [at(0.0, 2, 0.4, taken=True), at(1.0, 2, 1.5, taken=True), at(2.0, 2, 1.6, taken=False)]
    assert rows_of(outcomes)[0].taken_above_1m == 0.5


def test_share_of_taken_poses_and_time_until_taken_are_reported() -> None:
    outcomes = [
        *(at(0.0, window_s, 0.1 * window_s, taken=window_s >= 3) for window_s in (2, 3, 10)),
        *(at(1.0, window_s, 0.1 * window_s, taken=window_s >= 2) for window_s in (2, 3, 10)),
        *(at(2.0, window_s, 0.1 * window_s, taken=window_s >= 3) for window_s in (2, 3, 10)),
        at(3.0, 2, 9.0, taken=True),  # the recording ends too soon
    ]
    short = row(rows_of(outcomes), subject="a", condition="2 s")
    assert short.taken == pytest.approx(2 / 4)
    until = row(until_taken_rows(outcomes), subject="all", condition=UNTIL)
    assert (until.n, until.taken, until.until_taken_s) == (3, 1.0, 3.0)
    assert there(until.taken_m).median == pytest.approx(0.3)
    assert there(until.taken_m).rms == pytest.approx(math.sqrt((0.3**2 + 0.2**2 + 0.3**2) / 3))


def test_median_time_until_taken_is_none_when_few_are_taken() -> None:
    found = until_taken_rows([at(float(start), 10, 0.1, taken=start == 0) for start in range(3)])
    until = row(found, subject="all", condition=UNTIL)
    assert (until.n, until.until_taken_s) == (3, None)
    assert until.taken == pytest.approx(1 / 3)


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    """Results of all solvers for one person with a bias, computed in other processes."""
    folder = tmp_path_factory.mktemp("recordings")
    write_track(folder, Stand(bias_deg=-14.0, noise_deg=0.5), duration_s=9.0)
    ticks: list[tuple[int, int]] = []
    trials = read_trials(folder).trials
    found = localization_rows(trials, baselines=True, jobs=2, tick=lambda done, of: ticks.append((done, of)))
    assert (ticks[0], ticks[-1], ticks) == ((0, len(trials)), (len(trials), len(trials)), sorted(ticks))
    return found


def test_each_solver_has_its_row(rows: list[Row]) -> None:
    assert {row.solver for row in rows} == set(SOLVERS) == {"pointit", "mean-angle-4dof", "mean-angle-z0"}
    assert {row.subject for row in rows} == {"all", "user9"}
    assert {row.condition for row in rows} == {"1 s", "2 s", "3 s", "5 s", "8 s"}  # too short for `UNTIL`
    taken = {row.condition: row.taken for row in rows if row.solver == OURS and row.subject == "all"}
    assert (taken["8 s"], taken["1 s"]) == (1.0, 0.0)
    assert all(row.taken is None for row in rows if row.solver != OURS)


def test_bias_is_metres_for_the_original_but_not_for_ours(rows: list[Row]) -> None:
    ours = row(rows, subject="all", condition="8 s", solver=OURS)
    original = row(rows, subject="all", condition="8 s", solver="mean-angle-z0")
    assert there(ours.position_m).median < 0.3 < there(original.position_m).median
    assert there(ours.yaw_deg).median < 4.0
    assert ours.within_2_sigma == 1.0
    assert ours.bound_m is not None
    assert 0.0 < ours.bound_m < 0.3


def test_baselines_solve_some_of_the_trials_ours_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pointit_lab.evaluation.localization.localization.BASELINE_TRIALS", 5)
    assert BASELINE_TRIALS >= 100
    write_acts(tmp_path, {"1": (1.7, Stand())})
    trials = [
        trial for trial in read_trials(tmp_path).trials if trial.condition in {"2 targets", "3 targets"}
    ]
    found = localization_rows(trials, baselines=True, jobs=1, tick=silent)
    counts = {(row.condition, row.solver): row.n for row in found if row.subject == "all"}
    assert counts == {(f"{n} targets", s): 100 if s == OURS else 5 for n in (2, 3) for s in SOLVERS}


def test_published_recordings_are_solved_sensibly() -> None:
    folder = data_file("recordings/proximity_waypoints")
    trials = [trial for trial in read_trials(folder.parent, [folder.name]).trials if trial.condition == "8 s"]
    found = localization_rows(trials, baselines=True, jobs=2, tick=silent)
    ours = row(found, subject="all", solver=OURS)
    assert there(ours.position_m).median < 1.0
    assert ours.refused is not None
    assert ours.refused < ours.n / 2


def following(stamps_s: list[float]) -> FollowRecording:
    ones = np.ones((len(stamps_s), 3))
    return FollowRecording(
        set="s", subject="a", pointings=Pointings(np.array(stamps_s), ones, ones, ones),
        heads_m=np.cumsum(ones, axis=0), eye_height_m=1.6, yaw_rad=None,
    )  # fmt: skip


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


def test_too_short_recording_is_skipped_and_noted() -> None:
    reading = TrialReading()
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


def test_parallel_map_that_is_closed_early_ends_its_workers() -> None:
    work = map_parallel(time.sleep, [0.0, 50.0, 50.0, 50.0], 2)
    assert next(work) == (0, None)
    began = time.monotonic()
    work.close()
    assert_all_end()
    assert within(time.monotonic() - began, 40.0)  # nobody slept to the end


def test_closed_parallel_map_leaves_no_thread_behind() -> None:
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


def test_pose_followed_for_less_than_the_localizer_waits_is_refused() -> None:
    (follower,) = followers([8])
    (short,), (long,) = (list(follower.trials((seconds,)))[:1] for seconds in (1.4, 10.0))
    assert isinstance(judged(long.pointings), Solution)
    refusal = judged(short.pointings, SolverSettings().unlimited())
    assert isinstance(refusal, Refusal)
    assert refusal.reason == "followed for less than 1.5 s"
