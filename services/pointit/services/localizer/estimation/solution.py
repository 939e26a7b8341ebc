"""Settings of the solver, and its results: a pose, or the reason why there is none."""

import cmath
import math
from dataclasses import dataclass, field, replace
from statistics import NormalDist

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import PARAMETERS, Array, Complex, Rays
from pointit.services.localizer.estimation.levenberg_marquardt import SAME_POSE, Weights
from pointit.services.localizer.estimation.refinement import NoiseModel
from pointit.services.localizer.estimation.sample_blocks import Pointings

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
            needed = self.min_right_probability
            is_timely = float(np.linalg.norm(pose.latency_shift[:2])) <= MAX_LATENCY_SHIFT_M
            return needed == 0.0 or (is_timely and pose.right_probability >= needed)
        is_certain = pose.position_sigma_m <= self.max_position_sigma_m
        return is_certain and pose.yaw_sigma_rad <= self.max_yaw_sigma_rad

    def weights(self) -> Weights:
        """Return the weights of the descent."""
        prior = np.zeros(PARAMETERS)
        prior[3], prior[4] = self.bias_sigma_rad**-2, max(self.height_sigma_m, KNOWN) ** -2
        return Weights(sigma_rad=np.array([[self.ray_sigma_rad], [self.elevation_sigma_rad]]), prior=prior)

    def noise_model(self, *, is_still: bool) -> NoiseModel:
        """Return the noise model for targets at rest or moving."""
        sideways = self.act_sigma_rad if is_still else self.ray_sigma_rad
        sigmas = (
            *(self.bias_sigma_rad, self.height_sigma_m),
            self.rate_sigma_radps,
            0.0 if is_still else self.latency_sigma_s,
        )
        return NoiseModel(
            sigma_rad=np.array([sideways, self.elevation_sigma_rad]),
            independent_hz=0.0 if is_still else self.independent_hz,  # a reach errs until the next one
            body_sigma_m=self.body_sigma_m,
            considered=np.array(
                [self.model_sigma_rad] * 2 + [self.elevation_slope_sigma, self.azimuth_slope_sigma]
            ),
            prior=np.array([0.0, 0.0, 0.0, *(max(sigma, KNOWN) ** -2 for sigma in sigmas)]),
        )

    def rays(self, pointings: Pointings, centre: Array) -> Rays:
        """Return `pointings` less what is expected of the person, with targets relative to `centre` (3)."""
        rays = Rays.of(pointings.origins_m, pointings.directions, pointings.targets_m - centre)
        return replace(rays, elevations_rad=rays.elevations_rad - self.bias_rad) if self.bias_rad else rays

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
        (xx, xy), (_, yy) = self.covariance[:2, :2].tolist()
        return math.sqrt(max(0.0, 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)))

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
        covariance = self.scatter * self.timely + np.outer(self.latency_shift, self.latency_shift)
        values, vectors = np.linalg.eigh(covariance)
        x, y, yaw_rad = vectors * np.sqrt(np.maximum(values, 0.0)) @ DRAWS.T
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
        off = np.array([self.x_m - other.x_m, self.y_m - other.y_m, 0.0])
        off[2] = math.remainder(self.yaw_rad - other.yaw_rad, math.tau)
        both = self.timely + other.timely
        both[2, 2] += drift_rad**2
        return float(off @ np.linalg.solve(both, off))

    @property
    def yaw_sigma_rad(self) -> float:
        """Return the standard deviation of the yaw."""
        return math.sqrt(max(0.0, float(self.covariance[2, 2])))


def right_share(shift_m: Complex, turned_rad: Array) -> float:
    """Return the share of `THINGS` that people select who stand and are turned otherwise than assumed (k)."""
    rays: Complex = (THINGS[:, None] - shift_m) * np.exp(-1j * turned_rad) * np.conj(THINGS)[:, None]
    return float(np.mean(rays.real >= math.cos(math.pi / len(THINGS)) * np.abs(rays)))


@dataclass(frozen=True)
class Refusal:
    """A rejected pose with its reason."""

    reason: str
    """The problem and what to do."""
    residual_rad: float | None = None
