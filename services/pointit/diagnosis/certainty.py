"""Certainty of a person's pose, from the bus and from the localizer's health, and its limits."""

import math

from pointit.geometry import floor_sigma
from pointit.schemas import Health, UserPose
from pointit.services.localizer.config import LocalizerConfig

_LOCALIZER = LocalizerConfig()

UNSURE_M, UNSURE_DEG = 1.2, _LOCALIZER.drift.max_yaw_sigma_deg
"""Standard deviations above which a pose is called uncertain: things 3 m away and 2 m apart are confused."""

OLD_ANCHOR_S = 180.0
"""Age of an anchor at which the yaw of a common IMU may be 45 deg off. It may still be certain."""

SURE_DEG = _LOCALIZER.enough.yaw_deg
"""Standard deviation of the yaw at which localization ends."""

ANCHOR_AGE, POSITION_SIGMA, YAW_SIGMA = "anchor age", "position σ", "yaw σ"  # noqa: RUF001 - the localizer's own
"""Names of the localizer's metrics."""


def position_sigma_m(pose: UserPose) -> float:
    """Return the standard deviation of the position along the worse direction. 0: assumed exact."""
    return floor_sigma.position_sigma_m(pose.covariance)


def yaw_sigma_deg(pose: UserPose) -> float:
    """Return the standard deviation of the yaw. 0: assumed exact."""
    return math.degrees(floor_sigma.yaw_sigma_rad(pose.covariance))


def figure(health: Health, name: str) -> float | None:
    """Return the value of a service's metric, or None."""
    return next((figure.value for figure in health.figures if figure.name == name), None)
