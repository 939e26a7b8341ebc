"""Settings, inputs and results of the drift filter, and the prediction of its state."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

X, Y, YAW, RATE = range(4)
"""State indices: m, m, rad, rad/s."""


@dataclass(frozen=True, kw_only=True)
class DriftSettings:
    """Noise of drift, of standing people and of pointing, and limits of the filter."""

    rate_sigma_radps: float = math.radians(0.25)
    """Standard deviation of the yaw rate of an unknown IMU."""
    rate_walk_radps: float = math.radians(0.002)
    """Random walk of the rate: standard deviation after one second, growing with the square root of time."""
    max_rate_radps: float = math.radians(1.0)
    """Fastest drift of an IMU, and upper bound of the rate's standard deviation."""
    yaw_walk_rad: float = math.radians(0.06)
    """Random walk of the yaw besides its rate: standard deviation after one second (0.5° in a minute)."""
    position_walk_m: float = 0.0065
    """Random walk of a standing person: standard deviation after one second (5 cm in a minute)."""
    anchor_sigma_rad: float = math.radians(3.5)
    """Standard deviation of one pointing sideways, as an angle at the eyes."""
    elevation_sigma_rad: float = math.radians(3.0)
    """The same upwards: scatter within a person and the unknown part of their bias."""
    gate: float = 3.0
    """Measurements beyond this number of standard deviations are rejected."""
    accept_after: int = 2
    """Number of consecutive rejected anchors that are accepted if they agree."""
    confirmed_after: int = 3
    """Number of consecutive yaws that confirm a rate. Two determine one even if the IMU jumped."""
    confirming_s: float = 15.0
    """Shortest time between yaws that confirm a rate."""
    reset_after: int = 3
    """Number of consecutive contradicting anchors after which the pose becomes uncertain."""
    moved_sigma_m: float = 0.5
    """Standard deviation of a person's move when anchors no longer fit."""
    turned_sigma_rad: float = math.radians(15.0)
    """Standard deviation of an IMU's turn when anchors contradict each other."""
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
        return math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1])))


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


def predicted(
    mean: Array, covariance: Array, passed_s: float, settings: DriftSettings
) -> tuple[Array, Array]:
    """Return copies of mean (4) and covariance (4 x 4) advanced by `passed_s`, bounded."""
    mean, covariance = propagate_unbounded(mean, covariance, passed_s, settings)
    return mean, bounded(covariance, settings) if passed_s > 0.0 else covariance


def propagate_unbounded(
    mean: Array, covariance: Array, passed_s: float, settings: DriftSettings
) -> tuple[Array, Array]:
    """Return copies of mean (4) and covariance (4 x 4) advanced by `passed_s`, not bounded."""
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
    """Return `covariance` (3 x 3 of x, y, yaw, or 4 x 4 with the rate) symmetric and within the bounds.

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
        ValueError: If it is not 3 x 3 or not finite.
    """
    square = np.asarray(covariance, dtype=np.float64)
    if square.shape != (3, 3) or not np.all(np.isfinite(square)):
        raise ValueError("the covariance of a pose must be 3 x 3 and finite")
    values, axes = np.linalg.eigh(0.5 * (square + square.T))
    return np.asarray((axes * np.maximum(values, 0.0)) @ axes.T)
