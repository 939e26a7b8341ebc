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

    # from the eyes of this pose to the targets, in {H}
    away = pointings.targets_m - (x, y, z)
    away_x = away[:, 0]
    away_y = away[:, 1]
    seen = np.empty_like(away)
    seen[:, 0] = cos_yaw * away_x + sin_yaw * away_y
    seen[:, 1] = cos_yaw * away_y - sin_yaw * away_x
    seen[:, 2] = away[:, 2]
    seen -= pointings.origins_m

    # as |a x b|² = |a|² |b|² - (a·b)², and b is a unit vector
    rays = pointings.directions
    ahead = np.einsum("ij,ij->i", seen, rays)
    square = np.einsum("ij,ij->i", seen, seen)
    aside_square = np.maximum(0.0, square - ahead * ahead)
    aside: Array = np.sqrt(aside_square)
    angles_rad = np.arctan2(aside, ahead)
    return float(np.mean(angles_rad))


def _descended(pointings: Pointings, parameters: int) -> tuple[float, ...]:
    """Return x, y, z if there are 4 `parameters`, and yaw with the least mean angle."""

    def cost(pose: Array) -> float:
        x, y, *_ = pose.tolist()
        yaw = float(pose[-1])
        z = 0.0
        if parameters == 4:
            z = float(pose[2])
        return mean_angle(pointings, x, y, z, yaw)

    # a line search may fail at a kink of the angle; the best point so far is then the result
    start = np.zeros(parameters)
    result = minimize(cost, start, method="BFGS")
    best = np.asarray(result.x, dtype=np.float64)
    return tuple(best.tolist())
