"""Posterior Cramér-Rao bound of a position from rays (van Trees 1968; Tichavský et al. 1998).

No linear estimate has a smaller mean squared error on average over errors with the second moments assumed
here, and no estimate at all if they are normal. It bounds the mean square: the median returned is that of
normal errors, which a median of heavy-tailed ones may be below. No solver here has beaten it.

The moments are those of the people themselves, so that who knows less beforehand cannot do better. Elevation
bias, slopes and latency of a recording are known but for one number: how much of them shows. The scatter
about them has its own correlation in time, and in each trial its own size. The place has the distance from
the targets that it has in the set; eyes are where the truth has them. (With the solver's
priors instead, a solver does better for people who err less than these say.)

Linearized at the true pose; implemented separately from the solver, in azimuths and elevations, so that they
share no error.

H. L. van Trees: Detection, Estimation, and Modulation Theory, part I, §2.4. Wiley, 1968.
P. Tichavský, C. H. Muravchik, A. Nehorai: Posterior Cramér-Rao bounds for discrete-time nonlinear filtering.
IEEE Transactions on Signal Processing 46(5), 1998.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, toeplitz
from scipy.special import gammaincinv

from pointit.geometry.array_types import Array
from pointit.services.localizer.estimation.pointings import BLOCK_S, STILL_M, blocks
from pointit_lab.evaluation.localization.trial import LocalizationTrial

BIAS, ELEVATION_SLOPE, AZIMUTH_SLOPE, LATENCY = range(3, 7)
"""Columns of what is constant in a person: rad, 1, 1, s; before them x, y and yaw."""
COLUMNS = 7

LARGE_SIGMAS = np.array([math.radians(20.0), 0.5, 0.5, 0.3])
"""Standard deviations of these that keep what a recording does not tell at 0."""

MIN_RAD = 1e-5
"""Lower bound of a scatter."""

MIN_AWAY_M = 0.1
"""Lower bound of the distance of places from the targets."""

MAX_CORRELATION = 0.999
"""Upper bound of the correlation of errors at two lamps."""

ROUNDING = 1e-9
"""Share of the scatter that keeps its covariance from being singular."""

LONG = 0.75
"""Span of the trials that tell a person's errors, as a share of the longest one."""

SAME_STEP = 1.05
"""Ratio of the blocks' length to `BLOCK_S` up to which they are as short as blocks can be."""


@dataclass(frozen=True)
class _Linearized:
    """A trial at its true pose: one row a block of following, or a lamp."""

    misses: Array
    """2 x m: errors of the rays sideways and upwards, rad."""
    slopes: Array
    """2 x m x `COLUMNS`: derivatives of the errors."""
    hold: NDArray[np.intp]
    """m: hold of each row, 0 for lamps; errors of different holds are independent."""
    step_s: float
    """Time from block to block; 0 of lamps."""
    span_s: float
    """Time of pointing."""
    away_m: float
    """Distance of the place from the middle of the targets."""


@dataclass(frozen=True)
class _Errors:
    """Errors of a person in one recording."""

    constants: Array
    """Bias, slopes and latency, 4."""
    turned_rad: float
    """Mean error sideways."""
    step_s: float
    correlation: Array
    """2 x lags: autocorrelation of the rest within a hold at multiples of `step_s`, sideways and upwards. Of
    lamps: of one with itself, and with another."""

    def rest(self, linearized: _Linearized) -> Array:
        """Return the errors (2 x m) of `linearized` without the constant ones."""
        rest = linearized.misses - linearized.slopes[:, :, BIAS:] @ self.constants
        rest[0] -= self.turned_rad
        return rest


def median_bounds_m(trials: Sequence[LocalizationTrial]) -> list[float]:
    """Return for each of `trials`, all of one set, the median position error of an ideal solver.

    NaN if the true yaw is unknown.
    """
    bounds_m = [math.nan] * len(trials)
    linear: dict[int, _Linearized] = {}
    for number, trial in enumerate(trials):
        if trial.yaw_rad is not None:
            linear[number] = _linearized(trial)
    if not linear:
        return bounds_m

    # what is known of the place before any ray: about as far from the targets as people usually are
    mean_square_m2 = float(np.mean([linearized.away_m**2 for linearized in linear.values()]))
    place = 2.0 / max(mean_square_m2, MIN_AWAY_M**2)

    # errors are those of a person in one recording
    groups: dict[tuple[str, ...], list[int]] = {}
    for number, linearized in linear.items():
        trial = trials[number]
        scenario = (
            "" if linearized.step_s else trial.condition
        )  # acts at lamps: each number of lamps by itself
        groups.setdefault((trial.subject, trial.recording, scenario), []).append(number)
    for numbers in groups.values():
        errors = _errors([linear[number] for number in numbers])
        for number in numbers:
            bounds_m[number] = _median_m(linear[number], errors, place)
    return bounds_m


def _linearized(trial: LocalizationTrial) -> _Linearized:
    summary = blocks(trial.pointings)
    means = summary.pointings
    hold = summary.hold.astype(np.intp)
    if summary.is_still:  # the bound takes visits of one lamp as independent
        steps_m = np.diff(means.targets_m, axis=0, prepend=means.targets_m[:1])
        moves_m = np.abs(steps_m).max(axis=1)
        hold = np.cumsum(moves_m > STILL_M)

    # directions from the true place to the targets
    away = means.targets_m - (trial.x_m, trial.y_m, 0.0)
    away[:, 2] -= means.origins_m[:, 2]
    level_m = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)
    square = level_m**2 + away[:, 2] ** 2
    azimuths = np.arctan2(away[:, 1], away[:, 0])
    elevations = np.arctan2(away[:, 2], level_m)

    # how far the rays miss them
    rays = means.directions
    ray_azimuths = np.arctan2(rays[:, 1], rays[:, 0])
    ray_elevations = np.arctan2(rays[:, 2], np.hypot(rays[:, 0], rays[:, 1]))
    turned = ray_azimuths + (trial.yaw_rad or 0.0) - azimuths
    aside = _wrapped(turned)
    upwards = ray_elevations - elevations

    # derivatives of the misses by the parameters; sideways they shrink with the elevation
    flat = np.cos(elevations)
    middle = float(np.angle(np.exp(1j * azimuths).mean()))
    gradients = np.zeros((2, len(away), 3))  # of azimuth and elevation, by the target's place
    gradients[0, :, 0] = -away[:, 1] / level_m**2
    gradients[0, :, 1] = away[:, 0] / level_m**2
    divisor = level_m * square
    gradients[1, :, 0] = -away[:, 2] * away[:, 0] / divisor
    gradients[1, :, 1] = -away[:, 2] * away[:, 1] / divisor
    gradients[1, :, 2] = level_m / square
    slopes = np.zeros((2, len(away), COLUMNS))
    slopes[:, :, :2] = -gradients[:, :, :2]
    slopes[0, :, 2] = -1.0
    slopes[1, :, BIAS] = 1.0
    slopes[1, :, ELEVATION_SLOPE] = elevations
    slopes[0, :, AZIMUTH_SLOPE] = _wrapped(azimuths - middle)
    slopes[:, :, LATENCY] = np.einsum("anp,np->an", gradients, summary.velocities_mps)
    slopes[0] *= flat[:, None]
    misses = np.stack([aside * flat, upwards])
    away_m = float(np.hypot(*away[:, :2].mean(axis=0)))
    if not summary.is_still:
        step_s = max(trial.pointings.span_s / len(hold), BLOCK_S)
        return _Linearized(misses, slopes, hold, step_s, trial.pointings.span_s, away_m)

    # one error a lamp: the mean over its visit
    count = np.bincount(hold).astype(np.float64)
    misses = np.stack([np.bincount(hold, miss) / count for miss in misses])
    sums = np.zeros((2, len(count), COLUMNS))
    for axis in range(2):
        np.add.at(sums[axis], hold, slopes[axis])
    mean_slopes = sums / count[:, None]
    one_hold = np.zeros_like(hold[: len(count)])
    return _Linearized(misses, mean_slopes, one_hold, step_s=0.0, span_s=0.0, away_m=away_m)


def _wrapped(angles_rad: Array) -> Array:
    """Return angles from -π to π."""
    return np.remainder(angles_rad + math.pi, math.tau) - math.pi


def _errors(linearized: Sequence[_Linearized]) -> _Errors:
    """Return the errors of a person from the longest of `linearized` whose blocks are short."""
    short = [trial for trial in linearized if trial.step_s <= SAME_STEP * BLOCK_S]
    if not short:
        short = list(linearized)
    longest_s = max(trial.span_s for trial in short)
    chosen = [trial for trial in short if trial.span_s >= LONG * longest_s]

    # constant errors: least squares with a prior
    slopes = np.concatenate([trial.slopes[:, :, 2:].reshape(-1, COLUMNS - 2) for trial in chosen])
    misses = np.concatenate([trial.misses.ravel() for trial in chosen])
    scatter_rad = max(float(np.std(misses)), MIN_RAD)
    prior = np.append(0.0, LARGE_SIGMAS**-2.0)
    normal = slopes.T @ slopes / scatter_rad**2 + np.diag(prior)
    gradient = slopes.T @ misses / scatter_rad**2
    turned, *constants = np.linalg.solve(normal, gradient).tolist()
    step_s = float(np.median([trial.step_s for trial in chosen]))
    sideways = np.concatenate([trial.slopes[0, :, 2] for trial in chosen])
    turned_rad = turned * float(sideways.mean())

    # the correlation of what they leave
    constant = _Errors(np.array(constants), turned_rad, step_s, correlation=np.ones((2, 1)))
    return replace(constant, correlation=_correlation(chosen, constant))


def _correlation(linearized: Sequence[_Linearized], errors: _Errors) -> Array:
    """Return the autocorrelation (2 x lags) of the rest; the biased estimate, which is positive definite."""
    if not errors.step_s:
        return _between(np.stack([errors.rest(trial) for trial in linearized]))
    lags = max(int(np.bincount(trial.hold).max()) for trial in linearized)
    sums = np.zeros((2, lags))
    for trial in linearized:
        rest = errors.rest(trial)
        for hold in range(int(trial.hold[-1]) + 1):
            own = rest[:, trial.hold == hold]
            count = own.shape[1]
            for axis in range(2):
                # "full" begins with the negative lags
                products = np.correlate(own[axis], own[axis], "full")
                sums[axis, :count] += products[count - 1 :]
    sums[:, 0] += MIN_RAD**2
    return np.asarray(sums / sums[:, :1], dtype=np.float64)


def _between(rest: Array) -> Array:
    """Return the correlation (2 x 2) of the errors at a lamp with themselves, and with those at another.

    Args:
        rest: errors, k x 2 x m, of k trials.
    """
    squares = np.mean(rest**2, axis=(0, 2)) + MIN_RAD**2
    lamps = rest.shape[2]
    products = (lamps * np.mean(rest, axis=2) ** 2).mean(axis=0) - squares
    shared = np.clip(products / max(lamps - 1, 1) / squares, 0.0, MAX_CORRELATION)
    return np.stack([np.ones(2), shared], axis=1)


def _median_m(linearized: _Linearized, errors: _Errors, place: float) -> float:
    """Return the median error; `place` is the information about the place before any ray, 1/m²."""
    squares = np.mean(errors.rest(linearized) ** 2, axis=1) + MIN_RAD**2
    own = linearized.slopes[:, :, BIAS:] @ errors.constants[:, None]  # the person's, of which a share shows
    columns = np.concatenate([linearized.slopes[:, :, :3], own], axis=2)
    information: Array = np.diag([place, place, 0.0, 1.0])
    for hold in range(int(linearized.hold[-1]) + 1):
        is_own = linearized.hold == hold
        for axis in range(2):
            alike = _alike(errors, axis, int(np.sum(is_own)), linearized.step_s)
            error_covariance = squares[axis] * toeplitz(alike)
            slopes = columns[axis, is_own]
            information += slopes.T @ _solved(error_covariance, slopes)
    covariance = np.linalg.inv(information)[:2, :2]
    return median_distance(np.linalg.eigvalsh(covariance).astype(np.float64))


def _solved(covariance: Array, slopes: Array) -> Array:
    return np.asarray(cho_solve(cho_factor(covariance), slopes), dtype=np.float64)


def _alike(errors: _Errors, axis: int, count: int, step_s: float) -> Array:
    """Return the correlation (`count`) of an error with the later ones of its hold."""
    if step_s:
        lags_s = errors.step_s * np.arange(errors.correlation.shape[1], dtype=np.float64)
        apart_s = step_s * np.arange(count, dtype=np.float64)
        interpolated = np.interp(apart_s, lags_s, errors.correlation[axis], right=0.0)
        alike = np.asarray(interpolated, dtype=np.float64)
    else:
        alike = np.full(count, float(errors.correlation[axis, -1]))
    alike[0] = 1.0 + ROUNDING
    return alike


def median_distance(variances: Array) -> float:
    """Return the median distance from the mean of a normal distribution with these two variances.

    Its square is approximated by a gamma distribution of equal mean and variance (Welch and Satterthwaite),
    which is exact for two equal variances and if one is zero.
    """
    mean = float(np.sum(variances))
    spread = 2.0 * float(np.sum(variances**2))
    if spread == 0.0:
        return 0.0
    shape = mean * mean / spread
    median = float(gammaincinv(shape, 0.5))
    return math.sqrt(median * spread / mean)
