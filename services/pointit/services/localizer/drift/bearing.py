"""Pointing at a known place, as the drift filter predicts it."""

import math

import numpy as np

from pointit.services.localizer.drift.model import RATE, YAW, AnchorMeasurement, Array, X, Y
from pointit.services.localizer.drift.state import Innovation


def innovation(means: Array, measurement: AnchorMeasurement, late_s: float) -> Innovation:
    """Return azimuth and elevation of a pointing, `late_s` old, minus those that each state expects."""
    then = means.copy()
    then[:, YAW] -= late_s * then[:, RATE]
    expected, slope, _ = predicted_bearing(then, measurement)
    slope[:, :, RATE] = -late_s * slope[:, :, YAW]
    value = np.array([measurement.azimuth_rad, measurement.elevation_rad]) - expected
    value[:, 0] = np.remainder(value[:, 0] + math.pi, math.tau) - math.pi
    return Innovation(value, slope)


def predicted_bearing(means: Array, measurement: AnchorMeasurement) -> tuple[Array, Array, Array]:
    """Return the bearing of the target from the person's eyes.

    Args:
        means: n x 5, states; only x, y (m) and yaw (rad) of {H} in {W} count.
        measurement: target and origin of the ray.

    Returns:
        azimuth and elevation in {H} (n x 2), their derivatives by the states (n x 2 x 5), horizontal
        distances (n), m.
    """
    yaw = means[:, YAW]
    cos_yaw, sin_yaw = np.cos(yaw), np.sin(yaw)
    eye_x = cos_yaw * measurement.origin_m[0] - sin_yaw * measurement.origin_m[1]
    eye_y = sin_yaw * measurement.origin_m[0] + cos_yaw * measurement.origin_m[1]
    east = measurement.target_m[0] - means[:, X] - eye_x
    north = measurement.target_m[1] - means[:, Y] - eye_y
    up = measurement.target_m[2] - measurement.origin_m[2]
    away = np.maximum(np.hypot(east, north), 1e-9)
    square = away * away
    lower = -up / (square + up * up)
    slope = np.zeros((len(means), 2, means.shape[1]))
    slope[:, 0, X], slope[:, 0, Y] = north / square, -east / square
    slope[:, 0, YAW] = -1.0 - (east * eye_x + north * eye_y) / square
    slope[:, 1, X], slope[:, 1, Y] = -lower * east / away, -lower * north / away
    slope[:, 1, YAW] = lower * (east * eye_y - north * eye_x) / away
    return np.stack([np.arctan2(north, east) - yaw, np.arctan2(up, away)], axis=1), slope, away
