"""Settings, inputs and results of the drift filter."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.floor_sigma import position_sigma_m
from pointit.geometry.vector import Vec3

Array = NDArray[np.float64]

X, Y, YAW, RATE, CREEP = range(5)
"""State indices: m, m, rad, rad/s, rad/s. Creep is the rate at which a person's raised arm turns at rest."""


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
    pointing elsewhere than at the known place. The elevation tells which: another lamp is not as high."""
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

    def __post_init__(self) -> None:
        """Check the probability.

        Raises:
            ValueError: If a case has none.
        """
        if not 0.0 < self.rare_share < 0.5:
            raise ValueError("the share of moves and outliers must be between 0 and 0.5")


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
