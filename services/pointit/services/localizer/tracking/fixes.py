"""Conversion of poses to fixes of the drift filter, and the uncertainty of poses that were set."""

import math

import numpy as np

from pointit.schemas import UserPose
from pointit.services.localizer.drift.filter import Fix
from pointit.services.localizer.estimation.angular_residuals import Array

GIVEN_SIGMA_M = 0.05
GIVEN_SIGMA_RAD = math.radians(15.0)
"""Standard deviations of a pose that was set, once pointing corrects it."""

FIX_COVARIANCE: Array = np.diag([GIVEN_SIGMA_M**2, GIVEN_SIGMA_M**2, GIVEN_SIGMA_RAD**2])
"""The same as a covariance of x, y, yaw."""


def is_exact(pose: UserPose) -> bool:
    """Return True if `pose` was set as exact, rather than found."""
    return pose.method == "fixed" and not any(pose.covariance)


def to_fix(pose: UserPose, covariance: Array, stamp_ns: int) -> Fix:
    """Return `pose` as it was at `stamp_ns`, with `covariance` (3 x 3)."""
    return Fix(
        x_m=pose.position_m[0],
        y_m=pose.position_m[1],
        yaw_rad=pose.yaw_rad,
        covariance=covariance,
        stamp_ns=stamp_ns,
        floor_m=pose.position_m[2],
        is_anchored=pose.method in ("static_targets", "moving_target"),
    )
