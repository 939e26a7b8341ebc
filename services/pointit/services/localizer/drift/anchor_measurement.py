"""One pointing at a known place as a measurement of the drift filter."""

import math
from dataclasses import dataclass

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.localizer.drift.model import RATE, YAW, Array, DriftSettings

NEAREST_M = 0.2
"""Smallest horizontal distance from the eyes to a target."""


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


def predicted_bearing(mean: Array, sight: AnchorMeasurement) -> tuple[Array, Array, float]:
    """Return the bearing of the target from the person's eyes.

    Args:
        mean: 4: x, y (m), yaw (rad) of {H} in {W}; the rest is ignored.
        sight: target and origin of the ray.

    Returns:
        azimuth and elevation in {H} (2), their derivatives by the state (2 x 4), horizontal distance (m).
    """
    cos_yaw, sin_yaw = math.cos(mean[2]), math.sin(mean[2])
    eye_x = cos_yaw * sight.origin_m[0] - sin_yaw * sight.origin_m[1]
    eye_y = sin_yaw * sight.origin_m[0] + cos_yaw * sight.origin_m[1]
    east = sight.target_m[0] - float(mean[0]) - eye_x
    north = sight.target_m[1] - float(mean[1]) - eye_y
    up = sight.target_m[2] - sight.origin_m[2]
    away = max(math.hypot(east, north), 1e-9)
    square = away * away
    azimuth = math.remainder(math.atan2(north, east) - float(mean[2]), math.tau)
    lower = -up / (square + up * up)
    slope = np.zeros((2, 4))
    slope[0, :3] = north / square, -east / square, -1.0 - (east * eye_x + north * eye_y) / square
    slope[1, :3] = (
        -lower * east / away,
        -lower * north / away,
        lower * (east * eye_y - north * eye_x) / away,
    )
    return np.array([azimuth, math.atan2(up, away)]), slope, away


def innovation_terms(
    mean: Array, sight: AnchorMeasurement, late_s: float, settings: DriftSettings
) -> tuple[Array, Array, Array]:
    """Return innovation (2), slope (2 x 4) and variances (2) of azimuth and elevation.

    Args:
        mean: the state (4).
        sight: the measurement.
        late_s: age of the measurement relative to the state, s.
        settings: noise of pointing.
    """
    mean = mean.copy()
    mean[YAW] -= late_s * mean[RATE]
    expected, slope, _ = predicted_bearing(mean, sight)
    slope[:, RATE] = -late_s * slope[:, YAW]
    innovation = np.array(
        [
            math.remainder(sight.azimuth_rad - float(expected[0]), math.tau),
            sight.elevation_rad - float(expected[1]),
        ]
    )
    level = math.cos(sight.elevation_rad)
    noise = np.array(
        [
            (settings.anchor_sigma_rad**2 + sight.spread_rad**2) / level**2,
            settings.elevation_sigma_rad**2 + sight.spread_rad**2,
        ]
    )
    return innovation, slope, noise


def rejection_reason(
    mean: Array, sight: AnchorMeasurement, direction_h: Vec3, samples: int, settings: DriftSettings
) -> str:
    """Return the reason why a pointing cannot be used, or `""` if it can."""
    values = (*sight.target_m, *sight.origin_m, *direction_h, sight.elevation_rad, sight.spread_rad)
    if samples < 1 or not all(map(math.isfinite, values)) or vector.norm(direction_h) == 0.0:
        return "no usable ray came while the person pointed; see the IMU"
    if abs(sight.elevation_rad) > settings.max_elevation_rad:
        return "the target is too steeply above or below; choose one farther away"
    if predicted_bearing(mean, sight)[2] < NEAREST_M:
        return "the person would stand on the target; choose one farther away"
    return ""
