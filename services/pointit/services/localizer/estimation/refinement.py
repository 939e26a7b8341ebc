"""Refinement of a pose by what else is uncertain, and its covariance (pointing.md §4).

The descent knows x, y, yaw, bias and eye height, and takes samples as independent. Here a few Gauss-Newton
steps follow over these, the IMU's drift and the tracker's latency, each with a prior; the inverse of their
joint information is the covariance. What the rays cannot tell, as a latency on a circle at constant speed,
stays as uncertain as its prior and makes the pose as uncertain as it does.

People's slopes and an offset of the finger are considered (Schmidt-Kalman): they are not estimated, which
made poses of recorded people worse, but what they can do to the pose is in its covariance.

Errors of pointing are correlated: of following by exp(-t / τ), so that differences of neighbouring blocks
count; all rays of a hold at a target at rest are one pointing. Their size is estimated, with a prior.
"""

from dataclasses import dataclass, replace

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import PARAMETERS, Array, Rays, residuals
from pointit.services.localizer.estimation.levenberg_marquardt import huber_weight
from pointit.services.localizer.estimation.sample_blocks import Blocks

STATES = PARAMETERS + 2
"""Those of the descent; yaw rate of {H} (rad/s); latency (s)."""

STEPS = 2
"""Number of steps with one linearization: the weight of the latency's prior depends on the latency."""

ROUNDS = 2
LINEAR = 0.2
"""Largest number of linearizations; a smaller step (m, rad) needs no other one."""

DAMPING = 1.0
"""Information (1/m², 1/rad²) added in each step: what the rays hardly tell stays as the descent found it."""

BELIEF = 3.0
"""Weight of the assumed sigmas against the residuals, in measured angles."""

GROSS = 5.0
"""Number of sigmas at which residuals are clipped as outliers."""

STEEP = 0.2
"""Lower bound of the cosine of the elevation: a steeper ray has no usable azimuth."""

NOTHING = 1e-3
"""Information (1/m², 1/rad²) below which a direction is unknown; rounding stays far below."""

VAGUE = 1e6
"""Variance of unknown directions: m², rad²."""

LATENCY = STATES - 1
_EYE = np.eye(STATES)


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """Errors of pointing, and priors."""

    sigma_rad: Array
    """Standard deviations of one pointing, sideways and upwards, rad. Shape (2)."""
    independent_hz: float
    """Inverse of the correlation time of following; 0 if a hold is one pointing."""
    body_sigma_m: float
    """Standard deviation of the horizontal position of the eyes over the feet, m."""
    considered: Array
    """Standard deviations of what is not estimated, see `_considered`. Shape (4)."""
    prior: Array
    """Inverse prior variance of each state, all expected at 0; 0 if unknown. Shape (`STATES`)."""


def effective_samples(blocks: Blocks, rate_hz: float) -> Array:
    """Return the number (m) of independent pointings of each block; at least one for each hold."""
    sample_weights = np.maximum(1.0, rate_hz * blocks.held_s)
    hold = blocks.hold.astype(np.intp)
    return np.asarray(sample_weights[hold] / np.bincount(hold)[hold], dtype=np.float64)


def refine(rays: Rays, pose: Array, blocks: Blocks, noise: NoiseModel) -> tuple[Array, Array, float]:
    """Return state (`STATES`), covariance and scatter of `pose` (5) of the descent, refined.

    The scatter is the variance of the whitened innovations over the assumed one.
    Targets at rest leave the pose as it is: refined ones of recorded people were no better. The covariance is
    `VAGUE` in unknown directions. A model error that turns all rays equally is part of the yaw of pointing.
    """
    likeness, share = _correlation(blocks, noise.independent_hz)
    samples = effective_samples(blocks, noise.independent_hz)
    state = np.concatenate([pose, np.zeros(STATES - PARAMETERS)])
    rounds = ROUNDS if noise.independent_hz else 1
    while True:
        rounds -= 1
        angles, jacobian = _linearized(rays, state, blocks)
        sizes = np.hypot(*(angles / noise.sigma_rad[:, None]))
        weight, variance = huber_weight(sizes), _variance(sizes, samples)
        unit = np.sqrt(weight / max(variance, 1.0)) / noise.sigma_rad[:, None]
        flat = _independent(jacobian * unit, likeness, share).reshape(STATES, -1)
        information, slope = flat @ flat.T, flat @ _independent(angles * unit, likeness, share).ravel()
        if not np.isfinite(information).all():
            break
        prior, moved = noise.prior.copy(), np.zeros(STATES)
        for _ in range(STEPS):
            moved = -np.linalg.solve(information + _EYE * (prior + DAMPING), slope + prior * state)
            # Cauchy's tails, 1 / (σ² + x²): some trackers are late by far
            prior[LATENCY] = 1.0 / (1.0 / noise.prior[LATENCY] + (state + moved)[LATENCY] ** 2)
        state = state + moved
        if rounds == 0 or np.abs(moved[:3]).max() < LINEAR:
            break
    if not noise.independent_hz:
        state[:PARAMETERS] = pose
    out, unknown = _inverse(information + _EYE * noise.prior)
    turned = noise.considered[:, None, None] * _considered(rays)
    shifted = out @ flat @ _independent(turned * unit, likeness, share).reshape(len(turned), -1).T
    shifted[2] += (turned[:, 0] / np.maximum(rays.elevation_phasor.real, STEEP)).mean(axis=1)
    out = out + shifted @ shifted.T + VAGUE * unknown @ unknown.T
    out[0, 0] += noise.body_sigma_m**2
    out[1, 1] += noise.body_sigma_m**2
    innovations = _independent(angles * np.sqrt(weight) / noise.sigma_rad[:, None], likeness, share)
    scatter = _variance(np.hypot(*innovations), np.ones(len(weight)))
    return state, np.asarray(0.5 * (out + out.T), dtype=np.float64), scatter


def _variance(sizes: Array, sample_weights: Array) -> float:
    """Return the variance of errors of `sizes` sigmas (m), 1 if it is as assumed (Student's variance).

    The size of a person's errors is the same share of both sigmas.
    """
    squares = float((sample_weights * np.minimum(sizes, GROSS) ** 2).sum())
    freedom = max(2.0 * float(sample_weights.sum()) - PARAMETERS, 0.0)
    return (BELIEF + squares) / (BELIEF + freedom - 2.0)


def _correlation(blocks: Blocks, independent_hz: float) -> tuple[Array, Array]:
    """Return the correlation (m) of each block's errors with those before, and the square root of its weight.

    The errors of a hold at a target at rest are the same: its blocks count together as one.
    """
    hold = blocks.hold.astype(np.intp)
    if not independent_hz:
        return np.zeros(len(hold)), 1.0 / np.sqrt(np.bincount(hold)[hold])
    stamps_s = blocks.pointings.stamps_s
    steps_s = np.diff(stamps_s, prepend=stamps_s[0])
    likeness = np.where(np.diff(hold, prepend=-1) == 0, np.exp(-independent_hz * steps_s), 0.0)
    return likeness, 1.0 / np.sqrt(1.0 - likeness * likeness)


def _independent(values: Array, likeness: Array, share: Array) -> Array:
    """Return `values` (... x m) less what the ones before let expect, of equal variance."""
    out = values.copy()
    out[..., 1:] -= likeness[1:] * values[..., :-1]
    out *= share
    return out


def _linearized(rays: Rays, state: Array, blocks: Blocks) -> tuple[Array, Array]:
    """Return the residual angles (2 x m), and their derivatives by the state (`STATES` x 2 x m).

    The yaw is that of the middle of the time. A moving target changes the residuals like the opposite
    movement of the person and the floor.
    """
    stamps_s = blocks.pointings.stamps_s
    since_s = stamps_s - 0.5 * (stamps_s[0] + stamps_s[-1])
    straight = rays
    if state[PARAMETERS:].any():
        yaw_rate_radps, latency_s = state[PARAMETERS:].tolist()
        straight = replace(
            rays,
            azimuths_rad=rays.azimuths_rad + yaw_rate_radps * since_s,
            targets_m=rays.targets_m + latency_s * blocks.velocities_mps,
        )
    angles, slopes = (values[0] for values in residuals(straight, state[None, :PARAMETERS]))
    passed = np.einsum("pan,np->an", slopes[[0, 1, 4]], blocks.velocities_mps)
    out = np.empty((STATES, *angles.shape))
    out[:PARAMETERS], out[PARAMETERS], out[LATENCY] = slopes, slopes[2] * since_s, -passed
    return angles, out


def _considered(rays: Rays) -> Array:
    """Return the turn of each ray (4 x 2 x m: left, up) by what is not estimated.

    That is a shift of the finger forwards and to the left, as an angle (rad); elevations and azimuths that
    are exaggerated about their means, which the bias and the yaw take up, per rad. The exaggeration of
    azimuths fades where people point all round.
    """
    phasor = rays.inverse_azimuth.conjugate()
    cos_az, sin_az = phasor.real, phasor.imag
    cos_el, sin_el = rays.elevation_phasor.real, rays.elevation_phasor.imag
    aside = (phasor * np.conj(phasor.mean())).imag
    out = np.zeros((4, 2, len(aside)))
    out[0, 0], out[0, 1] = -sin_az, -sin_el * cos_az
    out[1, 0], out[1, 1] = cos_az, -sin_el * sin_az
    out[2, 1], out[3, 0] = rays.elevations_rad - rays.elevations_rad.mean(), aside * cos_el
    return out


def _inverse(information: Array) -> tuple[Array, Array]:
    """Return the inverse of a symmetric matrix along its known directions, and the unknown directions.

    Returns:
        n x n, 0 along the unknown ones; n x j, of length 1.
    """
    if not np.isfinite(information).all():
        return np.zeros_like(information), np.eye(len(information))
    values, vectors = np.linalg.eigh(information)
    is_known = values > NOTHING
    known = vectors[:, is_known]
    return np.asarray((known / values[is_known]) @ known.T, dtype=np.float64), vectors[:, ~is_known]
