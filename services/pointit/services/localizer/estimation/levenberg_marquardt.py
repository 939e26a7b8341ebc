"""Levenberg-Marquardt with Huber loss, batched over several starts.

SciPy's `least_squares` handles one start per call: with the same residuals and Jacobian, 300 samples and
eight starts took 70 ms, this batch less than 1 ms.
"""

import math
from dataclasses import dataclass

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import (
    PARAMETERS,
    Array,
    Complex,
    Rays,
    angular_errors,
    residuals,
)

PARALLEL = 1e-6
"""Relative weight of the pull towards the targets. It counts where the rays leave a direction open."""

STARTS = 24
"""Number of evenly spaced yaws to evaluate first."""

MAX_POSES = 5
"""Largest number of starts: the lowest yaws among those that are lower than their neighbours."""

HUBER = 1.5
"""Standard deviations beyond which the influence of a sample no longer grows."""

ITERATIONS = 40

SETTLED = 3
"""Number of steps after which descents into one minimum can be told from those into rivals."""

RIVAL_COST = 20.0
"""Descents this far above the lowest one do not lead to a rival."""

SAME_POSE = 0.3
"""Metres and radians: poses nearer to each other count as one."""

CONVERGED, NEARLY = 3e-4, 3e-3
"""Metres and radians: largest step of a converged descent, and of rivals, of which the cost is needed."""

_DAMPING = 1e-3
_MIN_DAMPING, _AGAIN, _STUCK = 1e-6, 1e-2, 1e3
"""Damping: lower bound, least value after a bad step, and the value at which a descent is stuck."""
_TINY = 1e-9
_EYE = np.eye(PARAMETERS)


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of samples and priors."""

    sigma_rad: Array
    """2 x 1: standard deviations of one sample, sideways and upwards."""
    prior: Array
    """Inverse prior variance of each parameter; 0 if unknown."""


def initial_poses(rays: Rays, weights: Weights) -> Array:
    """Return a pose (k x 5) for each promising yaw: the place nearest to all rays, which is linear.

    In {H} turned to the yaw, the place τ minimises Σ |(I - v vᵀ)(p - τ - o)|². Each yaw is evaluated with
    elevations as measured, and raised and lowered by one sigma of the bias, which moves the place.
    """
    biases = np.array([-1.0, 0.0, 1.0]) / math.sqrt(max(float(weights.prior[3]), 1.0))
    elevations = rays.elevations_rad - biases[:, None]
    level = np.cos(elevations)
    directions = np.stack(
        [level * np.cos(rays.azimuths_rad), level * np.sin(rays.azimuths_rad), np.sin(elevations)], axis=1
    )
    across = np.eye(3)[None, :, :, None] - directions[:, :, None] * directions[:, None, :]  # b x 3 x 3 x n
    # relative to the ray with the best defined azimuth, so that the result does not depend on the IMU's yaw
    first = float(rays.azimuths_rad[np.argmax(rays.elevation_phasor.real)])
    yaws = np.arange(STARTS) * (math.tau / STARTS) - first
    turned = np.exp(-1j * yaws)[:, None] * rays.targets
    seen = np.empty((STARTS, 3, len(rays.heights)))
    seen[:, 0], seen[:, 1] = turned.real - rays.origins_m[:, 0], turned.imag - rays.origins_m[:, 1]
    seen[:, 2] = rays.heights
    flat: Array = across[:, :2].reshape(len(biases), 2, -1)
    pulled = seen.reshape(STARTS, -1) @ flat.transpose(0, 2, 1)  # b x starts x 2
    normal: Array = across[:, :2, :2].sum(axis=3)
    # when all rays are parallel, the place nearest to the targets
    place: Array = pulled @ np.linalg.inv(normal + PARALLEL * len(rays.heights) * np.eye(2))
    spot: Complex = (place[..., 0] + 1j * place[..., 1]) * np.exp(1j * yaws)
    poses = np.zeros((len(biases), STARTS, PARAMETERS))
    poses[..., 0], poses[..., 1], poses[..., 2], poses[..., 3] = spot.real, spot.imag, yaws, biases[:, None]
    costs = evaluate_costs(rays, poses.reshape(-1, PARAMETERS), weights).reshape(len(biases), STARTS)
    best, lowest = np.argmin(costs, axis=0), costs.min(axis=0)
    valley = (lowest <= np.roll(lowest, 1)) & (lowest <= np.roll(lowest, -1))
    chosen = np.flatnonzero(valley)
    chosen = chosen[np.argsort(lowest[chosen])][:MAX_POSES]
    return np.asarray(poses[best[chosen], chosen], dtype=np.float64)


def minimize(rays: Rays, poses: Array, weights: Weights) -> Array:
    """Return the relevant minima (k x 5) below `poses` (k x 5), the lowest first.

    Descents that after a few steps are far above the lowest, or coincide with another one, are dropped. Of
    the others the lowest is followed until it converges, its rivals nearly so.
    """
    damping = np.full(len(poses), _DAMPING)
    costs, slopes, hessians = _linearized(rays, poses, weights)
    for number in range(ITERATIONS):
        if number == SETTLED:
            indices = _apart(poses, costs)
            poses, costs, slopes = poses[indices], costs[indices], slopes[indices]
            hessians, damping = hessians[indices], damping[indices]
        diagonal = hessians.diagonal(axis1=1, axis2=2)
        damped = hessians + (damping[:, None] * diagonal + _TINY)[:, :, None] * _EYE
        try:
            solved = np.asarray(np.linalg.solve(damped, -slopes[:, :, None]), dtype=np.float64)
        except np.linalg.LinAlgError:  # a pose lies exactly in a target, where the slope vanishes
            break
        steps: Array = solved[:, :, 0]
        tried: Array = poses + steps
        new_costs, new_slopes, new_hessians = _linearized(rays, tried, weights)
        better = new_costs <= costs
        if better.all():
            poses, costs, slopes, hessians = tried, new_costs, new_slopes, new_hessians
        else:
            poses = np.where(better[:, None], tried, poses)
            costs = np.where(better, new_costs, costs)
            slopes = np.where(better[:, None], new_slopes, slopes)
            hessians = np.where(better[:, None, None], new_hessians, hessians)
        # a rejected step does not count as convergence, however small; growing damping ends such descents
        sizes = np.where(better | (damping > _STUCK), np.abs(steps).max(axis=1), np.inf)
        damping = np.where(
            better, np.maximum(damping * 0.1, _MIN_DAMPING), np.maximum(damping * 10.0, _AGAIN)
        )
        if number >= SETTLED and sizes[np.argmin(costs)] < CONVERGED and sizes.max() < NEARLY:
            break
    return np.asarray(poses[_apart(poses, costs)], dtype=np.float64)


def _apart(poses: Array, costs: Array) -> list[int]:
    """Return the indices of distinct poses up to `RIVAL_COST` above the lowest, in order of cost."""
    indices: list[int] = []
    for index in np.argsort(costs):
        if costs[index] > costs[indices[0] if indices else index] + RIVAL_COST:
            break
        steps = [np.abs(poses[index, :3] - poses[other, :3]) for other in indices]
        if all(max(dx, dy, abs(math.remainder(turn, math.tau))) > SAME_POSE for dx, dy, turn in steps):
            indices.append(int(index))
    return indices


def huber_weight(sizes: Array) -> Array:
    """Return the Huber weights of normalized residuals `sizes`: 1 up to `HUBER`, then `HUBER / sizes`."""
    return np.asarray(HUBER / np.maximum(sizes, HUBER), dtype=np.float64)


def _linearized(rays: Rays, poses: Array, weights: Weights) -> tuple[Array, Array, Array]:
    """Return cost (k), gradient (k x 5) and Gauss-Newton Hessian (k x 5 x 5)."""
    angles, jacobian = residuals(rays, poses)
    angles /= weights.sigma_rad
    jacobian /= weights.sigma_rad
    squares = angles[:, 0] ** 2 + angles[:, 1] ** 2
    weight = huber_weight(np.sqrt(squares))
    flat = jacobian.reshape(len(poses), PARAMETERS, -1)
    weighted = (jacobian * weight[:, None, None]).reshape(flat.shape)
    hessian = weighted @ flat.transpose(0, 2, 1)
    gradient = (weighted @ angles.reshape(len(poses), -1, 1))[:, :, 0]
    hessian += weights.prior * _EYE
    gradient += weights.prior * poses
    return _loss(squares, weight).sum(axis=1) + _prior_cost(poses, weights), gradient, hessian


def evaluate_costs(rays: Rays, poses: Array, weights: Weights, sample_weights: Array | float = 1.0) -> Array:
    """Return the costs (k) of `poses` (k x 5) with sample weights `sample_weights` (n)."""
    left, above = angular_errors(rays, poses)
    squares = (left / weights.sigma_rad[0]) ** 2 + (above / weights.sigma_rad[1]) ** 2
    losses = sample_weights * _loss(squares, huber_weight(np.sqrt(squares)))
    return np.asarray(losses.sum(axis=1) + _prior_cost(poses, weights), dtype=np.float64)


def _loss(squares: Array, weight: Array) -> Array:
    """Return Huber's loss of each sample: half the square, and linear beyond `HUBER`."""
    return np.asarray(weight * (1.0 - 0.5 * weight) * squares, dtype=np.float64)


def _prior_cost(poses: Array, weights: Weights) -> Array:
    return np.asarray(0.5 * (poses * poses) @ weights.prior, dtype=np.float64)
