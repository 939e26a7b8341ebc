"""Yaw error of a drifting IMU while the person points at a known position from time to time.

Recorded: `proximity_feedback`. Its people point at three positions in turn, one every 45 s, and their heading
was measured again before each such run. Only holds without a cursor count, as anchors and as truth: the yaw
of a hold is the azimuth of its target minus that of the ray, so that the person's own scatter is in every
error (row `scatter of one hold`). For longer times the runs of one person are chained in every order: the
next run continues, in time and in yaw, where the last one ended, without the time between them; such
chains are not independent of each other. `3 min, 1 anchor/min` comes from such chains only, those of four
people with three runs, in each order, so that its n counts chains and not people; its anchors are the
holds nearest to 0, 1 and 2 minutes, the last of them mostly 45 s before the predicted hold. The targets
always came in the same order, so a compressed sense of azimuth would look like drift here; the change of yaw
within single holds is evidence for drift.

Simulated: seeded people with a drifting IMU, whose true yaw is known.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets import proximity_feedback
from pointit_lab.evaluation.datasets.proximity_feedback import FloorTrial, read_floor_trials
from pointit_lab.evaluation.pointing import drift_simulated
from pointit_lab.evaluation.pointing.drift_courses import chained, courses, hold_sigma_rad
from pointit_lab.evaluation.pointing.drift_simulated import normal_row, simulated_rows
from pointit_lab.evaluation.pointing.drift_solvers import (
    PLAIN,
    SOLVERS,
    DriftTrial,
    YawEstimate,
    predictable,
    ratios,
)
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row, arranged

SETS = (proximity_feedback.NAME, drift_simulated.NAME)

PEOPLE = 300

CHAINED = "3 min, 1 anchor/min"
"""Condition with chained runs."""

CONDITIONS = (
    ("45 s, 1 anchor", (0.0,), 45.0),
    ("90 s, 1 anchor", (0.0,), 90.0),
    ("90 s, 2 anchors", (0.0, 45.0), 90.0),
    (CHAINED, (0.0, 60.0, 120.0), 180.0),
)
"""Name, times of the anchors and time of the predicted hold, s."""

CHAINS_REMARK = (
    f"`{CHAINED}` of {proximity_feedback.NAME}: the runs of each of four people chained in every order, n "
    "counts chains; the last anchor is mostly 45 s before the hold that is told."
)


def drift_rows(
    recordings: Path, sets: Sequence[str], subjects: Sequence[str], tick: Callable[[str], None]
) -> list[Row]:
    """Return yaw errors after some time, of recorded people if there are recordings, and of simulated ones.

    Args:
        recordings: folder with one folder per set.
        sets: those of `SETS` to evaluate. Empty: all.
        subjects: subjects whose rows to return. Empty: all, and the rows over all.
        tick: called with a short description of the current step.

    Raises:
        ConfigError: If a file is damaged, the set is not present, or there is no data of these subjects.
    """
    selected_sets = tuple(sets) or SETS
    rows: list[Row] = []
    folder = recordings / proximity_feedback.NAME
    if proximity_feedback.NAME in selected_sets:
        if not folder.is_dir():
            raise ConfigError(f"{recordings}: has no folder {proximity_feedback.NAME}")
        tick("drift: reading recordings")
        rows += recorded_rows(read_floor_trials(folder), tick)
    if drift_simulated.NAME in selected_sets:
        tick(f"drift: {PEOPLE} simulated people")
        rows += simulated_rows(PEOPLE)

    # subjects are known only from the rows
    known = dict.fromkeys(row.subject for row in rows)
    for subject in subjects:
        if subject not in known:
            names = ", ".join(known)
            raise ConfigError(f"{recordings}: has no subject {subject!r}; there are {names}")
    if subjects:
        rows = [row for row in rows if row.subject in subjects]
    return arranged(rows)


def recorded_rows(trials: Sequence[FloorTrial], tick: Callable[[str], None]) -> list[Row]:
    """Return the rows of recorded people: within the runs, and with a person's runs chained."""
    runs = courses(trials)
    chains = list(chained(runs))
    sigma_rad = hold_sigma_rad(runs)
    rows: list[Row] = []
    for condition, anchors_s, predicted_s in CONDITIONS:
        sequences = chains if condition == CHAINED else runs
        drift_trials = predictable(sequences, anchors_s, predicted_s)
        tick(f"drift: {condition}")
        rows += _rows(condition, drift_trials, sigma_rad)
    return rows


def _rows(condition: str, trials: Sequence[DriftTrial], sigma_rad: float) -> list[Row]:
    """Return a row for each person and solver, and for all people together."""
    rows: list[Row] = []
    by_solver: dict[str, list[tuple[DriftTrial, YawEstimate]]] = {}
    for name, solver in SOLVERS.items():
        estimates: list[tuple[DriftTrial, YawEstimate]] = []
        for trial in trials:
            estimates.append((trial, solver(trial.course, trial.anchors, trial.told)))
        by_solver[name] = estimates
    # after all are solved: each is compared with the plain one
    for name, estimates in by_solver.items():
        rows += _solver_rows(condition, name, estimates, by_solver[PLAIN], sigma_rad)
    if trials:
        scatter = normal_row(
            proximity_feedback.NAME, condition, "scatter of one hold", len(trials), sigma_rad
        )
        rows.append(scatter)
    return rows


def _solver_rows(
    condition: str,
    solver: str,
    estimates: Sequence[tuple[DriftTrial, YawEstimate]],
    plain_estimates: Sequence[tuple[DriftTrial, YawEstimate]],
    sigma_rad: float,
) -> list[Row]:
    subjects = [trial.course.subject for trial, _ in estimates]
    errors_rad = [trial.error_rad(estimate) for trial, estimate in estimates]

    # over people, as multiples of plain re-anchoring
    times_plain = None
    if estimates and solver != PLAIN:
        plain_errors_rad = [trial.error_rad(estimate) for trial, estimate in plain_estimates]
        times_plain = ratios(subjects, errors_rad, plain_errors_rad)

    rows: list[Row] = []
    for subject in (*dict.fromkeys(subjects), ALL):
        own_errors_rad: list[float] = []
        within: list[bool] = []
        for (trial, estimate), error_rad in zip(estimates, errors_rad, strict=True):
            if subject not in {trial.course.subject, ALL}:
                continue
            own_errors_rad.append(error_rad)
            # the predicted hold scatters, too
            if estimate.sigma_rad is not None:
                total_sigma_rad = math.hypot(estimate.sigma_rad, sigma_rad)
                is_within = abs(error_rad) <= 2.0 * total_sigma_rad
                within.append(is_within)
        yaw_within_2_sigma = None
        if within:
            yaw_within_2_sigma = float(np.mean(within))
        row = Row(
            set=proximity_feedback.NAME,
            subject=subject,
            condition=condition,
            solver=solver,
            n=len(own_errors_rad),
            yaw_deg=MetricSpread.of(map(math.degrees, own_errors_rad)),
            yaw_within_2_sigma=yaw_within_2_sigma,
            times_plain=times_plain if subject == ALL else None,
        )
        rows.append(row)
    return rows
