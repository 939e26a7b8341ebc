"""What the drift filter is told, believes and tells, and how its state goes on with time."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

X, Y, YAW, RATE = range(4)
"""The state: m, m, rad, rad/s."""


@dataclass(frozen=True, kw_only=True)
class DriftSettings:
    """What is believed of drift, of people who stand and of pointings."""

    rate_sigma_radps: float = math.radians(0.25)
    """One sigma of the yaw rate of an IMU that nothing is known of."""
    rate_walk_radps: float = math.radians(0.002)
    """How far the rate wanders in one second, one sigma; grows with the square root of time."""
    max_rate_radps: float = math.radians(1.0)
    """No IMU drifts faster, and no rate is less known than that."""
    yaw_walk_rad: float = math.radians(0.06)
    """How far the yaw wanders beside its rate in one second, one sigma (0.5° in a minute)."""
    position_walk_m: float = 0.0065
    """How far a standing person shifts in one second, one sigma (5 cm in a minute)."""
    anchor_sigma_rad: float = math.radians(3.5)
    """One sigma of one pointing sideways, as an angle at the eyes."""
    elevation_sigma_rad: float = math.radians(3.0)
    """The same upwards: scatter within a person and what is not known of their bias."""
    gate: float = 3.0
    """Measurements farther off are rejected, sigmas."""
    accept_after: int = 2
    """So many rejected anchors in a row that say the same are believed."""
    confirmed_after: int = 3
    """A yaw rate is confirmed by so many yaws in a row: two tell it, even if the IMU jumped."""
    confirming_s: float = 15.0
    """Yaws closer together in time tell too little of the rate to confirm it."""
    reset_after: int = 3
    """After so many in a row that contradict each other the pose is no longer trusted."""
    moved_sigma_m: float = 0.5
    """How far a person may have moved when anchors do not fit any more, one sigma."""
    turned_sigma_rad: float = math.radians(15.0)
    """How far the IMU may have been turned when anchors contradict each other, one sigma."""
    max_late_s: float = 5.0
    """Measurements older than this are refused."""
    max_elevation_rad: float = math.radians(70.0)
    """Steeper rays do not tell a direction."""
    max_position_sigma_m: float = 100.0
    max_yaw_sigma_rad: float = math.pi
    """The uncertainties grow no further."""


@dataclass(frozen=True, kw_only=True)
class Fix:
    """A pose that something outside the filter tells: a localization, the operator, a tracker."""

    x_m: float
    y_m: float
    yaw_rad: float
    covariance: Array
    """3 x 3, of x, y, yaw; positive semidefinite; zero where exact."""
    stamp_ns: int
    since_ns: int | None = None
    """Stamp of its first ray, ns. None if all were measured at `stamp_ns`."""
    until_ns: int | None = None
    """Stamp of its last ray, ns. None if all were measured at `stamp_ns`."""
    floor_m: float = 0.0
    """Height of the feet in {W}."""
    is_anchored: bool = True
    """Whether pointing at known places told it."""


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
    """Of `yaw_rad`: minus what the IMU's own yaw wanders by."""
    yaw_rate_sigma_radps: float
    anchored_ns: int
    """When pointing at a known place or direction last told the pose; 0: never."""
    stamp_ns: int

    @property
    def yaw_sigma_rad(self) -> float:
        """Return one sigma of the yaw."""
        return math.sqrt(max(0.0, float(self.covariance[2, 2])))

    @property
    def position_sigma_m(self) -> float:
        """Return one sigma along the worse horizontal direction."""
        return math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1])))


@dataclass(frozen=True, kw_only=True)
class AnchorResult:
    """What became of a measurement."""

    accepted: bool
    azimuth_error_rad: float = 0.0
    """Target less ray in the pose before; positive: the target is to the left."""
    elevation_error_rad: float = 0.0
    """The same; positive: the target is higher."""
    reason: str = ""
    """Why it was rejected and what to do, one sentence; empty when it was accepted."""
    note: str = ""
    """What a technician should know of one that was accepted, one sentence; mostly empty."""


def predicted(
    mean: Array, covariance: Array, passed_s: float, settings: DriftSettings
) -> tuple[Array, Array]:
    """Return mean (4) and covariance (4 x 4) after `passed_s`, bounded; copies."""
    mean, covariance = propagate_unbounded(mean, covariance, passed_s, settings)
    return mean, bounded(covariance, settings) if passed_s > 0.0 else covariance


def propagate_unbounded(
    mean: Array, covariance: Array, passed_s: float, settings: DriftSettings
) -> tuple[Array, Array]:
    """Return mean (4) and covariance (4 x 4) after `passed_s`, however large; copies."""
    mean = mean.copy()
    if passed_s <= 0.0:
        return mean, covariance.copy()
    mean[YAW] = math.remainder(float(mean[YAW] + mean[RATE] * passed_s), math.tau)
    step = np.eye(4)
    step[YAW, RATE] = passed_s
    covariance = step @ covariance @ step.T
    walk = settings.rate_walk_radps**2 * passed_s
    covariance[[X, Y], [X, Y]] += settings.position_walk_m**2 * passed_s
    covariance[YAW, YAW] += settings.yaw_walk_rad**2 * passed_s + walk * passed_s**2 / 3.0
    covariance[YAW, RATE] += walk * passed_s / 2.0
    covariance[RATE, YAW] += walk * passed_s / 2.0
    covariance[RATE, RATE] += walk
    return mean, covariance


def bounded(covariance: Array, settings: DriftSettings) -> Array:
    """Return it (of x, y, yaw, 3 x 3, or of the rate, too) symmetric, no sigma above its bound.

    Correlations stay.
    """
    away = settings.max_position_sigma_m
    largest = np.array([away, away, settings.max_yaw_sigma_rad, settings.max_rate_radps])
    largest = largest[: len(covariance)]
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    shrink = np.minimum(1.0, largest / sigmas)
    return np.asarray(0.5 * (covariance + covariance.T) * np.outer(shrink, shrink))


def nearest_psd(covariance: Array) -> Array:
    """Return the nearest symmetric positive semidefinite 3 x 3 matrix.

    Raises:
        ValueError: it is not 3 x 3 or not finite.
    """
    square = np.asarray(covariance, dtype=np.float64)
    if square.shape != (3, 3) or not np.all(np.isfinite(square)):
        raise ValueError("a pose's covariance is 3 x 3 and finite")
    values, axes = np.linalg.eigh(0.5 * (square + square.T))
    return np.asarray((axes * np.maximum(values, 0.0)) @ axes.T)
