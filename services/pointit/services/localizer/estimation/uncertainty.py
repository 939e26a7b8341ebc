"""How sure a pose is: what the rays tell, less what they cannot know (pointing.md §4).

Four things are added to the inverse of the information: samples of a hold err together, so they count as
few; residuals larger than was believed widen it; what is wrong with everybody's eyes, fingers and
measures is wrong all the time, so no number of rays takes it away; and a tracker whose latency is not known
shifts a moving target along its way. No residual shows that shift: on a circle it is a turn of the pose.
"""

from dataclasses import dataclass

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import PARAMETERS, Array, Rays, residuals
from pointit.services.localizer.estimation.levenberg_marquardt import Weights, huber_weight
from pointit.services.localizer.estimation.sample_blocks import Blocks

BELIEF = 4.0
"""Independent pointings that the stated sigmas of pointing are worth beside the residuals."""

LEAST = 0.7
"""Of the stated sigmas: residuals never make rays more certain than this."""

GROSS = 3.0
"""Sigmas beyond which a residual is of something else, and does not widen the rest."""

STEEP = 0.2
"""Cosine of the elevation beyond which a ray's azimuth is not told from its direction."""

NOTHING = 1e-3
"""Information (1/m², 1/rad²) below which a direction is not told; rounding stays far below."""

VAGUE = 1e6
"""Variance of what nothing tells: m², rad²."""


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """What is believed about the errors of pointing."""

    sigma_rad: Array
    """Standard deviations of one pointing, sideways and upwards, rad. Shape (2)."""
    independent_hz: float
    """Independent pointings per second of a hold."""
    body_sigma_m: float
    """Standard deviation of the horizontal position of the eyes over the feet, m."""
    model_sigma_rad: float
    """Standard deviation of an error of the ray that is constant in {H}, as of eyes or finger, rad."""
    latency_sigma_s: float
    """Standard deviation of the delay between rays and target reports that have equal stamps, s."""


def effective_samples(blocks: Blocks, rate_hz: float) -> Array:
    """Return how many independent pointings each block is worth, m; a hold is worth one at least."""
    worth = np.maximum(1.0, rate_hz * blocks.held_s)
    hold = blocks.hold.astype(np.intp)
    return np.asarray(worth[hold] / np.bincount(hold)[hold], dtype=np.float64)


def covariance(
    rays: Rays, pose: Array, worth: Array, weights: Weights, doubt: NoiseModel, *, velocities_mps: Array
) -> tuple[Array, Array]:
    """Return the covariance (5 x 5) of `pose`, `VAGUE` where nothing is known, and the latency's part of it.

    The yaw is that of pointing: an error of the model that turns all rays alike is in the yaw when the
    person points later, too, and does not count.

    Args:
        rays: m blocks.
        pose: where the descent ended, 5.
        worth: of each block, see `effective_samples`.
        weights: for the priors.
        doubt: about the errors of pointing.
        velocities_mps: of the targets, m x 3.
    """
    angles, jacobian = (values[0] for values in residuals(rays, pose[None]))
    flat = jacobian.reshape(PARAMETERS, -1)
    # what the descent did with an error of a ray, and how large such errors are
    sizes = np.hypot(*(angles / weights.sigma_rad))
    weighted = flat * (huber_weight(sizes) / weights.sigma_rad**2).ravel()
    answer, untold = _inverse(weighted @ flat.T + np.diag(weights.prior))
    told = max(float(worth.sum()) - 2.0, 0.0)  # two of the four that are sought are told by each angle
    squares = (worth * np.minimum(angles**2, (GROSS * doubt.sigma_rad[:, None]) ** 2)).sum(axis=1)
    freedom = BELIEF + told - 2.0  # the scatter itself is only estimated: Student's variance, not Gauss's
    variance = (BELIEF * doubt.sigma_rad**2 + squares) / freedom
    variance = np.maximum(variance, (LEAST * doubt.sigma_rad) ** 2)
    scattered = (weighted * (variance[:, None] / worth).ravel()) @ weighted.T
    out = answer @ (scattered + np.diag(weights.prior)) @ answer
    cos_az, sin_az = rays.inverse_azimuth.real, -rays.inverse_azimuth.imag
    cos_el, sin_el = rays.elevation_phasor.real, rays.elevation_phasor.imag
    # a constant shift of the finger forwards, or to the left, turns each ray by so much
    turned = np.stack([-sin_az, cos_az])
    lifted = -sin_el * np.stack([cos_az, sin_az])
    moved = answer @ weighted @ np.concatenate([turned, lifted], axis=1).T
    moved[2] += (turned / np.maximum(cos_el, STEEP)).mean(axis=1)
    out = out + doubt.model_sigma_rad**2 * moved @ moved.T
    # a target that moves changes the residuals as a move of the person and the floor the other way does
    passed = np.einsum("pan,np->an", jacobian[[0, 1, 4]], velocities_mps)
    shift = answer @ weighted @ passed.ravel()  # of the pose, per second of latency
    late = doubt.latency_sigma_s**2 * np.outer(shift, shift)
    out += late
    out += VAGUE * untold @ untold.T
    out[[0, 1], [0, 1]] += doubt.body_sigma_m**2
    return np.asarray(0.5 * (out + out.T), dtype=np.float64), np.asarray(late, dtype=np.float64)


def _inverse(information: Array) -> tuple[Array, Array]:
    """Return the inverse of a symmetric matrix along what it tells, and the directions that it does not tell.

    Returns:
        5 x 5, 0 along the others; 5 x j, of length 1.
    """
    if not np.all(np.isfinite(information)):
        return np.zeros_like(information), np.eye(PARAMETERS)
    values, vectors = np.linalg.eigh(information)
    told = values > NOTHING
    known = vectors[:, told]
    return np.asarray((known / values[told]) @ known.T, dtype=np.float64), vectors[:, ~told]
