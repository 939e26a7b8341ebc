"""Least squares with errors that last: yaw and its uncertainty from linearized residuals. Pure.

The orientation of an IMU has errors that stay similar for seconds. They average out slowly, and a slow
movement cannot be told from them. Each residual is therefore the sum of white noise, whose variance is that
inside short blocks of time, and of a lasting error with a covariance that decays exponentially with time.
Size and duration of the lasting error are not known: the results for all of `LASTING_ERRORS` are averaged,
each weighted by its probability under the residuals (restricted likelihood).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from pointit.schemas import NS_PER_S

Array = NDArray[np.float64]

BLOCK_NS = NS_PER_S // 10
"""Duration of a block, within which a lasting error does not change, ns."""
LASTING_ERRORS = tuple(
    (math.radians(sigma_deg), time_s)
    for sigma_deg in (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
    for time_s in (0.3, 1.0, 4.0)
)
"""1 sigma, rad, and correlation time, s, of the lasting errors that are considered equally probable."""
MIN_BLOCKS = 10
"""Number of blocks, 1 s of movement, below which the parameters fit anything."""
MIN_WHITE_RAD = math.radians(0.05)
"""Least white noise, 1 sigma."""
MIN_SIGMA_RAD = math.radians(0.1)
"""Least 1 sigma of a yaw: errors that are constant do not show."""
MIN_PROBABILITY = 0.01
"""Probability of a lasting error below which its result is left out."""


class Linearization(NamedTuple):
    """Residuals about an estimate, and their derivatives by the parameters."""

    stamps_ns: NDArray[np.int64]
    """Times (n), ascending."""
    weights: Array
    """Weights (n) of robust least squares, at most 1."""
    columns: Array
    """Derivatives (n x 3 x p) by parameters, the yaw first."""
    residuals: Array
    """Residuals (n x 3), rad."""
    precision: Array
    """Prior precision (p x p) of the parameters."""
    offset: Array
    """Parameters (p) less their prior means."""


class YawStep(NamedTuple):
    """Correction of an estimate."""

    parameters: Array
    """Difference from the estimate (p)."""
    variance: float
    """Variance of the yaw, rad²."""


def solve_lasting(problem: Linearization) -> YawStep | None:
    """Return the correction of the estimate, or None if the turns are too few or only noise."""
    starts = np.flatnonzero(np.diff(problem.stamps_ns // BLOCK_NS, prepend=-1))
    if len(starts) < MIN_BLOCKS:
        return None
    sizes = np.add.reduceat(problem.weights, starts)
    ages_s = (problem.stamps_ns - problem.stamps_ns[-1]) / NS_PER_S
    count = len(starts)
    values = np.column_stack([problem.columns.reshape(len(ages_s), -1), problem.residuals, ages_s])
    means = np.add.reduceat(values * problem.weights[:, None], starts) / sizes[:, None]
    block_of = np.repeat(np.arange(count), np.diff(starts, append=len(ages_s)))
    within = (problem.residuals - means[block_of, -4:-1]) ** 2
    freedom = 3 * max(1, len(ages_s) - count)
    white = max(MIN_WHITE_RAD**2, float((problem.weights[:, None] * within).sum()) / freedom)
    apart_s = np.abs(means[:, -1, None] - means[None, :, -1])
    steps, variances, scores = list[Array](), list[float](), list[float]()
    for sigma_rad, time_s in LASTING_ERRORS:
        covariance = np.diag(white / sizes) + sigma_rad**2 * np.exp(-apart_s / time_s)
        root = np.linalg.cholesky(covariance)
        whitened = solve_triangular(root, means[:, :-1], lower=True, check_finite=False)
        matrix, residuals = whitened[:, :-3].reshape(3 * count, -1), whitened[:, -3:].ravel()
        information = matrix.T @ matrix + problem.precision
        try:
            inverse = np.linalg.inv(information)
        except np.linalg.LinAlgError:  # level turns without any noise, of simulations: the yaw does not show
            return None
        step = inverse @ (matrix.T @ residuals - problem.precision @ problem.offset)
        left, offset = residuals - matrix @ step, problem.offset + step
        misfit = float(left @ left) + float(offset @ problem.precision @ offset)
        log_volume = 6.0 * float(np.log(np.diag(root)).sum()) + float(np.linalg.slogdet(information)[1])
        steps.append(step)
        scores.append(-0.5 * (misfit + log_volume))
        shown = 1.0 / float(inverse[0, 0]) - 2.0 * count  # noise of the turns themselves shows no yaw
        variances.append(1.0 / shown if shown > 0.0 else math.inf)
    likelihoods = np.exp(np.array(scores) - max(scores))
    likely = likelihoods > MIN_PROBABILITY * likelihoods.sum()
    shares = likelihoods[likely] / likelihoods[likely].sum()
    step = shares @ np.array(steps)[likely]
    spread = (np.array(steps)[likely, 0] - step[0]) ** 2
    variance = MIN_SIGMA_RAD**2 + float(shares @ (np.array(variances)[likely] + spread))
    return YawStep(step, variance) if math.isfinite(variance) else None
