"""Cramér-Rao bound of a position from rays with a given scatter (pointing.md §4).

Implemented separately, from azimuths and elevations, so that it shares no error with the solver.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from pointit.evaluation.localization.trial import Trial

Array = NDArray[np.float64]

GAP_S = 0.5
"""Pause that ends a hold and does not count as pointing."""

BIAS_SIGMA_RAD = math.radians(10.0)
"""One sigma of people's elevation bias, which is estimated as well."""


SINGULAR = 1e-12
"""Eigenvalues of the information below this share of the largest one count as zero."""


def median_bounds_m(trials: Sequence[Trial]) -> list[float]:
    """Return for each trial of one subject the median position error of an ideal solver.

    NaN if the truth or the correlation of errors is unknown, infinite if the targets do not determine the
    position.

    The ideal solver knows the scatter of the subject's rays about their mean error in a trial, sideways and
    upwards, and has no wrong minima: the error is linearized at the true pose. Yaw and elevation bias are
    estimated with the position, so the mean error does not count.

    Args:
        trials: trials of one subject and condition, over which the scatter is pooled.
    """
    if not trials or any(trial.yaw_rad is None or trial.independent_hz is None for trial in trials):
        return [math.nan] * len(trials)
    spread_rad = np.maximum(_scatter(trials), 1e-6)
    return [_median_m(trial, spread_rad) for trial in trials]


def _scatter(trials: Sequence[Trial]) -> Array:
    """Return one sigma of a pointing, sideways and upwards, rad; the mean uses up one pointing per trial."""
    squares, freedom = np.zeros(2), 0.0
    for trial in trials:
        count = effective_sample_count(trial)
        squares += count * _misses(trial).var(axis=0)
        freedom += max(count - 1.0, 0.1)
    return np.asarray(np.sqrt(squares / freedom), dtype=np.float64)


def effective_sample_count(trial: Trial) -> float:
    """Return the number of independent pointings: at least one per hold, at most one per sample."""
    steps = np.diff(trial.pointings.stamps_s)
    pauses = steps > GAP_S
    span_s = float(np.sum(steps[~pauses]))
    return min(
        float(len(trial.pointings)),
        max(1.0 + np.count_nonzero(pauses), (trial.independent_hz or 0.0) * span_s),
    )


def _seen(trial: Trial) -> tuple[Array, Array]:
    """Return vectors from the true eyes to the targets (n x 3, {W}), and their horizontal lengths (n)."""
    away = trial.pointings.targets_m - (trial.x_m, trial.y_m, 0.0)
    away[:, 2] -= trial.pointings.origins_m[:, 2]
    return away, np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)


def _misses(trial: Trial) -> Array:
    """Return the angular errors of the rays at the true pose: sideways and upwards, n x 2, rad."""
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

    Its square is approximated by a gamma distribution of equal mean and variance (Welch and Satterthwaite),
    which is exact for two equal variances and if one is zero.
    """
    mean = float(np.sum(variances))
    spread = 2.0 * float(np.sum(variances**2))
    if spread == 0.0:
        return 0.0
    return math.sqrt(float(gammaincinv(mean * mean / spread, 0.5)) * spread / mean)
