"""The bound is what an ideal solver reaches on rays of known scatter."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pointit.geometry.array_types import Array
from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.datasets import read_trials
from pointit_lab.evaluation.localization.cramer_rao import median_bounds_m, median_distance
from pointit_lab.evaluation.localization.localization import localization_rows
from pointit_lab.evaluation.localization.trial import LocalizationTrial
from tests.support import there
from tests.support.data import data_file
from tests.support.published_recordings import Stand, unit

TARGETS = np.array([[1.7, -2.6, 0.3], [0.8, 1.6, 0.1], [-2.2, 0.4, 0.9], [1.0, 0.2, 0.0]])


FAN = np.array([[1.5, 0.2, 0.0], [3.0, 0.9, 0.1], [2.5, -0.5, 0.3], [4.0, 0.2, 0.4]])
"""All in front: how far away they are is told by elevations alone."""


def trial(
    seed: int, noise_deg: float, *, samples: int = 40, step_s: float = 0.5, places: Array = TARGETS
) -> LocalizationTrial:
    """One independent ray every half second."""
    stand = Stand(x=-0.4, y=0.3, bias_deg=4.0)
    targets = places[np.arange(samples) % len(places)]
    angles = stand.rays(targets)
    noise = np.random.default_rng(seed).normal(0.0, math.radians(noise_deg), angles.shape)
    noise[:, 0] /= np.cos(angles[:, 1])  # sideways, not in azimuth
    stamps_s = np.arange(float(samples)) * step_s
    origins_m = np.tile([0.0, 0.0, stand.eyes_m], (samples, 1))
    return LocalizationTrial(
        set="s", subject="a", condition="c", eye_height_m=stand.eyes_m, x_m=stand.x, y_m=stand.y,
        pointings=Pointings(stamps_s, origins_m, unit(angles + noise), targets),
        yaw_rad=math.radians(stand.yaw_deg),
    )  # fmt: skip


def errors_of_least_squares(trials: list[LocalizationTrial]) -> list[float]:
    """Return the position errors of ordinary least squares for x, y, yaw, bias, begun at the truth."""
    from scipy.optimize import least_squares  # noqa: PLC0415 - a second opinion, for this test alone

    def error(one: LocalizationTrial) -> float:
        rays = one.pointings.directions
        azimuths = np.arctan2(rays[:, 1], rays[:, 0])
        elevations = np.arcsin(rays[:, 2])
        eyes_m = one.pointings.origins_m[:, 2]

        def misses(pose: np.ndarray) -> np.ndarray:
            away = one.pointings.targets_m - [pose[0], pose[1], 0.0]
            seen = np.arctan2(away[:, 1], away[:, 0]) - pose[2]
            up = np.arctan2(away[:, 2] - eyes_m, np.hypot(away[:, 0], away[:, 1])) + pose[3]
            turned = np.remainder(azimuths - seen + np.pi, 2.0 * np.pi) - np.pi
            return np.concatenate([turned * np.cos(elevations), elevations - up])

        found = least_squares(misses, [one.x_m, one.y_m, one.yaw_rad or 0.0, 0.0]).x
        return float(np.hypot(found[0] - one.x_m, found[1] - one.y_m))

    return [error(one) for one in trials]


@pytest.mark.parametrize("places", [TARGETS, FAN])
def test_least_squares_reaches_the_bound_and_not_more(places: Array) -> None:
    trials = [trial(seed, 1.0, places=places) for seed in range(200)]
    bound_m = float(np.median(median_bounds_m(trials)))
    reached_m = float(np.median(errors_of_least_squares(trials)))
    assert bound_m == pytest.approx(reached_m, rel=0.15)


def held(seed: int, count: int, *, bias_deg: float = 0.0, noise_deg: float = 1.0) -> LocalizationTrial:
    """One ray at each of two lamps, in each of `count` equal samples."""
    one = trial(seed, noise_deg, samples=2)
    rows = np.repeat(np.arange(2), count)
    angles = np.column_stack(
        [np.arctan2(*one.pointings.directions.T[1::-1]), np.arcsin(one.pointings.directions[:, 2])]
    )
    angles[:, 1] += math.radians(bias_deg)
    stamps_s = (np.arange(2.0)[:, None] * 4.0 + np.arange(count) * 0.05).ravel()
    return replace(
        one,
        pointings=Pointings(
            stamps_s, one.pointings.origins_m[rows], unit(angles)[rows], one.pointings.targets_m[rows]
        ),
    )


def test_more_samples_of_a_hold_do_not_lower_it() -> None:
    few = median_bounds_m([held(seed, 5) for seed in range(40)])
    many = median_bounds_m([held(seed, 40) for seed in range(40)])
    assert np.median(many) == pytest.approx(np.median(few), rel=0.01)


def test_bias_that_differs_between_trials_is_one_unknown() -> None:
    """It costs something, but far less than errors of that size at each lamp."""
    drawn = np.random.default_rng(5).normal(0.0, 8.0, 60).tolist()
    unbiased = [held(seed, 5, bias_deg=-4.0, noise_deg=0.2) for seed in range(60)]
    varied = [held(seed, 5, bias_deg=bias - 4.0, noise_deg=0.2) for seed, bias in enumerate(drawn)]
    at_each = [held(seed, 5, bias_deg=-4.0, noise_deg=8.0) for seed in range(60)]
    known_m, varied_m, at_each_m = (
        float(np.median(median_bounds_m(trials))) for trials in (unbiased, varied, at_each)
    )
    assert 1.1 * known_m < varied_m < 0.1 * at_each_m


def test_without_the_true_yaw_there_is_none() -> None:
    one = trial(1, 1.0)
    known, unknown = median_bounds_m([one, replace(one, yaw_rad=None)])
    assert math.isfinite(known)
    assert math.isnan(unknown)


@pytest.mark.long
@pytest.mark.parametrize("name", ["motion_relloc", "proximity_waypoints"])
def test_our_solver_is_not_better_on_recorded_people(name: str) -> None:
    trials = read_trials(data_file(f"recordings/{name}").parent, [name]).trials
    rows = localization_rows(trials[::5], baselines=False, jobs=2, tick=lambda _done, _of: None)
    compared = [row for row in rows if row.bound_m is not None and row.position_m is not None and row.n >= 10]
    assert len(compared) >= 6
    for row in compared:
        assert row.bound_m is not None
        assert there(row.position_m).median >= row.bound_m, (row.condition, row.subject)


@pytest.mark.parametrize("variances", [(1.0, 1.0), (4.0, 0.0), (2.0, 0.3), (0.0, 0.0)])
def test_the_median_distance_is_that_of_many_draws(variances: tuple[float, float]) -> None:
    drawn = np.random.default_rng(1).normal(size=(200_000, 2)) * np.sqrt(variances)
    expected = float(np.median(np.hypot(drawn[:, 0], drawn[:, 1])))
    assert median_distance(np.array(variances)) == pytest.approx(expected, rel=0.03)
