"""Rest of a path: the next point, and the distance for which a robot need not slow down."""

import math
from collections.abc import Sequence
from itertools import pairwise

from pointit.geometry import vector
from pointit.geometry.vector import Vec3

PASS_M = 0.1
"""Distance at which a point that is not the last one has been reached, m."""
SHARP_RAD = math.radians(20.0)
"""Turn at a point of the path from which the robot stops there, as it would leave the path otherwise."""


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
