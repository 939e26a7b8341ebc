"""Levenberg-Marquardt with Huber loss over several starts, on angles between rays and targets.

Everything is batched over poses (k) and samples (n), since the solver evaluates several poses at once. The
horizontal plane is complex, so that rotations are products.

SciPy's `least_squares` handles one start per call: with the same residuals and Jacobian, 300 samples and
eight starts took 70 ms, this batch less than 1 ms.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array

Complex = NDArray[np.complex128]

PARAMETERS = 5
"""x (m), y (m) and yaw (rad) of {H} in {W}; elevation bias (rad) of the person's rays; z (m) of {H} above the
floor, or the error of the eye height from the body measures.
"""

PLUMB_RAD = 0.5 * math.pi - 1e-6
"""Rays steeper than this have no azimuth."""

_TINY = 1e-9

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
"""Number of steps after which descents into one minimum can be distinguished from those into rivals."""

RIVAL_COST = 20.0
"""Descents this far above the lowest one do not lead to a rival."""

SAME_POSE = 0.3
"""Metres and radians: poses nearer to each other count as one."""

CONVERGED = 3e-4
"""Largest step of a converged descent, m and rad."""
NEARLY = 3e-3
"""Largest step of rivals, of which the cost is needed, m and rad."""

_DAMPING = 1e-3
_MIN_DAMPING = 1e-6
"""Lower bound of the damping."""
_AGAIN = 1e-2
"""Least damping after a bad step."""
_STUCK = 1e3
"""Damping at which a descent is stuck."""
_EYE = np.eye(PARAMETERS)


@dataclass(frozen=True)
class Rays:
    """Measurements, one row a sample: rays in {H}, targets in {W}, both relative to the floor."""

    origins_m: Array
    """n x 3."""
    azimuths_rad: Array
    elevations_rad: Array
    targets_m: Array
    """n x 3."""

    @classmethod
    def of(cls, origins_m: Array, directions: Array, targets_m: Array) -> "Rays":
        """Return the rays with `directions` (n x 3) of any length."""
        x, y, z = directions.T
        azimuths = np.arctan2(y, x)
        elevations = np.arctan2(z, np.hypot(x, y))
        # vertical rays have no azimuth but that of rounding: use any that turns with the others
        steepness = np.abs(elevations)
        azimuths[steepness > PLUMB_RAD] = azimuths[np.argmin(steepness)]
        return cls(origins_m, azimuths, elevations, targets_m)

    @cached_property
    def inverse_azimuth(self) -> Complex:
        """Return the rotations (n) of the rays into the forward direction."""
        turn: Complex = np.exp(-1j * self.azimuths_rad)
        return turn

    @cached_property
    def elevation_phasor(self) -> Complex:
        """Return cos + i sin of each elevation, n."""
        turn: Complex = np.exp(1j * self.elevations_rad)
        return turn

    @cached_property
    def targets(self) -> Complex:
        """Return the targets in the horizontal plane, n."""
        x, y, _ = self.targets_m.T
        return np.asarray(x + 1j * y, dtype=np.complex128)

    @cached_property
    def origins(self) -> Complex:
        """Return the origins in the horizontal plane, each with its ray turned forward, n."""
        x, y, _ = self.origins_m.T
        origins = x + 1j * y
        return np.asarray(origins * self.inverse_azimuth)

    @cached_property
    def heights(self) -> Array:
        """Return the heights (n) of the targets above the origins."""
        return np.asarray(self.targets_m[:, 2] - self.origins_m[:, 2], dtype=np.float64)


def angular_errors(rays: Rays, poses: Array) -> tuple[Array, Array]:
    """Return the residual angles without derivatives: to the left of the rays and above them, k x n each."""
    # Targets relative to the eyes, turned so that the measured azimuth is forward
    x, y, yaw, bias, height = poses.T[:, :, None]
    place = x + 1j * y
    turn = np.exp(-1j * yaw) * rays.inverse_azimuth
    flat = (rays.targets - place) * turn - rays.origins
    ahead = flat.real
    left = flat.imag
    up = rays.heights - height

    # Tilted so that the measured elevation is forward, too
    tilt = rays.elevation_phasor * np.exp(-1j * bias)
    cos_el = tilt.real
    sin_el = tilt.imag
    along = cos_el * ahead + sin_el * up
    above = cos_el * up - sin_el * ahead
    square = left * left + ahead * ahead + up * up
    gain = 2.0 / np.maximum(np.sqrt(square) + along, _TINY)
    return gain * left, gain * above


def residuals(rays: Rays, poses: Array) -> tuple[Array, Array]:
    """Return the angles between targets and rays, and their derivatives by the pose.

    The residual is the stereographic projection onto the tangent plane of the measured ray, its elevation
    lowered by the bias. Its length is 2 tan(angle / 2): the angle within 1 % up to 20 degrees, regular for
    vertical rays, unlike azimuths, and growing the further behind a target is.

    Args:
        rays: n samples.
        poses: k x 5, see `PARAMETERS`.

    Returns:
        k x 2 x n angles, rad (to the left of the ray, above it), and their k x 5 x 2 x n derivatives.
    """
    # Targets relative to the eyes, turned so that the measured azimuth is forward
    x, y, _, _, height = poses.T[:, :, None]
    place = x + 1j * y
    turns = np.exp(-1j * poses[:, 2:4])
    turn = turns[:, :1] * rays.inverse_azimuth
    turned_targets = (rays.targets - place) * turn
    flat = turned_targets - rays.origins
    ahead = flat.real
    left = flat.imag
    up = rays.heights - height

    # Tilted so that the measured elevation is forward, too, and projected
    tilt = rays.elevation_phasor * turns[:, 1:]
    cos_el = tilt.real
    sin_el = tilt.imag
    along = cos_el * ahead + sin_el * up
    above = cos_el * up - sin_el * ahead
    square = left * left + ahead * ahead + up * up
    reach = np.sqrt(square)
    gain = 2.0 / np.maximum(reach + along, _TINY)
    samples = left.shape[1]
    angles = np.empty((len(poses), 2, samples))
    angles[:, 0] = gain * left
    angles[:, 1] = gain * above

    # Derivatives of ahead + i left by x, y and yaw
    d_flat = np.empty((len(poses), 3, samples), dtype=np.complex128)
    d_flat[:, 0] = -turn
    d_flat[:, 1] = -1j * turn
    d_flat[:, 2] = -1j * turned_targets
    d_ahead = d_flat.real
    d_left = d_flat.imag

    # Derivatives of the numerators (left, above) by each parameter
    slope = np.zeros((len(poses), PARAMETERS, 2, samples))
    slope[:, :3, 0] = d_left
    slope[:, :3, 1] = -sin_el[:, None] * d_ahead
    slope[:, 3, 1] = along
    slope[:, 4, 1] = -cos_el

    # Derivatives of the denominator (reach + along), then of the quotients
    d_denominator = np.empty((len(poses), PARAMETERS, samples))
    safe_reach = np.maximum(reach, _TINY)
    d_half_square = left[:, None] * d_left + ahead[:, None] * d_ahead
    d_denominator[:, :3] = d_half_square / safe_reach[:, None]
    d_denominator[:, :3] += cos_el[:, None] * d_ahead
    d_denominator[:, 3] = -above
    d_denominator[:, 4] = -up / safe_reach - sin_el
    half_angles = 0.5 * angles
    slope -= half_angles[:, None] * d_denominator[:, :, None]
    slope *= gain[:, None, None]
    return angles, slope


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
    # Projections I - v vᵀ of each bias and ray (b x 3 x 3 x n)
    bias_information = max(float(weights.prior[3]), 1.0)
    biases = np.array([-1.0, 0.0, 1.0]) / math.sqrt(bias_information)
    elevations = rays.elevations_rad - biases[:, None]
    level = np.cos(elevations)
    x = level * np.cos(rays.azimuths_rad)
    y = level * np.sin(rays.azimuths_rad)
    z = np.sin(elevations)
    directions = np.stack([x, y, z], axis=1)
    outer_products = directions[:, :, None] * directions[:, None, :]
    projections = np.eye(3)[None, :, :, None] - outer_products

    # Yaws relative to the ray with the best defined azimuth, so that the result does not depend on the IMU's
    # yaw. The targets from the origins at each of them (starts x 3 x n).
    first = float(rays.azimuths_rad[np.argmax(rays.elevation_phasor.real)])
    yaws = np.arange(STARTS) * (math.tau / STARTS) - first
    turns = np.exp(-1j * yaws)
    turned_targets = turns[:, None] * rays.targets
    origin_x, origin_y, _ = rays.origins_m.T
    offsets = np.empty((STARTS, 3, len(rays.heights)))
    offsets[:, 0] = turned_targets.real - origin_x
    offsets[:, 1] = turned_targets.imag - origin_y
    offsets[:, 2] = rays.heights

    # Normal equations of the place. When all rays are parallel, it is that nearest to the targets.
    flat_projections: Array = projections[:, :2].reshape(len(biases), 2, -1)
    right_sides = offsets.reshape(STARTS, -1) @ flat_projections.transpose(0, 2, 1)  # b x starts x 2
    normal: Array = projections[:, :2, :2].sum(axis=3)
    regularized = normal + PARALLEL * len(rays.heights) * np.eye(2)
    places_h: Array = right_sides @ np.linalg.inv(regularized)
    flat_places = places_h[..., 0] + 1j * places_h[..., 1]
    places: Complex = flat_places * np.exp(1j * yaws)
    poses = np.zeros((len(biases), STARTS, PARAMETERS))
    poses[..., 0] = places.real
    poses[..., 1] = places.imag
    poses[..., 2] = yaws
    poses[..., 3] = biases[:, None]

    # The best bias of each yaw, and the lowest yaws among those that are lower than their neighbours
    costs = evaluate_costs(rays, poses.reshape(-1, PARAMETERS), weights)
    costs = costs.reshape(len(biases), STARTS)
    best_biases = np.argmin(costs, axis=0)
    lowest = costs.min(axis=0)
    before = np.roll(lowest, 1)
    after = np.roll(lowest, -1)
    is_valley = (lowest <= before) & (lowest <= after)
    valleys = np.flatnonzero(is_valley)
    valleys = valleys[np.argsort(lowest[valleys])][:MAX_POSES]
    return np.asarray(poses[best_biases[valleys], valleys], dtype=np.float64)


def minimize(rays: Rays, poses: Array, weights: Weights) -> Array:
    """Return the relevant minima (k x 5) below `poses` (k x 5), the lowest first.

    Descents that after a few steps are far above the lowest, or coincide with another one, are dropped. Of
    the others the lowest is followed until it converges, its rivals nearly so.
    """
    damping = np.full(len(poses), _DAMPING)
    costs, slopes, hessians = _linearized(rays, poses, weights)
    for number in range(ITERATIONS):
        # Hopeless descents cost as much time as the others: drop them once they can be recognized
        if number == SETTLED:
            indices = _apart(poses, costs)
            poses = poses[indices]
            costs = costs[indices]
            slopes = slopes[indices]
            hessians = hessians[indices]
            damping = damping[indices]

        # Damped step of each
        diagonals = hessians.diagonal(axis1=1, axis2=2)
        added = damping[:, None] * diagonals + _TINY
        damped = hessians + added[:, :, None] * _EYE
        descents = -slopes[:, :, None]
        try:
            solved = np.asarray(np.linalg.solve(damped, descents), dtype=np.float64)
        except np.linalg.LinAlgError:  # a pose lies exactly in a target, where the slope vanishes
            break
        steps: Array = solved[:, :, 0]
        new_poses: Array = poses + steps
        new_costs, new_slopes, new_hessians = _linearized(rays, new_poses, weights)

        # Steps that do not lower the cost are rejected. Mostly there are none, and `where` takes time.
        is_better = new_costs <= costs
        if is_better.all():
            poses = new_poses
            costs = new_costs
            slopes = new_slopes
            hessians = new_hessians
        else:
            poses = np.where(is_better[:, None], new_poses, poses)
            costs = np.where(is_better, new_costs, costs)
            slopes = np.where(is_better[:, None], new_slopes, slopes)
            hessians = np.where(is_better[:, None, None], new_hessians, hessians)

        # A rejected step does not count as convergence, however small. Growing damping ends such descents.
        counts = is_better | (damping > _STUCK)
        largest_steps = np.abs(steps).max(axis=1)
        sizes = np.where(counts, largest_steps, np.inf)
        less_damping = np.maximum(damping * 0.1, _MIN_DAMPING)
        more_damping = np.maximum(damping * 10.0, _AGAIN)
        damping = np.where(is_better, less_damping, more_damping)
        if number < SETTLED:
            continue
        has_converged = sizes[np.argmin(costs)] < CONVERGED
        if has_converged and sizes.max() < NEARLY:
            break
    return np.asarray(poses[_apart(poses, costs)], dtype=np.float64)


def _apart(poses: Array, costs: Array) -> list[int]:
    """Return the indices of distinct poses up to `RIVAL_COST` above the lowest, in order of cost."""
    order = np.argsort(costs)
    indices: list[int] = []
    for index in order:
        if costs[index] > costs[order[0]] + RIVAL_COST:
            break
        if not any(_is_same(poses[index], poses[other]) for other in indices):
            indices.append(int(index))
    return indices


def _is_same(pose: Array, other: Array) -> bool:
    """Return True if two poses (5) are within `SAME_POSE` along each of x, y and yaw."""
    dx, dy, turn = np.abs(pose[:3] - other[:3])
    difference = max(dx, dy, abs(math.remainder(turn, math.tau)))
    return not difference > SAME_POSE


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
    losses = _loss(squares, weight)
    flat_jacobian = jacobian.reshape(len(poses), PARAMETERS, -1)
    weighted = (jacobian * weight[:, None, None]).reshape(flat_jacobian.shape)
    hessian = weighted @ flat_jacobian.transpose(0, 2, 1)
    hessian += weights.prior * _EYE
    column = angles.reshape(len(poses), -1, 1)
    gradient = (weighted @ column)[:, :, 0]
    gradient += weights.prior * poses
    return losses.sum(axis=1) + _prior_cost(poses, weights), gradient, hessian


def evaluate_costs(rays: Rays, poses: Array, weights: Weights, sample_weights: Array | float = 1.0) -> Array:
    """Return the costs (k) of `poses` (k x 5) with sample weights `sample_weights` (n)."""
    left, above = angular_errors(rays, poses)
    sideways_sigma, upward_sigma = weights.sigma_rad
    squares = (left / sideways_sigma) ** 2 + (above / upward_sigma) ** 2
    weight = huber_weight(np.sqrt(squares))
    losses = sample_weights * _loss(squares, weight)
    return np.asarray(losses.sum(axis=1) + _prior_cost(poses, weights), dtype=np.float64)


def _loss(squares: Array, weight: Array) -> Array:
    """Return Huber's loss of each sample: half the square, and linear beyond `HUBER`."""
    return np.asarray(weight * (1.0 - 0.5 * weight) * squares, dtype=np.float64)


def _prior_cost(poses: Array, weights: Weights) -> Array:
    return np.asarray(0.5 * (poses * poses) @ weights.prior, dtype=np.float64)
