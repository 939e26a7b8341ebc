"""The bound is what an ideal solver reaches on rays of known scatter."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pointit.evaluation.localization.cramer_rao import (
    effective_sample_count,
    median_bounds_m,
    median_distance,
)
from pointit.evaluation.localization.trial import Array, Trial
from pointit.services.localizer.estimation.estimator import Pointings
from tests.unit.evaluation.recorded import Stand, unit

TARGETS = np.array([[1.7, -2.6, 0.3], [0.8, 1.6, 0.1], [-2.2, 0.4, 0.9], [1.0, 0.2, 0.0]])


FAN = np.array([[1.5, 0.2, 0.0], [3.0, 0.9, 0.1], [2.5, -0.5, 0.3], [4.0, 0.2, 0.4]])
"""All in front: how far away they are is told by elevations alone."""


def trial(
    seed: int, noise_deg: float, *, samples: int = 40, step_s: float = 0.5, places: Array = TARGETS
) -> Trial:
    """One independent ray every half second."""
    stand = Stand(x=-0.4, y=0.3, bias_deg=4.0)
    targets = places[np.arange(samples) % len(places)]
    angles = stand.rays(targets)
    noise = np.random.default_rng(seed).normal(0.0, math.radians(noise_deg), angles.shape)
    noise[:, 0] /= np.cos(angles[:, 1])  # sideways, not in azimuth
    return Trial(
        set="s",
        subject="a",
        condition="c",
        pointings=Pointings(
            np.arange(float(samples)) * step_s,
            np.tile([0.0, 0.0, stand.eyes_m], (samples, 1)),
            unit(angles + noise),
            targets,
        ),
        eye_height_m=stand.eyes_m,
        x_m=stand.x,
        y_m=stand.y,
        yaw_rad=math.radians(stand.yaw_deg),
    )


def errors_of_least_squares(trials: list[Trial]) -> list[float]:
    """Return the position errors of ordinary least squares for x, y, yaw, bias, begun at the truth."""
    from scipy.optimize import least_squares  # noqa: PLC0415 - a second opinion, for this test alone

    def error(one: Trial) -> float:
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


def test_it_grows_with_the_scatter() -> None:
    little = median_bounds_m([trial(seed, 1.0) for seed in range(20)])
    much = median_bounds_m([trial(seed, 2.0) for seed in range(20)])
    assert np.median(much) / np.median(little) == pytest.approx(2.0, rel=0.1)


def test_more_samples_in_the_same_time_do_not_lower_it() -> None:
    sparse = [trial(seed, 2.0, samples=20, step_s=0.4) for seed in range(60)]
    dense = [trial(seed, 2.0, samples=200, step_s=0.04) for seed in range(60)]
    assert effective_sample_count(sparse[0]) == pytest.approx(15.2)
    assert effective_sample_count(dense[0]) == pytest.approx(15.9, abs=0.1)
    assert np.median(median_bounds_m(dense)) == pytest.approx(np.median(median_bounds_m(sparse)), rel=0.15)


def test_each_hold_counts_once_at_least() -> None:
    stamps_s = np.concatenate([start + np.arange(20.0) * 0.02 for start in (0.0, 3.0, 6.0)])
    many = np.tile(TARGETS[:1], (60, 1))
    held = trial(1, 1.0)
    one = Trial(
        set="s", subject="a", condition="c", eye_height_m=1.6, x_m=0.0, y_m=0.0, yaw_rad=0.0,
        pointings=Pointings(stamps_s, many, many, many),
    )  # fmt: skip
    assert effective_sample_count(one) == pytest.approx(3.0)
    assert effective_sample_count(held) == pytest.approx(39.0, abs=1.0)


def test_a_single_target_tells_no_place() -> None:
    one = trial(1, 1.0)
    same = Pointings(
        one.pointings.stamps_s,
        one.pointings.origins_m,
        np.tile(one.pointings.directions[:1], (40, 1)),
        np.tile(TARGETS[:1], (40, 1)),
    )
    lost = Trial(
        set="s", subject="a", condition="c", eye_height_m=1.6, x_m=one.x_m, y_m=one.y_m,
        yaw_rad=one.yaw_rad, pointings=same,
    )  # fmt: skip
    assert median_bounds_m([lost]) == [math.inf]


def test_without_the_truth_or_the_correlation_of_errors_there_is_none() -> None:
    one = trial(1, 1.0)
    assert math.isfinite(median_bounds_m([one])[0])
    assert math.isnan(median_bounds_m([replace(one, yaw_rad=None)])[0])
    assert math.isnan(median_bounds_m([replace(one, independent_hz=None)])[0])


@pytest.mark.parametrize("variances", [(1.0, 1.0), (4.0, 0.0), (2.0, 0.3), (0.0, 0.0)])
def test_the_median_distance_is_that_of_many_draws(variances: tuple[float, float]) -> None:
    drawn = np.random.default_rng(1).normal(size=(200_000, 2)) * np.sqrt(variances)
    expected = float(np.median(np.hypot(drawn[:, 0], drawn[:, 1])))
    assert median_distance(np.array(variances)) == pytest.approx(expected, rel=0.03)
