"""Limits of a simulated robot's motion: speeds from which it can still stop, and the rest of its path."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land

STEP_S = 0.01
"""Time step of the simulation, s."""

BRAKING_SHARE = 0.5
"""Share of the acceleration with which a robot brakes for its target. The rest corrects its direction."""

APPROACH_PER_S = 3.0
"""Speed close to the target per distance, 1/s: the robot approaches it exponentially."""

PASS_M = 0.1
"""Distance at which a point that is not the last one has been reached, m."""

SHARP_RAD = math.radians(20.0)
"""Turn at a point of the path from which the robot stops there, as it would leave the path otherwise."""


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


class FollowedPath:
    """A path, and how far it has been followed."""

    def __init__(self, start_m: Vec3, points_m: Sequence[Vec3]) -> None:
        """Create a path from `start_m` through `points_m`, at least one."""
        left = [after for before, after in pairwise((start_m, *points_m)) if before != after]
        self._left = left or [points_m[-1]]
        steps = [vector.subtract(after, before) for before, after in pairwise((start_m, *self._left))]
        beyond_m = 0.0
        free: list[float] = []
        for index in range(len(steps) - 1, -1, -1):
            free.append(beyond_m)
            is_sharp = index == 0 or vector.angle_between(steps[index - 1], steps[index]) > SHARP_RAD
            beyond_m = 0.0 if is_sharp else beyond_m + vector.norm(steps[index])
        self._free_m = free[::-1]

    @property
    def line_m(self) -> tuple[Vec3, ...]:
        """Return the points not yet reached; the last one remains."""
        return tuple(self._left)

    @property
    def target_m(self) -> Vec3:
        """Return the next point."""
        return self._left[0]

    @property
    def beyond_m(self) -> float:
        """Return the distance behind the next point at which the robot must be able to stop."""
        return self._free_m[0]

    def pass_points(self, position_m: Vec3) -> None:
        """Drop the points that `position_m` has reached, except the last one."""
        while len(self._left) > 1 and vector.norm(vector.subtract(self._left[0], position_m)) <= PASS_M:
            del self._left[0], self._free_m[0]
