"""Uncertainty of a person's position on the floor and yaw, and of a place that they point at."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pointit.geometry.vector import Vec3

ROBOT_PLACE_SIGMA_M = 0.5
"""Default of the largest uncertainty of a place for a robot, 1 sigma along its worse direction, m."""


def position_sigma_m(covariance: ArrayLike) -> float:
    """Return 1 sigma of a position on the floor along its worse direction, m.

    Args:
        covariance: of (x, y, yaw) of the pose, (3, 3), or row by row: 9 numbers.
    """
    xx, xy, _, _, yy = np.ravel(covariance)[:5].tolist()
    largest_eigenvalue = (xx + yy) / 2.0 + math.hypot((xx - yy) / 2.0, xy)
    return math.sqrt(max(0.0, largest_eigenvalue))


def yaw_sigma_rad(covariance: Sequence[float]) -> float:
    """Return 1 sigma of a yaw, by the `covariance` of (x, y, yaw), row by row; 0 of a negative variance."""
    return math.sqrt(max(0.0, covariance[8]))


def place_sigma_m(
    place_m: Vec3,
    position_m: Vec3,
    covariance: Sequence[float],
    origin_m: Vec3,
    aim_sigma_rad: float,
    *,
    is_level: bool = True,
) -> float:
    """Return 1 sigma of a pointed place along its worse direction, m.

    Combines the covariance of the person's position and yaw at the place, and their aim, which spreads
    across the ray by the range alone. On a level surface it spreads along the ray by 1/sin of its slope, and
    the result is infinite for a level ray.

    Args:
        place_m: the place, {W}.
        position_m: position of the person, {W}.
        covariance: of (x, y, yaw) of the person's pose, row by row: 9 numbers.
        origin_m: where the ray begins, {W}.
        aim_sigma_rad: 1 sigma of the person's aim.
        is_level: False for a surface that faces the person.
    """
    # Position and yaw of the person: a turn moves the place sideways by its distance
    offset = np.array(place_m) - np.array(position_m)
    jacobian = np.array([[1.0, 0.0, -offset[1]], [0.0, 1.0, offset[0]]])
    place_covariance = jacobian @ np.array(covariance).reshape(3, 3) @ jacobian.T

    # Aim, along the ray and across it
    reach = np.array(place_m) - np.array(origin_m)
    range_m = float(np.linalg.norm(reach))
    level_m = float(np.hypot(reach[0], reach[1]))
    aim_m = aim_sigma_rad * range_m
    if aim_m > 0.0:
        slope = abs(float(reach[2])) / range_m if is_level else 1.0
        if slope < 1e-6:
            return math.inf
        ahead = reach[:2] / level_m if level_m > 0.0 else np.array([1.0, 0.0])
        across = np.array([-ahead[1], ahead[0]])
        variance_ahead = (aim_m / slope) ** 2 * np.outer(ahead, ahead)
        variance_across = aim_m**2 * np.outer(across, across)
        place_covariance += variance_ahead + variance_across

    # Rounding may leave it unsymmetric, and an exact one slightly negative
    symmetric = (place_covariance + place_covariance.T) / 2.0
    largest_eigenvalue = float(np.linalg.eigvalsh(symmetric)[-1])
    return math.sqrt(max(0.0, largest_eigenvalue))
