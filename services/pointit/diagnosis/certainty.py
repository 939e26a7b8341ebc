"""How sure a person's pose is, from the bus and from the localizer's health, and when that is too little."""

import math

import numpy as np

from pointit.schemas import Health, UserPose
from pointit.services.localizer.estimation.estimator import SolverSettings
from pointit.services.localizer.procedures.target_plan import TargetPlan

UNSURE_M = SolverSettings().max_position_sigma_m
UNSURE_DEG = round(math.degrees(SolverSettings().max_yaw_sigma_rad), 6)
"""1 sigma; a pose less certain than one of these is one that the localizer would refuse."""

OLD_ANCHOR_S = 180.0
"""By then the yaw of a common IMU may be 45 deg off; no fault while the pose is still certain."""

SURE_DEG = math.degrees(TargetPlan().yaw_sigma_rad)
"""Who localizes goes on pointing until the yaw is as certain as this."""

ANCHOR_AGE, POSITION_SIGMA, YAW_SIGMA = "anchor age", "position σ", "yaw σ"  # noqa: RUF001 - the localizer's own
"""Names of the localizer's figures."""

FRAME_RATE = "frame rate"
"""Begins the name of led-driver's figure of how many frames a second a port carries; the port ends it."""


def position_sigma_m(pose: UserPose) -> float:
    """Return 1 sigma of the place along the worse direction; 0: it is taken as exact."""
    covariance = np.array(pose.covariance).reshape(3, 3)[:2, :2]
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))


def yaw_sigma_deg(pose: UserPose) -> float:
    """Return 1 sigma of the yaw; 0: it is taken as exact."""
    return math.degrees(math.sqrt(max(pose.covariance[8], 0.0)))


def figure(health: Health, name: str) -> float | None:
    """Return one of a service's own figures."""
    return next((figure.value for figure in health.figures if figure.name == name), None)
