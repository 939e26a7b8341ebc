"""State of the drift filter: a Gaussian mixture of x, y, yaw, yaw rate and creep.

Each measurement splits every component into cases (nothing unusual; the yaw leaped or the person moved; the
person pointed elsewhere), weighs them by their likelihood and keeps the most probable (a Gaussian sum filter:
Alspach and Sorenson, 1972). The pose is that of the most probable component, and the covariance about it
has all the others: their mean would be where hardly any of them is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.floor_sigma import position_sigma_m
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S

X, Y, YAW, RATE, CREEP = range(5)
"""State indices: m, m, rad, rad/s, rad/s. Creep is the rate at which a person's raised arm turns at rest."""

MAX_COMPONENTS = 8
"""Number of components that are kept."""

MIN_WEIGHT = 1e-6
"""Components that are less probable are dropped."""

MIN_SIGMA = 1e-6
"""Lower bound of measurement noise (rad, rad/s, m)."""


@dataclass(frozen=True, kw_only=True)
class DriftSettings:
    """Noise of drift, of standing people and of pointing, and limits of the filter."""

    rate_sigma_radps: float = math.radians(0.25)
    """Standard deviation of the yaw rate of an unknown IMU."""
    rate_walk_radps: float = math.radians(0.01)
    """Random walk of the rate: standard deviation after one second, growing with the square root of time."""
    max_rate_radps: float = math.radians(1.0)
    """Fastest drift of an IMU, and upper bound of the rate's standard deviation."""
    yaw_walk_rad: float = math.radians(0.06)
    """Random walk of the yaw besides its rate: standard deviation after one second (0.5° in a minute)."""
    position_walk_m: float = 0.0065
    """Random walk of a standing person: standard deviation after one second (5 cm in a minute)."""
    anchor_sigma_rad: float = math.radians(3.0)
    """Standard deviation of one pointing sideways, as an angle at the eyes."""
    elevation_sigma_rad: float = math.radians(3.0)
    """The same upwards: scatter within a person and the unknown part of their bias."""
    creep_sigma_radps: float = math.radians(0.2)
    """Standard deviation, between people, of the rate at which a raised arm creeps."""
    gate: float = 3.0
    """Rests beyond this number of standard deviations are rejected."""
    rare_share: float = 0.05
    """Probability that the yaw leaped or the person moved between two measurements of the yaw, and that of
    pointing elsewhere than at the known place. The elevation shows which: another lamp is not as high."""
    moved_sigma_m: float = 0.3
    turned_sigma_rad: float = math.radians(60.0)
    """Standard deviations of such a move and leap, and of pointing elsewhere."""
    outlier_elevation_sigma_rad: float = math.radians(10.0)
    """The same of pointing elsewhere, upwards."""
    max_late_s: float = 5.0
    """Measurements older than this are rejected."""
    max_elevation_rad: float = math.radians(70.0)
    """Steeper rays do not determine an azimuth."""
    max_position_sigma_m: float = 100.0
    max_yaw_sigma_rad: float = math.pi
    """Upper bounds of the standard deviations."""


@dataclass(frozen=True, kw_only=True)
class Fix:
    """A pose from outside the filter: a localization, the operator or a tracker."""

    x_m: float
    y_m: float
    yaw_rad: float
    covariance: Array
    """3 x 3, of x, y, yaw; positive semidefinite; zero if exact."""
    stamp_ns: int
    since_ns: int | None = None
    """Stamp of its first ray, ns. None if all were measured at `stamp_ns`."""
    until_ns: int | None = None
    """Stamp of its last ray, ns. None if all were measured at `stamp_ns`."""
    floor_m: float = 0.0
    """Height of the feet in {W}."""
    is_anchored: bool = True
    """True if it was measured by pointing at known places."""


@dataclass(frozen=True, kw_only=True)
class DriftPose:
    """The pose at one time."""

    x_m: float
    y_m: float
    yaw_rad: float
    """In [-π, π]."""
    covariance: Array
    """3 x 3, of x, y, yaw."""
    yaw_rate_radps: float
    """Rate of `yaw_rad`: minus the drift rate of the IMU's own yaw."""
    yaw_rate_sigma_radps: float
    anchored_ns: int
    """Time of the last anchor or heading; 0: never."""
    stamp_ns: int

    @property
    def yaw_sigma_rad(self) -> float:
        """Return the standard deviation of the yaw."""
        return math.sqrt(max(0.0, float(self.covariance[2, 2])))

    @property
    def position_sigma_m(self) -> float:
        """Return the standard deviation along the worse horizontal direction."""
        return position_sigma_m(self.covariance)


@dataclass(frozen=True, kw_only=True)
class AnchorMeasurement:
    """One pointing at a known place."""

    stamp_ns: int
    target_m: Vec3
    """In {W}, above the floor."""
    origin_m: Vec3
    """Origin of the ray, {H}."""
    azimuth_rad: float
    """Azimuth of the ray, {H}."""
    elevation_rad: float
    """Elevation of the ray without the person's bias, {H}."""
    spread_rad: float


@dataclass(frozen=True, kw_only=True)
class AnchorResult:
    """Result of a measurement."""

    accepted: bool
    azimuth_error_rad: float = 0.0
    """Target minus ray in the pose before; positive: the target is to the left."""
    elevation_error_rad: float = 0.0
    """Target minus ray; positive: the target is higher."""
    reason: str = ""
    """Reason for rejection and what to do, or `""` if accepted."""
    note: str = ""
    """Remark on an accepted measurement for technicians, mostly `""`."""


class Innovation(NamedTuple):
    """A measurement of k values compared with each of n components."""

    value: Array
    """n x k: measured minus expected."""
    slope: Array
    """n x k x 5, derivatives of the expected values by the state."""


@dataclass(frozen=True)
class Case:
    """One explanation of a measurement of k values."""

    share: float
    """Prior probability."""
    noise: Array
    """k x k, covariance of the measurement."""
    widened: Array
    """5, variances by which the state changed before it."""


class DriftState:
    """The mixture at one time. It predicts and applies measurements; the caller names the cases."""

    def __init__(self, fix: Fix, settings: DriftSettings) -> None:
        """Start at `fix` with an IMU of unknown drift."""
        self._settings = settings
        self.weights: Array = np.ones(1)
        """n, sum 1, the largest first."""
        yaw_rad = math.remainder(fix.yaw_rad, math.tau)
        self.means: Array = np.array([[fix.x_m, fix.y_m, yaw_rad, 0.0, 0.0]])
        """n x 5."""
        self.covariances: Array = np.zeros((1, 5, 5))
        """n x 5 x 5."""
        self.covariances[0, :3, :3] = nearest_psd(fix.covariance)
        self.covariances[0, RATE, RATE] = settings.rate_sigma_radps**2
        self.covariances[0, CREEP, CREEP] = settings.creep_sigma_radps**2
        self.stamp_ns = fix.stamp_ns
        self._bound()

    def late_s(self, stamp_ns: int) -> float:
        """Return the age of a measurement at `stamp_ns` relative to the state, s; at least 0."""
        return max(0, self.stamp_ns - stamp_ns) / NS_PER_S

    def moments(self) -> tuple[Array, Array]:
        """Return the likeliest state (5) and the covariance (5 x 5) of the mixture about it."""
        return _moments(self.weights, self.means, self.covariances, self._settings)

    def at(self, now_ns: int, anchored_ns: int) -> DriftPose:
        """Return the pose at `now_ns` or the last measurement, whichever is later; the state stays."""
        passed_s = max(0, now_ns - self.stamp_ns) / NS_PER_S
        means, covariances = self._predicted(passed_s)
        mean, covariance = _moments(self.weights, means, covariances, self._settings)
        rate_variance = max(0.0, float(covariance[RATE, RATE]))
        return DriftPose(
            x_m=float(mean[X]),
            y_m=float(mean[Y]),
            yaw_rad=float(mean[YAW]),
            covariance=covariance[:3, :3].copy(),
            yaw_rate_radps=float(mean[RATE]),
            yaw_rate_sigma_radps=math.sqrt(rate_variance),
            anchored_ns=anchored_ns,
            stamp_ns=max(now_ns, self.stamp_ns),
        )

    def advance(self, stamp_ns: int) -> None:
        """Advance to `stamp_ns` if that is later."""
        if stamp_ns > self.stamp_ns:
            passed_s = (stamp_ns - self.stamp_ns) / NS_PER_S
            self.means, self.covariances = self._predicted(passed_s)
            self.stamp_ns = stamp_ns

    def innovation_sigmas(self, seen: Innovation, noise: Array) -> Array:
        """Return the standard deviations (k) of an innovation in the whole mixture; `noise` is k x k."""
        totals = seen.slope @ self.covariances @ seen.slope.swapaxes(1, 2) + noise
        variances = np.diagonal(totals, axis1=1, axis2=2)
        mean = self.weights @ seen.value
        squares = variances + (seen.value - mean) ** 2
        return np.asarray(np.sqrt(self.weights @ squares))

    def update(self, seen: Innovation, cases: Sequence[Case]) -> Array:
        """Apply a measurement (Joseph form: stays symmetric and positive).

        Args:
            seen: innovation of each component.
            cases: their shares need not sum to 1.

        Returns:
            posterior probabilities of the cases.
        """
        value, slope = seen
        slope_transposed = slope.swapaxes(1, 2)
        case_means = list[Array]()
        case_covariances = list[Array]()
        case_scores = list[Array]()
        for case in cases:
            # Kalman gain of each component, widened by what happened before in this case
            least_noise = np.eye(len(case.noise)) * MIN_SIGMA**2
            noise = case.noise + least_noise
            widened = self.covariances + np.diag(case.widened)
            total = slope @ widened @ slope_transposed + noise
            gain = np.linalg.solve(total, slope @ widened).swapaxes(1, 2)

            keep = np.eye(5) - gain @ slope
            kept = keep @ widened @ keep.swapaxes(1, 2)
            added = gain @ noise @ gain.swapaxes(1, 2)
            case_means.append(self.means + np.einsum("nik,nk->ni", gain, value))
            case_covariances.append(kept + added)

            # Log of the posterior weight, up to a common constant
            whitened = np.linalg.solve(total, value[..., None])[..., 0]
            mahalanobis = np.sum(whitened * value, axis=1)
            _, log_det = np.linalg.slogdet(total)
            log_likelihood = -0.5 * (mahalanobis + log_det)
            log_prior = np.log(self.weights) + math.log(case.share)
            case_scores.append(log_prior + log_likelihood)

        # Components grow by the number of cases in each update: the improbable ones are dropped. The stable
        # order makes components of equal weight the same ones on every machine.
        scores = np.concatenate(case_scores)
        weights = np.exp(scores - scores.max())
        likeliest = np.argsort(-weights, kind="stable")[:MAX_COMPONENTS]
        indices = likeliest[weights[likeliest] >= MIN_WEIGHT * weights.sum()]
        self.weights = weights[indices] / weights[indices].sum()
        self.means = np.concatenate(case_means)[indices]
        self.covariances = np.concatenate(case_covariances)[indices]
        self._bound()
        case_weights = weights.reshape(len(cases), -1).sum(axis=1)
        return np.asarray(case_weights / weights.sum())

    def forget(self, index: int, sigma: float, mean: float | None = None) -> None:
        """Drop what is known about one part of the state, with its correlations; `mean` None: it stays."""
        self.covariances[:, index, :] = self.covariances[:, :, index] = 0.0
        self.covariances[:, index, index] = sigma**2
        if mean is not None:
            self.means[:, index] = mean

    def walked(self, passed_s: float) -> Array:
        """Return the covariance (5 x 5) that random walks add in `passed_s`."""
        settings = self._settings
        rate_variance = settings.rate_walk_radps**2 * passed_s
        yaw_variance = settings.yaw_walk_rad**2 * passed_s
        added = np.zeros((5, 5))
        added[[X, Y], [X, Y]] = settings.position_walk_m**2 * passed_s
        added[YAW, YAW] = yaw_variance + rate_variance * passed_s**2 / 3.0
        added[YAW, RATE] = added[RATE, YAW] = rate_variance * passed_s / 2.0
        added[RATE, RATE] = rate_variance
        return added

    def _predicted(self, passed_s: float) -> tuple[Array, Array]:
        if passed_s <= 0.0:
            return self.means, self.covariances
        step = np.eye(5)
        step[YAW, RATE] = passed_s
        covariances = step @ self.covariances @ step.T + self.walked(passed_s)
        return self.means @ step.T, bounded(covariances, self._settings)

    def _bound(self) -> None:
        limit = self._settings.max_rate_radps
        rates = self.means[:, RATE]
        self.means[:, RATE] = np.clip(rates, -limit, limit)
        self.covariances = bounded(self.covariances, self._settings)


def _moments(
    weights: Array, means: Array, covariances: Array, settings: DriftSettings
) -> tuple[Array, Array]:
    """Return the first component's mean (5) and the covariance (5 x 5) of a mixture about it."""
    offsets = means - means[0]
    mean = means[0].copy()
    yaw_offsets = offsets[:, YAW]
    offsets[:, YAW] = np.remainder(yaw_offsets + math.pi, math.tau) - math.pi
    mean[YAW] = math.remainder(float(mean[YAW]), math.tau)
    spreads = offsets[:, :, None] * offsets[:, None, :]
    covariance = np.einsum("n,nij->ij", weights, covariances + spreads)
    return mean, bounded(covariance, settings)


def bounded(covariance: Array, settings: DriftSettings) -> Array:
    """Return covariances (3 x 3 of x, y, yaw, or n x 5 x 5 of states) symmetric and within the bounds.

    Correlations stay.
    """
    position = settings.max_position_sigma_m
    rate = settings.max_rate_radps
    max_sigmas = np.array([position, position, settings.max_yaw_sigma_rad, rate, rate])
    max_sigmas = max_sigmas[: covariance.shape[-1]]
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    sigmas = np.sqrt(np.maximum(variances, 1e-300))
    shrink = np.minimum(1.0, max_sigmas / sigmas)
    symmetric = 0.5 * (covariance + covariance.swapaxes(-1, -2))
    shrink_pairs = shrink[..., :, None] * shrink[..., None, :]
    return np.asarray(symmetric * shrink_pairs)


def nearest_psd(covariance: Array) -> Array:
    """Return the nearest symmetric positive semidefinite matrix."""
    values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return np.asarray((axes * np.maximum(values, 0.0)) @ axes.T)
