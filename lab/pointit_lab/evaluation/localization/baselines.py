"""Baselines from the literature (pointing.md §4): minimise the mean angle by BFGS, starting at zero.

No elevation bias, no covariance, no refusal, one start, numeric gradients.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from pointit.geometry.array_types import Array
from pointit.services.localizer.estimation.estimator import Pointings


@dataclass(frozen=True, kw_only=True)
class BaselineEstimate:
    """A pose without uncertainty."""

    x_m: float
    y_m: float
    z_m: float
    """Height of the feet."""
    yaw_rad: float


def mean_angle_4dof(pointings: Pointings) -> BaselineEstimate:
    """Return x, y, z and yaw with the least mean angle between rays and targets."""
    x, y, z, yaw = _descended(pointings, 4)
    return BaselineEstimate(x_m=x, y_m=y, z_m=z, yaw_rad=yaw)


def mean_angle_z0(pointings: Pointings) -> BaselineEstimate:
    """Return the same with the feet at z = 0, as in the ROS 2 toolkit."""
    x, y, yaw = _descended(pointings, 3)
    return BaselineEstimate(x_m=x, y_m=y, z_m=0.0, yaw_rad=yaw)


def mean_angle(pointings: Pointings, x: float, y: float, z: float, yaw: float) -> float:
    """Return the mean angle between the rays and the directions from a pose to the targets, rad."""
    cos_yaw = np.cos(yaw)
    sin_yaw = np.sin(yaw)
    away = pointings.targets_m - (x, y, z)
    seen = np.empty_like(away)
    seen[:, 0] = cos_yaw * away[:, 0] + sin_yaw * away[:, 1]
    seen[:, 1] = cos_yaw * away[:, 1] - sin_yaw * away[:, 0]
    seen[:, 2] = away[:, 2]
    seen -= pointings.origins_m
    rays = pointings.directions
    # as |a x b|² = |a|² |b|² - (a·b)², and b is a unit vector
    ahead = np.einsum("ij,ij->i", seen, rays)
    square = np.einsum("ij,ij->i", seen, seen)
    aside: Array = np.sqrt(np.maximum(0.0, square - ahead * ahead))
    return float(np.mean(np.arctan2(aside, ahead)))


def _descended(pointings: Pointings, parameters: int) -> tuple[float, ...]:
    def cost(pose: Array) -> float:
        z = float(pose[2]) if parameters == 4 else 0.0
        return mean_angle(pointings, float(pose[0]), float(pose[1]), z, float(pose[-1]))

    # a line search may fail at a kink of the angle; the best point so far is then the result
    found = minimize(cost, np.zeros(parameters), method="BFGS")
    return tuple(np.asarray(found.x, dtype=np.float64).tolist())
