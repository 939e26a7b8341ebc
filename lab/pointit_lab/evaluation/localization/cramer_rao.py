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
from collections import defaultdict
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
        constant = linearized.slopes[:, :, BIAS:] @ self.constants
        rest = linearized.misses - constant
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
    squares_m2 = [linearized.away_m**2 for linearized in linear.values()]
    mean_square_m2 = float(np.mean(squares_m2))
    place = 2.0 / max(mean_square_m2, MIN_AWAY_M**2)

    # errors are those of a person in one recording
    groups = defaultdict[tuple[str, ...], list[int]](list)
    for number, linearized in linear.items():
        trial = trials[number]
        scenario = ""
        if not linearized.step_s:  # acts at lamps: each number of lamps by itself
            scenario = trial.condition
        groups[trial.subject, trial.recording, scenario].append(number)
    for numbers in groups.values():
        group = [linear[number] for number in numbers]
        errors = _errors(group)
        for number in numbers:
            bounds_m[number] = _median_m(linear[number], errors, place)
    return bounds_m


def _linearized(trial: LocalizationTrial) -> _Linearized:
    summary = blocks(trial.pointings)
    means = summary.pointings

    # directions from the true place to the targets
    away = means.targets_m - (trial.x_m, trial.y_m, 0.0)
    away[:, 2] -= means.origins_m[:, 2]
    level_m = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)
    azimuths = np.arctan2(away[:, 1], away[:, 0])
    elevations = np.arctan2(away[:, 2], level_m)

    # derivatives of the misses by the parameters; sideways they shrink with the elevation
    flat = np.cos(elevations)
    slopes = _slopes(_gradients(away, level_m), azimuths, elevations, summary.velocities_mps)
    slopes[0] *= flat[:, None]

    # how far the rays miss them
    aside, upwards = _misses(means.directions, trial.yaw_rad or 0.0, azimuths, elevations)
    misses = np.stack([aside * flat, upwards])

    middle_m = away[:, :2].mean(axis=0)
    away_m = float(np.hypot(*middle_m))
    if summary.is_still:
        return _one_row_a_lamp(misses, slopes, means.targets_m, away_m)
    hold = summary.hold.astype(np.intp)
    span_s = trial.pointings.span_s
    step_s = max(span_s / len(hold), BLOCK_S)
    return _Linearized(misses, slopes, hold, step_s, span_s, away_m)


def _gradients(away: Array, level_m: Array) -> Array:
    """Return the derivatives (2 x m x 3) of azimuth and elevation by the target's position, rad/m.

    Args:
        away: from the true position of the eyes to the targets, m x 3, {W}.
        level_m: horizontal distances, m.
    """
    x = away[:, 0]
    y = away[:, 1]
    z = away[:, 2]
    level_square = level_m**2
    square = level_square + z**2
    divisor = level_m * square
    gradients = np.zeros((2, len(away), 3))
    gradients[0, :, 0] = -y / level_square
    gradients[0, :, 1] = x / level_square
    gradients[1, :, 0] = -z * x / divisor
    gradients[1, :, 1] = -z * y / divisor
    gradients[1, :, 2] = level_m / square
    return gradients


def _slopes(gradients: Array, azimuths: Array, elevations: Array, velocities_mps: Array) -> Array:
    """Return the derivatives (2 x m x `COLUMNS`) of azimuth and elevation by the parameters."""
    mean_direction = np.exp(1j * azimuths).mean()
    middle = float(np.angle(mean_direction))
    slopes = np.zeros((2, len(azimuths), COLUMNS))
    slopes[:, :, :2] = -gradients[:, :, :2]
    slopes[0, :, 2] = -1.0
    slopes[1, :, BIAS] = 1.0
    slopes[1, :, ELEVATION_SLOPE] = elevations
    slopes[0, :, AZIMUTH_SLOPE] = _wrapped(azimuths - middle)
    slopes[:, :, LATENCY] = np.einsum("anp,np->an", gradients, velocities_mps)
    return slopes


def _misses(rays: Array, yaw_rad: float, azimuths: Array, elevations: Array) -> tuple[Array, Array]:
    """Return the errors of rays (m x 3, {H}) to the left of the targets, and upwards (m each), rad."""
    ray_level = np.hypot(rays[:, 0], rays[:, 1])
    ray_azimuths = np.arctan2(rays[:, 1], rays[:, 0])
    ray_elevations = np.arctan2(rays[:, 2], ray_level)
    aside = _wrapped(ray_azimuths + yaw_rad - azimuths)
    return aside, ray_elevations - elevations


def _one_row_a_lamp(misses: Array, slopes: Array, targets_m: Array, away_m: float) -> _Linearized:
    """Return the means over each visit of a lamp; the bound takes visits of one lamp as independent."""
    steps_m = np.diff(targets_m, axis=0, prepend=targets_m[:1])
    moves_m = np.abs(steps_m).max(axis=1)
    visit = np.cumsum(moves_m > STILL_M)
    count = np.bincount(visit).astype(np.float64)

    mean_misses = np.stack([np.bincount(visit, miss) / count for miss in misses])
    sums = np.zeros((2, len(count), COLUMNS))
    for axis in range(2):
        np.add.at(sums[axis], visit, slopes[axis])
    mean_slopes = sums / count[:, None]
    one_hold = np.zeros_like(visit[: len(count)])
    return _Linearized(mean_misses, mean_slopes, one_hold, step_s=0.0, span_s=0.0, away_m=away_m)


def _wrapped(angles_rad: Array) -> Array:
    """Return angles from -π to π."""
    turned = np.remainder(angles_rad + math.pi, math.tau)
    return turned - math.pi


def _errors(linearized: Sequence[_Linearized]) -> _Errors:
    """Return the errors of a person from the longest of `linearized` whose blocks are short."""
    chosen = _long_trials(linearized)
    # constant errors: least squares with a prior
    rows = [trial.slopes[:, :, 2:].reshape(-1, COLUMNS - 2) for trial in chosen]
    slopes = np.concatenate(rows)
    misses = np.concatenate([trial.misses.ravel() for trial in chosen])
    scatter_rad = max(float(np.std(misses)), MIN_RAD)
    prior = np.append(0.0, LARGE_SIGMAS**-2.0)
    normal = slopes.T @ slopes / scatter_rad**2 + np.diag(prior)
    gradient = slopes.T @ misses / scatter_rad**2
    solution = np.linalg.solve(normal, gradient)
    turned, *constants = solution.tolist()
    sideways = np.concatenate([trial.slopes[0, :, 2] for trial in chosen])
    turned_rad = turned * float(sideways.mean())
    step_s = float(np.median([trial.step_s for trial in chosen]))

    # the correlation of what they leave
    uncorrelated = np.ones((2, 1))
    constant = _Errors(np.array(constants), turned_rad, step_s, uncorrelated)
    return replace(constant, correlation=_correlation(chosen, constant))


def _long_trials(linearized: Sequence[_Linearized]) -> list[_Linearized]:
    """Return the longest of the trials whose blocks are short, or of all if none is."""
    max_step_s = SAME_STEP * BLOCK_S
    short = [trial for trial in linearized if trial.step_s <= max_step_s]
    if not short:
        short = list(linearized)
    longest_s = max(trial.span_s for trial in short)
    min_span_s = LONG * longest_s
    return [trial for trial in short if trial.span_s >= min_span_s]


def _correlation(linearized: Sequence[_Linearized], errors: _Errors) -> Array:
    """Return the autocorrelation (2 x lags) of the rest; the biased estimate, which is positive definite."""
    if not errors.step_s:
        rests = [errors.rest(trial) for trial in linearized]
        return _between(np.stack(rests))
    lags = max(int(np.bincount(trial.hold).max()) for trial in linearized)
    sums = np.zeros((2, lags))
    for trial in linearized:
        rest = errors.rest(trial)
        holds = int(trial.hold[-1]) + 1
        for hold in range(holds):
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
    square_means = np.mean(rest, axis=2) ** 2
    products = (lamps * square_means).mean(axis=0) - squares
    others = max(lamps - 1, 1)
    shared = np.clip(products / others / squares, 0.0, MAX_CORRELATION)
    return np.stack([np.ones(2), shared], axis=1)


def _median_m(linearized: _Linearized, errors: _Errors, place: float) -> float:
    """Return the median error; `place` is the information about the place before any ray, 1/m²."""
    rest = errors.rest(linearized)
    squares = np.mean(rest**2, axis=1) + MIN_RAD**2

    # one column for the person's constant errors, of which a share shows
    own = linearized.slopes[:, :, BIAS:] @ errors.constants[:, None]
    columns = np.concatenate([linearized.slopes[:, :, :3], own], axis=2)

    # information of the prior, and of each hold, whose errors are independent of the others'
    information: Array = np.diag([place, place, 0.0, 1.0])
    holds = int(linearized.hold[-1]) + 1
    for hold in range(holds):
        is_own = linearized.hold == hold
        count = int(np.sum(is_own))
        for axis in range(2):
            alike = _alike(errors, axis, count, linearized.step_s)
            error_covariance = squares[axis] * toeplitz(alike)
            slopes = columns[axis, is_own]
            information += slopes.T @ _solved(error_covariance, slopes)

    # of the place: the marginal covariance
    covariance = np.linalg.inv(information)[:2, :2]
    variances = np.linalg.eigvalsh(covariance)
    return median_distance(variances.astype(np.float64))


def _solved(covariance: Array, slopes: Array) -> Array:
    factors = cho_factor(covariance)
    return np.asarray(cho_solve(factors, slopes), dtype=np.float64)


def _alike(errors: _Errors, axis: int, count: int, step_s: float) -> Array:
    """Return the correlation (`count`) of an error with the later ones of its hold."""
    own_correlation = errors.correlation[axis]
    if step_s:
        lags_s = errors.step_s * np.arange(len(own_correlation), dtype=np.float64)
        apart_s = step_s * np.arange(count, dtype=np.float64)
        interpolated = np.interp(apart_s, lags_s, own_correlation, right=0.0)
        alike = np.asarray(interpolated, dtype=np.float64)
    else:
        alike = np.full(count, float(own_correlation[-1]))
    # a little more than 1: the covariance is not singular
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
