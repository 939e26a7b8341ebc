"""How well a place can be known at best from given rays: what their scatter allows (pointing.md §4).

Written on its own, from azimuths and elevations, so that it shares no mistake with the solver.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from pointit.evaluation.localization.trial import Trial

Array = NDArray[np.float64]

GAP_S = 0.5
"""A longer pause is no time of pointing, and begins another hold."""

BIAS_SIGMA_RAD = math.radians(10.0)
"""One sigma of people's elevation bias, which has to be found too."""


SINGULAR = 1e-12
"""Of the largest eigenvalue of the information: a smaller one is none."""


def median_bounds_m(trials: Sequence[Trial]) -> list[float]:
    """Return for each trial of one subject the median position error of an ideal solver.

    NaN where the truth or the correlation of errors is not known, infinite where the targets do not tell
    the place.

    It would know how much the subject's rays scatter, sideways and upwards, about their mean error in a
    trial, and have no wrong minima: the error linearized at the true pose. Yaw and elevation bias have to be
    found with the place, which is why the mean error does not count.

    Args:
        trials: of one subject and condition, so that the scatter is pooled over all of them.
    """
    if not trials or any(trial.yaw_rad is None or trial.independent_hz is None for trial in trials):
        return [math.nan] * len(trials)
    spread_rad = np.maximum(_scatter(trials), 1e-6)
    return [_median_m(trial, spread_rad) for trial in trials]


def _scatter(trials: Sequence[Trial]) -> Array:
    """Return one sigma of a pointing, sideways and upwards, rad; the mean costs each trial one pointing."""
    squares, freedom = np.zeros(2), 0.0
    for trial in trials:
        count = effective_sample_count(trial)
        squares += count * _misses(trial).var(axis=0)
        freedom += max(count - 1.0, 0.1)
    return np.asarray(np.sqrt(squares / freedom), dtype=np.float64)


def effective_sample_count(trial: Trial) -> float:
    """Return how many independent pointings `trial` has: at least one a hold, at most one a sample."""
    steps = np.diff(trial.pointings.stamps_s)
    pauses = steps > GAP_S
    span_s = float(np.sum(steps[~pauses]))
    return min(
        float(len(trial.pointings)),
        max(1.0 + np.count_nonzero(pauses), (trial.independent_hz or 0.0) * span_s),
    )


def _seen(trial: Trial) -> tuple[Array, Array]:
    """Return where the targets are from the true eyes (n x 3, {W}), and how far over the floor's plan (n)."""
    away = trial.pointings.targets_m - (trial.x_m, trial.y_m, 0.0)
    away[:, 2] -= trial.pointings.origins_m[:, 2]
    return away, np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)


def _misses(trial: Trial) -> Array:
    """Return by how much the rays miss the targets at the true pose: sideways and upwards, n x 2, rad."""
    away, level_m = _seen(trial)
    rays = trial.pointings.directions
    elevations = np.arctan2(rays[:, 2], np.hypot(rays[:, 0], rays[:, 1]))
    turned = np.arctan2(rays[:, 1], rays[:, 0]) + (trial.yaw_rad or 0.0) - np.arctan2(away[:, 1], away[:, 0])
    aside = np.remainder(turned + math.pi, math.tau) - math.pi
    upwards = elevations - np.arctan2(away[:, 2], level_m)
    return np.column_stack([aside * np.cos(elevations), upwards])


def _median_m(trial: Trial, spread_rad: Array) -> float:
    away, level_m = _seen(trial)
    square = level_m**2 + away[:, 2] ** 2
    slope = np.zeros((2, len(away), 4))  # sideways, upwards; by x, y, yaw, bias
    slope[0, :, 0] = away[:, 1] / level_m**2
    slope[0, :, 1] = -away[:, 0] / level_m**2
    slope[0, :, 2] = -1.0
    slope[0] *= (level_m / np.sqrt(square))[:, None]
    slope[1, :, 0] = away[:, 2] * away[:, 0] / (level_m * square)
    slope[1, :, 1] = away[:, 2] * away[:, 1] / (level_m * square)
    slope[1, :, 3] = 1.0
    slope /= spread_rad[:, None, None]
    information = np.einsum("cni,cnj->ij", slope, slope) * (effective_sample_count(trial) / len(away))
    information[3, 3] += 1.0 / BIAS_SIGMA_RAD**2
    values, vectors = np.linalg.eigh(information)
    if values[0] <= SINGULAR * values[-1]:
        return math.inf
    covariance = (vectors / values) @ vectors.T
    return median_distance(np.linalg.eigvalsh(covariance[:2, :2]).astype(np.float64))


def median_distance(variances: Array) -> float:
    """Return the median distance from the mean of a normal distribution with these two variances.

    Its square is taken as gamma distributed with the right mean and variance (Welch and Satterthwaite),
    which is exact for two equal ones and for one that is zero.
    """
    mean = float(np.sum(variances))
    spread = 2.0 * float(np.sum(variances**2))
    if spread == 0.0:
        return 0.0
    return math.sqrt(float(gammaincinv(mean * mean / spread, 0.5)) * spread / mean)
