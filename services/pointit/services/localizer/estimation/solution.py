"""What is believed of pointing before, and what a localization comes to: a pose, or why there is none."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import PARAMETERS, Array
from pointit.services.localizer.estimation.levenberg_marquardt import SAME_POSE, Weights
from pointit.services.localizer.estimation.uncertainty import NoiseModel


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """What is believed before, and demanded after."""

    ray_sigma_rad: float = math.radians(2.0)
    """One sigma sideways of the rays that follow something (pointing.md §1: 1.8 to 3.8 degrees both ways)."""
    elevation_sigma_rad: float = math.radians(3.0)
    """The same upwards: the elevation hangs on body measures, the azimuth does not."""
    act_sigma_rad: float = math.radians(5.0)
    """One sigma sideways of one pointing at a thing that stands still (§7: 4 to 6 degrees)."""
    bias_sigma_rad: float = math.radians(10.0)
    """One sigma of people's elevation bias."""
    body_sigma_m: float = 0.1
    """One sigma of where the eyes are over the feet; no number of rays tells."""
    height_sigma_m: float = 0.05
    """One sigma of the height of the eyes over the floor; a large one leaves it free."""
    model_sigma_rad: float = 0.1
    """One sigma of a ray's constant error: eyes or finger 7 cm beside the model, over an arm of 0.7 m."""
    independent_hz: float = 2.0
    """Independent pointings per second of following; a hold at a thing that stands still is one."""
    latency_sigma_s: float = 0.15
    """One sigma of the time by which reports of a moving target are late, where its tracker does not say."""
    min_samples: int = 20
    max_residual_rad: float = math.radians(9.0)
    """Rms angle above which the person did not follow what moved."""
    max_act_residual_rad: float = math.radians(12.0)
    """The same of pointing at what stood still."""
    bias_sigma_limit: float = 2.5
    """Sigmas of the elevation bias beyond which it is no way of pointing, but of doing something else."""
    max_position_sigma_m: float = 0.8
    max_yaw_sigma_rad: float = math.radians(14.0)
    trims: bool = True
    """Whether rays that miss by more may be tried again without the worst of them."""

    def trimmed(self, share: float) -> "SolverSettings":
        """Return what is demanded of rays without the worst, whose rms is `share` of that of all."""
        return replace(
            self,
            max_residual_rad=share * self.max_residual_rad,
            max_act_residual_rad=share * self.max_act_residual_rad,
            trims=False,
        )

    def weights(self) -> Weights:
        """Return what the descent needs of it."""
        prior = np.zeros(PARAMETERS)
        prior[3], prior[4] = self.bias_sigma_rad**-2, max(self.height_sigma_m, 1e-4) ** -2
        return Weights(sigma_rad=np.array([[self.ray_sigma_rad], [self.elevation_sigma_rad]]), prior=prior)

    def noise_model(self, *, is_still: bool) -> NoiseModel:
        """Return what is believed about errors, the targets standing still or not."""
        sideways = self.act_sigma_rad if is_still else self.ray_sigma_rad
        return NoiseModel(
            sigma_rad=np.array([sideways, self.elevation_sigma_rad]),
            independent_hz=0.0 if is_still else self.independent_hz,  # a reach errs until the next one
            body_sigma_m=self.body_sigma_m,
            model_sigma_rad=self.model_sigma_rad,
            latency_sigma_s=0.0 if is_still else self.latency_sigma_s,
        )

    def residual_limit_rad(self, *, is_still: bool) -> float:
        """Return the rms angle above which nobody pointed, the targets standing still or not."""
        return self.max_act_residual_rad if is_still else self.max_residual_rad


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A pose that explains the pointings."""

    x_m: float
    y_m: float
    yaw_rad: float
    """Azimuth of {H}'s x axis in {W}, in [-π, π]."""
    bias_rad: float
    """How much higher than the targets the person's rays are."""
    covariance: Array
    """3 x 3, of x, y, yaw: what the rays cannot know is in it, and other places that fit about as well.

    The yaw is that of pointing: an error that turns all of a person's rays alike is in it, and harmless.
    """
    residual_rad: float
    """Rms angle between rays and targets."""
    samples: int
    z_m: float = 0.0
    """How much higher the eyes are than the body measures say; the floor's height if that was left free."""
    z_sigma_m: float = 0.0
    bias_sigma_rad: float = 0.0
    alternative: float = 0.0
    """Probability that the person stands at another place that fits, too."""
    late: Array = field(default_factory=lambda: np.zeros((3, 3)))
    """3 x 3: the part of `covariance` that comes from the uncertain latency of what tracks the target."""

    @property
    def position_sigma_m(self) -> float:
        """Return one sigma along the worse horizontal direction."""
        (xx, xy), (_, yy) = self.covariance[:2, :2].tolist()
        return math.sqrt(max(0.0, 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)))

    def is_near(self, other: "Solution") -> bool:
        """Return True if it makes no difference which of the two is taken."""
        away_m = math.hypot(self.x_m - other.x_m, self.y_m - other.y_m)
        turned_rad = abs(math.remainder(self.yaw_rad - other.yaw_rad, math.tau))
        return away_m <= SAME_POSE and turned_rad <= SAME_POSE

    def differs(self, other: "Solution", drift_rad: float = 0.0) -> float:
        """Return the squared Mahalanobis distance of the two poses by what both state.

        The latency of the tracker does not count: it moves both alike.

        Args:
            other: the other pose.
            drift_rad: 1 sigma by which the yaw may have changed between them.
        """
        off = np.array([self.x_m - other.x_m, self.y_m - other.y_m, 0.0])
        off[2] = math.remainder(self.yaw_rad - other.yaw_rad, math.tau)
        both = self.covariance - self.late + other.covariance - other.late
        both[2, 2] += drift_rad**2
        return float(off @ np.linalg.solve(both, off))

    @property
    def yaw_sigma_rad(self) -> float:
        """Return one sigma of the yaw."""
        return math.sqrt(max(0.0, float(self.covariance[2, 2])))


@dataclass(frozen=True)
class Refusal:
    """Why there is no pose."""

    reason: str
    """One sentence: what is wrong, what to do."""
    residual_rad: float | None = None
