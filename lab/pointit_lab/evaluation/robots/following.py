"""Localization by following a robot: the figure that the robot chooses against a circle and a line.

Simulated people follow each course for the same time, from the same place, with the same errors drawn (one
person a seed), so that the courses are compared in pairs. Recorded people are scored as in `evaluate
localization`.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.services.localizer.estimation.estimator import Pointings
from pointit.services.robot.figure_flight import EYES_M, AssumedPerson, figures
from pointit_lab.evaluation.localization.localization import OURS, Task, solved
from pointit_lab.evaluation.localization.over_people import OverPeople, over_people
from pointit_lab.evaluation.localization.scoring import Outcome, rows_of
from pointit_lab.evaluation.localization.trial import LocalizationTrial
from pointit_lab.evaluation.recordings.row import Row
from pointit_lab.evaluation.robots.simulated_follower import (
    RATE_HZ,
    REACH_S,
    Array,
    Course,
    SimulatedFollower,
)

FIGURE, CIRCLE, LINE = "figure", "circle", "line"
"""Courses, as solvers of the rows."""

DURATION_S = 5.0
CONDITION = f"{DURATION_S:g} s"
SPEED_MPS = 0.8

NEAREST_M, FARTHEST_M = 2.0, 3.5
"""Range of the distance from the assumed place of the person to the robot."""

ASSUMED_SIGMA_M = 0.4
"""Standard deviation, per axis, of the place of a person about the assumed one."""

KEEP_OUT_M = 1.5
"""Distance that the figure keeps from the assumed place."""

HEIGHTS_M = (0.0, 1.2)
"""Height of a ground robot, and of a quadrotor."""

SET = "simulated"


def simulated_rows(seeds: Iterable[int]) -> list[Row]:
    """Return the errors of simulated people who follow a quadrotor and a ground robot, by course."""
    return rows_of([outcome for seed in seeds for outcome in _outcomes(seed)])


def recorded_rows(trials: Sequence[LocalizationTrial]) -> list[Row]:
    """Return the errors of recorded people who followed a robot for `DURATION_S`; nothing is fitted."""
    chosen = [trial for trial in trials if trial.condition == CONDITION]
    return rows_of(solved([Task(trial=trial, solvers=(OURS,)) for trial in chosen]))


def intervals(rows: Sequence[Row]) -> list[OverPeople]:
    """Return the errors over people with 95 % intervals; of courses also as multiples of the figure's.

    Args:
        rows: of one set.
    """
    return over_people(rows, FIGURE)


def of_every_set(rows: Sequence[Row]) -> list[OverPeople]:
    """Return the intervals of each set of `rows`."""
    sets = dict.fromkeys(row.set for row in rows)
    return [outcomes for name in sets for outcomes in intervals([row for row in rows if row.set == name])]


def _outcomes(seed: int) -> list[Outcome]:
    outcomes: list[Outcome] = []
    for kind, height_m in zip(("ground", "quadrotor"), HEIGHTS_M, strict=True):
        rng = np.random.default_rng([seed, round(10 * height_m)])
        way = float(rng.uniform(-math.pi, math.pi))
        reach_m = float(rng.uniform(NEAREST_M, FARTHEST_M))
        start: Vec3 = (reach_m * math.cos(way), reach_m * math.sin(way), height_m)
        x_m, y_m = rng.normal(0.0, ASSUMED_SIGMA_M, 2)
        follower = replace(SimulatedFollower.drawn(rng), x_m=float(x_m), y_m=float(y_m), eyes_m=EYES_M)
        for name, points in _courses(start, is_flying=height_m > 0.0).items():
            trial = _trial(seed, kind, follower, _along(points))
            (outcome,) = solved([Task(trial=trial, solvers=(OURS,))])
            outcomes.append(replace(outcome, solver=name))
    return outcomes


def _courses(start: Vec3, *, is_flying: bool) -> dict[str, Array]:
    """Return courses (n x 3) of equal length from `start`: the circle leads away, the line across."""
    length_m = SPEED_MPS * DURATION_S
    assumed = [AssumedPerson((0.0, 0.0, 0.0), KEEP_OUT_M)]
    best = figures(start, assumed, length_m=length_m, is_flying=is_flying)[0]
    away = np.array([start[0], start[1], 0.0]) / math.hypot(start[0], start[1])
    across = np.array([-away[1], away[0], 0.0])
    turned = np.linspace(0.0, math.tau, 65)[:, None]
    circle = length_m / math.tau * ((1.0 - np.cos(turned)) * away + np.sin(turned) * across)
    line = 0.25 * length_m * np.sin(turned) * across
    return {FIGURE: np.array(best.points_m), CIRCLE: start + circle, LINE: start + line}


def _along(points: Array) -> Course:
    """Return the course along `points` at constant speed, in `DURATION_S` after the reach."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    passed = np.append(0.0, np.cumsum(steps))
    times_s = REACH_S + DURATION_S * passed / passed[-1]

    def at(wanted_s: Array) -> Array:
        columns = [np.interp(wanted_s, times_s, points[:, axis]) for axis in range(3)]
        return np.stack(columns, axis=1)

    return at


def _trial(seed: int, kind: str, follower: SimulatedFollower, course: Course) -> LocalizationTrial:
    """Return the pointing of `follower` at `course`; the reach to the robot does not count."""
    times_s = np.arange(0.0, REACH_S + DURATION_S, 1.0 / RATE_HZ)
    directions = follower.directions(course, times_s, np.random.default_rng(seed))
    counts = times_s > REACH_S
    times_s, directions = times_s[counts], directions[counts]
    origins = np.tile([0.0, 0.0, follower.eyes_m], (len(times_s), 1))
    return LocalizationTrial(
        set=SET,
        subject=f"seed {seed}",
        condition=f"{CONDITION}, {kind}",
        pointings=Pointings(times_s - times_s[0], origins, directions, course(times_s)),
        eye_height_m=follower.eyes_m,
        x_m=follower.x_m,
        y_m=follower.y_m,
        yaw_rad=follower.yaw_rad,
    )
