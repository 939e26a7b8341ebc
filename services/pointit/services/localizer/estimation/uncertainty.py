"""Covariance of a pose: from the rays, plus the errors that more rays do not reduce (pointing.md §4).

Four things are added to the inverse of the information: samples of a hold are correlated, so they count as
few; residuals larger than expected widen it; errors of eyes, fingers and body measures are constant, so no
number of rays removes them; and a tracker of unknown latency shifts a moving target along its way. No
residual shows that shift: on a circle it is a turn of the pose.
"""

from dataclasses import dataclass

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import PARAMETERS, Array, Rays, residuals
from pointit.services.localizer.estimation.levenberg_marquardt import Weights, huber_weight
from pointit.services.localizer.estimation.sample_blocks import Blocks

BELIEF = 4.0
"""Weight of the assumed sigmas against the residuals, in independent pointings."""

LEAST = 0.7
"""Lower bound of the residuals' sigma, as a share of the assumed one."""

GROSS = 3.0
"""Number of sigmas at which residuals are clipped as outliers."""

STEEP = 0.2
"""Lower bound of the cosine of the elevation: a steeper ray has no usable azimuth."""

NOTHING = 1e-3
"""Information (1/m², 1/rad²) below which a direction is unknown; rounding stays far below."""

VAGUE = 1e6
"""Variance of unknown directions: m², rad²."""


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """Errors of pointing."""

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
    """Return the number (m) of independent pointings of each block; at least one for each hold."""
    sample_weights = np.maximum(1.0, rate_hz * blocks.held_s)
    hold = blocks.hold.astype(np.intp)
    return np.asarray(sample_weights[hold] / np.bincount(hold)[hold], dtype=np.float64)


def covariance(
    rays: Rays,
    pose: Array,
    sample_weights: Array,
    weights: Weights,
    noise: NoiseModel,
    *,
    velocities_mps: Array,
) -> tuple[Array, Array]:
    """Return the covariance (5 x 5) of `pose`, `VAGUE` in unknown directions, and the latency's part of it.

    The yaw is that of pointing: a model error that turns all rays equally stays in the yaw when the person
    points later, and does not count.

    Args:
        rays: m blocks.
        pose: result of the descent, 5.
        sample_weights: weight of each block, see `effective_samples`.
        weights: for the priors.
        noise: errors of pointing.
        velocities_mps: of the targets, m x 3.
    """
    angles, jacobian = (values[0] for values in residuals(rays, pose[None]))
    flat = jacobian.reshape(PARAMETERS, -1)
    # effect of a ray's error on the descent, and the size of such errors
    sizes = np.hypot(*(angles / weights.sigma_rad))
    weighted = flat * (huber_weight(sizes) / weights.sigma_rad**2).ravel()
    answer, unknown = _inverse(weighted @ flat.T + np.diag(weights.prior))
    redundancy = max(float(sample_weights.sum()) - 2.0, 0.0)  # each angle determines two of the four unknowns
    squares = (sample_weights * np.minimum(angles**2, (GROSS * noise.sigma_rad[:, None]) ** 2)).sum(axis=1)
    freedom = BELIEF + redundancy - 2.0  # the scatter itself is estimated: Student's variance, not Gauss's
    variance = (BELIEF * noise.sigma_rad**2 + squares) / freedom
    variance = np.maximum(variance, (LEAST * noise.sigma_rad) ** 2)
    scattered = (weighted * (variance[:, None] / sample_weights).ravel()) @ weighted.T
    out = answer @ (scattered + np.diag(weights.prior)) @ answer
    cos_az, sin_az = rays.inverse_azimuth.real, -rays.inverse_azimuth.imag
    cos_el, sin_el = rays.elevation_phasor.real, rays.elevation_phasor.imag
    # turn of each ray by a constant shift of the finger forwards, or to the left
    turned = np.stack([-sin_az, cos_az])
    lifted = -sin_el * np.stack([cos_az, sin_az])
    moved = answer @ weighted @ np.concatenate([turned, lifted], axis=1).T
    moved[2] += (turned / np.maximum(cos_el, STEEP)).mean(axis=1)
    out = out + noise.model_sigma_rad**2 * moved @ moved.T
    # a moving target changes the residuals like the opposite movement of the person and the floor
    passed = np.einsum("pan,np->an", jacobian[[0, 1, 4]], velocities_mps)
    shift = answer @ weighted @ passed.ravel()  # of the pose, per second of latency
    late = noise.latency_sigma_s**2 * np.outer(shift, shift)
    out += late
    out += VAGUE * unknown @ unknown.T
    out[[0, 1], [0, 1]] += noise.body_sigma_m**2
    return np.asarray(0.5 * (out + out.T), dtype=np.float64), np.asarray(late, dtype=np.float64)


def _inverse(information: Array) -> tuple[Array, Array]:
    """Return the inverse of a symmetric matrix along its known directions, and the unknown directions.

    Returns:
        5 x 5, 0 along the unknown ones; 5 x j, of length 1.
    """
    if not np.all(np.isfinite(information)):
        return np.zeros_like(information), np.eye(PARAMETERS)
    values, vectors = np.linalg.eigh(information)
    is_known = values > NOTHING
    known = vectors[:, is_known]
    return np.asarray((known / values[is_known]) @ known.T, dtype=np.float64), vectors[:, ~is_known]
