"""Settings of the solver and its results: a refined pose, or the reason for none.

The descent knows x, y, yaw, bias and eye height, and takes samples as independent. Here a few Gauss-Newton
steps follow over these, the IMU's drift and the tracker's latency, each with a prior; the inverse of their
joint information is the covariance. What the rays cannot show, as a latency on a circle at constant speed,
stays as uncertain as its prior and makes the pose as uncertain as it does.

People's slopes and an offset of the finger are considered (Schmidt-Kalman): they are not estimated, which
made poses of recorded people worse, but what they can do to the pose is in its covariance.

Errors of pointing are correlated: of following by exp(-t / τ), so that differences of neighbouring blocks
count; all rays of a hold at a target at rest are one pointing. Their size is estimated, with a prior.
"""

import cmath
import math
from dataclasses import dataclass, field, replace
from statistics import NormalDist

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.floor_sigma import position_sigma_m
from pointit.services.localizer.estimation.levenberg_marquardt import (
    PARAMETERS,
    SAME_POSE,
    Complex,
    Rays,
    Weights,
    huber_weight,
    residuals,
)
from pointit.services.localizer.estimation.pointings import Blocks, Pointings

STATES = PARAMETERS + 2
"""Those of the descent; yaw rate of {H} (rad/s); latency (s)."""

MAX_LINEARIZATIONS = 2
CONVERGED_STEP = 0.2
"""Largest change of x, y (m) and yaw (rad) after which the linearization still holds."""

PRIOR_UPDATES = 2
"""Number of steps with one linearization: the weight of the latency's prior depends on the latency."""

DAMPING = 1.0
"""Information (1/m², 1/rad²) added in each step: what the rays hardly show stays as the descent found it."""

PRIOR_WEIGHT = 3.0
"""Weight of the assumed sigmas against the residuals, in measured angles."""

MAX_RESIDUAL_SIGMAS = 5.0
"""Residuals are clipped here, as outliers."""

MIN_COS_ELEVATION = 0.2
"""A steeper ray has no usable azimuth."""

MIN_INFORMATION = 1e-3
"""Information (1/m², 1/rad²) below which a direction is unknown; rounding stays far below."""

UNKNOWN_VARIANCE = 1e6
"""Variance of unknown directions: m², rad²."""

LATENCY = STATES - 1
_EYE = np.eye(STATES)

KNOWN = 1e-4
"""Standard deviation (m, s, rad) of what is known."""

THINGS: Complex = np.array([cmath.rect(3.0, 0.25 * math.pi * turn) for turn in range(8)], dtype=np.complex128)
"""Eight things around a person (x + iy, m) by which a pose of following is judged: robots are 2 to 4 m away.
The right one is selected if the ray is off by at most half of the angle between two of them.
"""

DRAWS: Array = np.vectorize(NormalDist().inv_cdf)(
    (0.5 + np.outer(np.arange(1, 501), 1.2207440846 ** -np.arange(1.0, 4.0))) % 1.0
)
"""Normal errors of x, y and yaw (500 x 3), evenly spread (the sequence R3 of Roberts, 2018)."""

MAX_LATENCY_SHIFT_M = 0.46
"""Largest sigma of a position by the latency alone: 3 % are more than 1 m off."""


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
    `UNKNOWN_VARIANCE` in unknown directions. A model error that turns all rays equally is part of the yaw of
    pointing.
    """
    correlation, scale = _correlation(blocks, noise.independent_hz)
    samples = effective_samples(blocks, noise.independent_hz)
    sigma_rad = noise.sigma_rad[:, None]
    max_linearizations = MAX_LINEARIZATIONS if noise.independent_hz else 1

    def whiten(values: Array) -> Array:
        return _innovations(values, correlation, scale)

    state = np.concatenate([pose, np.zeros(STATES - PARAMETERS)])
    linearizations = 0
    while True:
        # Linear system of the whitened residuals: outliers count less, and all less if they scatter more
        linearizations += 1
        residuals_rad, jacobian = _linearized(rays, state, blocks)
        residual_sigmas = np.hypot(*(residuals_rad / sigma_rad))
        weight = huber_weight(residual_sigmas)
        variance = _variance(residual_sigmas, samples)
        root_information = np.sqrt(weight / max(variance, 1.0)) / sigma_rad
        white_jacobian = whiten(jacobian * root_information).reshape(STATES, -1)
        white_residuals = whiten(residuals_rad * root_information).ravel()
        information = white_jacobian @ white_jacobian.T
        gradient = white_jacobian @ white_residuals
        if not np.isfinite(information).all():
            break

        # Damped Gauss-Newton step. The prior of the latency is Cauchy's, 1 / (σ² + x²), whose tails are
        # heavy, since some trackers are late by far. It depends on the latency that the step leads to.
        prior = noise.prior.copy()
        step = np.zeros(STATES)
        for _ in range(PRIOR_UPDATES):
            damped_information = information + _EYE * (prior + DAMPING)
            step = -np.linalg.solve(damped_information, gradient + prior * state)
            latency_s = state[LATENCY] + step[LATENCY]
            prior[LATENCY] = 1.0 / (1.0 / noise.prior[LATENCY] + latency_s**2)
        state = state + step
        has_converged = np.abs(step[:3]).max() < CONVERGED_STEP
        if has_converged or linearizations == max_linearizations:
            break
    if not noise.independent_hz:
        state[:PARAMETERS] = pose

    # Shift of the state by one sigma of each considered error (Schmidt-Kalman)
    covariance, unknown = _inverse(information + _EYE * noise.prior)
    turns_rad = noise.considered[:, None, None] * _considered(rays)
    white_turns = whiten(turns_rad * root_information).reshape(len(turns_rad), -1)
    shifts = covariance @ white_jacobian @ white_turns.T
    cos_elevations = np.maximum(rays.elevation_phasor.real, MIN_COS_ELEVATION)
    shifts[2] += (turns_rad[:, 0] / cos_elevations).mean(axis=1)

    # Add these, the unknown directions, and the eyes' position over the feet
    covariance = covariance + shifts @ shifts.T + UNKNOWN_VARIANCE * unknown @ unknown.T
    covariance[0, 0] += noise.body_sigma_m**2
    covariance[1, 1] += noise.body_sigma_m**2
    symmetric = np.asarray(0.5 * (covariance + covariance.T), dtype=np.float64)

    innovations = whiten(residuals_rad * np.sqrt(weight) / sigma_rad)
    scatter = _variance(np.hypot(*innovations), np.ones(len(weight)))
    return state, symmetric, scatter


def _variance(residual_sigmas: Array, sample_weights: Array) -> float:
    """Return the variance of `residual_sigmas` (m), 1 if it is as assumed (Student's variance).

    The size of a person's errors is the same share of both sigmas.
    """
    clipped = np.minimum(residual_sigmas, MAX_RESIDUAL_SIGMAS)
    squares = float((sample_weights * clipped**2).sum())
    degrees_of_freedom = max(2.0 * float(sample_weights.sum()) - PARAMETERS, 0.0)
    return (PRIOR_WEIGHT + squares) / (PRIOR_WEIGHT + degrees_of_freedom - 2.0)


def _correlation(blocks: Blocks, independent_hz: float) -> tuple[Array, Array]:
    """Return the correlation (m) of each block's errors with those before, and the square root of its weight.

    The errors of a hold at a target at rest are the same: its blocks count together as one.
    """
    hold = blocks.hold.astype(np.intp)
    if not independent_hz:
        blocks_of_hold = np.bincount(hold)[hold]
        return np.zeros(len(hold)), 1.0 / np.sqrt(blocks_of_hold)
    stamps_s = blocks.pointings.stamps_s
    steps_s = np.diff(stamps_s, prepend=stamps_s[0])
    is_same_hold = np.diff(hold, prepend=-1) == 0
    correlation = np.where(is_same_hold, np.exp(-independent_hz * steps_s), 0.0)
    return correlation, 1.0 / np.sqrt(1.0 - correlation * correlation)


def _innovations(values: Array, correlation: Array, scale: Array) -> Array:
    """Return `values` (... x m) minus their prediction by the previous ones, of equal variance."""
    innovations = values.copy()
    innovations[..., 1:] -= correlation[1:] * values[..., :-1]
    innovations *= scale
    return innovations


def _linearized(rays: Rays, state: Array, blocks: Blocks) -> tuple[Array, Array]:
    """Return the residual angles (2 x m), and their derivatives by the state (`STATES` x 2 x m).

    The yaw is that of the middle of the time. A moving target changes the residuals like the opposite
    movement of the person and the floor.
    """
    # Correct for the drift of the yaw and the latency of the tracker
    stamps_s = blocks.pointings.stamps_s
    middle_s = 0.5 * (stamps_s[0] + stamps_s[-1])
    since_middle_s = stamps_s - middle_s
    corrected_rays = rays
    if state[PARAMETERS:].any():
        yaw_rate_radps, latency_s = state[PARAMETERS:].tolist()
        corrected_rays = replace(
            rays,
            azimuths_rad=rays.azimuths_rad + yaw_rate_radps * since_middle_s,
            targets_m=rays.targets_m + latency_s * blocks.velocities_mps,
        )

    # The descent works on batches of poses: here of one
    batch_residuals, batch_jacobian = residuals(corrected_rays, state[None, :PARAMETERS])
    residuals_rad = batch_residuals[0]
    pose_jacobian = batch_jacobian[0]

    jacobian = np.empty((STATES, *residuals_rad.shape))
    jacobian[:PARAMETERS] = pose_jacobian
    jacobian[PARAMETERS] = pose_jacobian[2] * since_middle_s
    jacobian[LATENCY] = -np.einsum("pan,np->an", pose_jacobian[[0, 1, 4]], blocks.velocities_mps)
    return residuals_rad, jacobian


def _considered(rays: Rays) -> Array:
    """Return the turn of each ray (4 x 2 x m: left, up) by what is not estimated.

    That is a shift of the finger forwards and to the left, as an angle (rad); elevations and azimuths that
    are exaggerated about their means, which the bias and the yaw take up, per rad. The exaggeration of
    azimuths fades where people point all round.
    """
    phasor = rays.inverse_azimuth.conjugate()
    cos_azimuth = phasor.real
    sin_azimuth = phasor.imag
    cos_elevation = rays.elevation_phasor.real
    sin_elevation = rays.elevation_phasor.imag
    turns = np.zeros((4, 2, len(phasor)))

    # Finger forwards, and to the left
    turns[0, 0] = -sin_azimuth
    turns[0, 1] = -sin_elevation * cos_azimuth
    turns[1, 0] = cos_azimuth
    turns[1, 1] = -sin_elevation * sin_azimuth

    # Exaggerated elevations and azimuths
    turns[2, 1] = rays.elevations_rad - rays.elevations_rad.mean()
    mean_phasor = phasor.mean()
    from_mean = phasor * np.conj(mean_phasor)
    turns[3, 0] = from_mean.imag * cos_elevation
    return turns


def _inverse(information: Array) -> tuple[Array, Array]:
    """Return the inverse of a symmetric matrix along its known directions, and the unknown directions.

    Returns:
        n x n, 0 along the unknown ones; n x j, of length 1.
    """
    if not np.isfinite(information).all():
        return np.zeros_like(information), np.eye(len(information))
    values, vectors = np.linalg.eigh(information)
    is_known = values > MIN_INFORMATION
    known = vectors[:, is_known]
    scaled = known / values[is_known]
    inverse = np.asarray(scaled @ known.T, dtype=np.float64)
    return inverse, vectors[:, ~is_known]


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """Priors, noise and acceptance limits of the solver."""

    ray_sigma_rad: float = math.radians(2.0)
    """Standard deviation sideways of rays that follow a target (pointing.md §1: 1.8 to 3.8 degrees)."""
    elevation_sigma_rad: float = math.radians(3.0)
    """The same upwards: the elevation depends on body measures, the azimuth does not."""
    act_sigma_rad: float = math.radians(5.0)
    """Standard deviation sideways of one pointing at a target at rest (§7: 4 to 6 degrees)."""
    bias_sigma_rad: float = math.radians(10.0)
    """Standard deviation of people's elevation bias."""
    bias_rad: float = 0.0
    """Expected elevation bias."""
    elevation_slope_sigma: float = 0.15
    """Standard deviation of how much people exaggerate how high targets are: -0.33 to +0.10 of recorded
    people. 0 for a mouse."""
    azimuth_slope_sigma: float = 0.1
    """The same of how far they are aside: 0.2 to 0.3 of one person of three."""
    rate_sigma_radps: float = math.radians(0.25)
    """Standard deviation of the yaw rate of an IMU without a magnetometer."""
    body_sigma_m: float = 0.1
    """Standard deviation of the eyes' horizontal position over the feet, which more rays do not reduce."""
    height_sigma_m: float = 0.05
    """Standard deviation of the eye height above the floor; a large one leaves it free."""
    model_sigma_rad: float = 0.1
    """Standard deviation of a ray's constant error: eyes or finger 7 cm off, over an arm of 0.7 m."""
    independent_hz: float = 2.0
    """Independent pointings per second of following; a hold at a target at rest is one."""
    latency_sigma_s: float = 0.15
    """Standard deviation of the latency of reports of a moving target, if its tracker does not state it."""
    latency_s: float = 0.0
    """Expected latency of these reports against the rays."""
    min_samples: int = 20
    max_residual_rad: float = math.radians(5.0)
    """Rms angle above which the person did not follow a moving target."""
    max_act_residual_rad: float = math.radians(12.0)
    """Rms angle above which the person did not point at targets at rest."""
    bias_sigma_limit: float = 2.5
    """Standard deviations of the elevation bias from the expected one beyond which it is not pointing."""
    min_right_probability: float = 0.88
    """Probability that a person selects the one of `THINGS` that they mean, for a pose of following."""
    max_position_sigma_m: float = 1.0
    """Limit of poses of lamps: recorded ones are off by 0.2 to 0.4 m (median) where 0.5 to 1 m are stated."""
    max_yaw_sigma_rad: float = math.radians(14.0)
    trims: bool = True
    """True to try rays that miss by more again without the worst of them."""

    def trimmed(self, share: float) -> "SolverSettings":
        """Return the settings for rays without the worst, whose rms is `share` of that of all."""
        return replace(
            self,
            max_residual_rad=share * self.max_residual_rad,
            max_act_residual_rad=share * self.max_act_residual_rad,
            trims=False,
        )

    def unlimited(self) -> "SolverSettings":
        """Return the settings that accept poses of any uncertainty."""
        inf = math.inf
        return replace(self, min_right_probability=0.0, max_position_sigma_m=inf, max_yaw_sigma_rad=inf)

    def any_fit(self) -> "SolverSettings":
        """Return the settings that accept the best fit, however far the rays miss."""
        inf = math.inf
        return replace(self.unlimited(), max_residual_rad=inf, max_act_residual_rad=inf, bias_sigma_limit=inf)

    def any_bias(self) -> "SolverSettings":
        """Return the settings that accept any uncertainty and bias, but not rays that miss by more."""
        return replace(self.unlimited(), bias_sigma_limit=math.inf)

    def accepts(self, pose: "Solution") -> bool:
        """Return True if `pose` is certain enough: by `right_probability`, a pose of lamps by its sigmas."""
        if pose.scatter:
            if self.min_right_probability == 0.0:
                return True
            is_timely = float(np.linalg.norm(pose.latency_shift[:2])) <= MAX_LATENCY_SHIFT_M
            return is_timely and pose.right_probability >= self.min_right_probability
        is_certain = pose.position_sigma_m <= self.max_position_sigma_m
        return is_certain and pose.yaw_sigma_rad <= self.max_yaw_sigma_rad

    def weights(self) -> Weights:
        """Return the weights of the descent."""
        prior = np.zeros(PARAMETERS)
        prior[3] = self.bias_sigma_rad**-2
        prior[4] = max(self.height_sigma_m, KNOWN) ** -2
        return Weights(sigma_rad=np.array([[self.ray_sigma_rad], [self.elevation_sigma_rad]]), prior=prior)

    def noise_model(self, *, is_still: bool) -> NoiseModel:
        """Return the noise model for targets at rest or moving."""
        # At rest a reach errs until the next one, and a latency changes nothing
        sideways_rad = self.act_sigma_rad if is_still else self.ray_sigma_rad
        independent_hz = 0.0 if is_still else self.independent_hz
        latency_sigma_s = 0.0 if is_still else self.latency_sigma_s

        # x, y and yaw have no prior
        prior = np.zeros(STATES)
        sigmas = (self.bias_sigma_rad, self.height_sigma_m, self.rate_sigma_radps, latency_sigma_s)
        for state, sigma in enumerate(sigmas, start=3):
            prior[state] = max(sigma, KNOWN) ** -2
        finger_sigma_rad = self.model_sigma_rad
        considered = [
            finger_sigma_rad,
            finger_sigma_rad,
            self.elevation_slope_sigma,
            self.azimuth_slope_sigma,
        ]
        return NoiseModel(
            sigma_rad=np.array([sideways_rad, self.elevation_sigma_rad]),
            independent_hz=independent_hz,
            body_sigma_m=self.body_sigma_m,
            considered=np.array(considered),
            prior=prior,
        )

    def rays(self, pointings: Pointings, centre: Array) -> Rays:
        """Return `pointings` less what is expected of the person, with targets relative to `centre` (3)."""
        rays = Rays.of(pointings.origins_m, pointings.directions, pointings.targets_m - centre)
        if not self.bias_rad:
            return rays
        return replace(rays, elevations_rad=rays.elevations_rad - self.bias_rad)

    def residual_limit_rad(self, *, is_still: bool) -> float:
        """Return the rms angle up to which the person pointed at the targets, at rest or moving."""
        return self.max_act_residual_rad if is_still else self.max_residual_rad


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A pose that explains the pointings."""

    x_m: float
    y_m: float
    yaw_rad: float
    """Azimuth of {H}'s x axis in {W}, in [-π, π]."""
    bias_rad: float
    """Elevation of the person's rays above the targets."""
    covariance: Array
    """3 x 3, of x, y, yaw, with constant errors of the rays and other poses that fit about as well.

    The yaw is that of pointing: an error that turns all of a person's rays equally is part of it.
    """
    residual_rad: float
    """Rms angle between rays and targets, without the latency that they show."""
    samples: int
    z_m: float = 0.0
    """Error of the eye height from the body measures; the floor's height if that was left free."""
    z_sigma_m: float = 0.0
    bias_sigma_rad: float = 0.0
    latency_s: float = 0.0
    """Latency of the reports of a moving target against the rays."""
    latency_sigma_s: float = 0.0
    late_s: float = 0.0
    """Difference of this latency from the one expected, 0 unless the rays show it: beyond 2 sigma."""
    alternative: float = 0.0
    """Probability that the person stands at another place that fits, too."""
    scatter: float = 0.0
    """Variance of the errors of following over the assumed one, by their innovations; 0 at rest."""
    of_latency: Array = field(default_factory=lambda: np.zeros(3))
    """Covariance of x, y and yaw with the latency of the tracker."""

    @property
    def position_sigma_m(self) -> float:
        """Return the standard deviation along the worse horizontal direction."""
        return position_sigma_m(self.covariance)

    @property
    def latency_shift(self) -> Array:
        """Return the change of x, y and yaw (3) by one sigma of the latency."""
        return np.asarray(self.of_latency / max(self.latency_sigma_s, KNOWN), dtype=np.float64)

    @property
    def timely(self) -> Array:
        """Return the covariance if the latency of the tracker were known."""
        return self.covariance - np.outer(self.latency_shift, self.latency_shift)

    @property
    def right_probability(self) -> float:
        """Return the mean probability that a person who points at one of `THINGS` selects it.

        From another place that fits, too, the right one would be selected by chance: it counts as wrong.
        """
        latency_covariance = np.outer(self.latency_shift, self.latency_shift)
        covariance = self.scatter * self.timely + latency_covariance
        variances, axes = np.linalg.eigh(covariance)
        root = axes * np.sqrt(np.maximum(variances, 0.0))
        x, y, yaw_rad = root @ DRAWS.T
        return (1.0 - self.alternative) * right_share(x + 1j * y, yaw_rad)

    def is_near(self, other: "Solution") -> bool:
        """Return True if the two poses are the same for practical purposes."""
        away_m = math.hypot(self.x_m - other.x_m, self.y_m - other.y_m)
        turned_rad = abs(math.remainder(self.yaw_rad - other.yaw_rad, math.tau))
        return away_m <= SAME_POSE and turned_rad <= SAME_POSE

    def differs(self, other: "Solution", drift_rad: float = 0.0) -> float:
        """Return the squared Mahalanobis distance by both covariances; `drift_rad`: 1 sigma of turns between.

        The latency of the tracker does not count, since it moves both equally.
        """
        difference = np.array([self.x_m - other.x_m, self.y_m - other.y_m, 0.0])
        difference[2] = math.remainder(self.yaw_rad - other.yaw_rad, math.tau)
        both = self.timely + other.timely
        both[2, 2] += drift_rad**2
        return float(difference @ np.linalg.solve(both, difference))

    @property
    def yaw_sigma_rad(self) -> float:
        """Return the standard deviation of the yaw."""
        return math.sqrt(max(0.0, float(self.covariance[2, 2])))


def right_share(shift_m: Complex, turned_rad: Array) -> float:
    """Return the share of `THINGS` that people select who stand and are turned otherwise than assumed (k)."""
    things: Complex = THINGS[:, None]
    turn = np.exp(-1j * turned_rad)
    rays: Complex = (things - shift_m) * turn * np.conj(things)
    min_cosine = math.cos(math.pi / len(THINGS))
    is_right = rays.real >= min_cosine * np.abs(rays)
    return float(np.mean(is_right))


@dataclass(frozen=True)
class Refusal:
    """A rejected pose with its reason."""

    reason: str
    """The problem and what to do."""
    residual_rad: float | None = None
