"""Limits of a simulated robot's motion, and the speeds from which it can still stop."""

import math
from dataclasses import dataclass

from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land

STEP_S = 0.01
"""Time step of the simulation, s."""
BRAKING_SHARE = 0.5
"""Share of the acceleration with which a robot brakes for its target. The rest corrects its direction."""
APPROACH_PER_S = 3.0
"""Speed close to the target per distance, 1/s: the robot approaches it exponentially."""


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """Limits of the norms of velocity, acceleration and jerk."""

    max_speed_mps: float
    max_acceleration_mps2: float
    max_jerk_mps3: float


def braking_speed(distance_m: float, acceleration_mps2: float) -> float:
    """Return the speed from which braking at `BRAKING_SHARE` of the acceleration ends after `distance_m`.

    It is the square root of the distance, and proportional to it close to the end, where the root is steep.
    Works for angles, too.
    """
    braking = BRAKING_SHARE * acceleration_mps2
    linear_m = braking / APPROACH_PER_S**2
    if distance_m <= linear_m:
        return APPROACH_PER_S * max(distance_m, 0.0)
    return math.sqrt(2.0 * braking * (distance_m - linear_m / 2.0))


def towards(value: float, wanted: float, step: float) -> float:
    """Return `wanted`, or the value nearest to it that is within `step` of `value`."""
    return min(max(wanted, value - step), value + step)


def ordered_speed(command: Command | None) -> float:
    """Return the speed limit of `command`, m/s, or infinity if it has none."""
    given = command.max_speed_mps if isinstance(command, (Follow, FollowPath, Land)) else None
    return math.inf if given is None else given
