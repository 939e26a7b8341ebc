"""Polylines by arc length: strips, belts, lanes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.vector import Vec3

Array = NDArray[np.float64]

FARTHEST_M = 1e6
"""Vertices beyond are mistakes."""
SAME_M = 1e-9
"""Vertices closer together than this are one: a step so short has no direction."""


class Polyline:
    """A line through vertices, addressed by the distance from its start."""

    def __init__(self, vertices_m: Sequence[Vec3]) -> None:
        """Take `vertices_m`, at least two, not all equal; repeated ones are dropped.

        Raises:
            ValueError: the line has no length, or goes further than can be calculated with.
        """
        points = np.asarray(vertices_m, dtype=np.float64).reshape(-1, 3)
        if not np.all(np.abs(points) <= FARTHEST_M):
            raise ValueError(f"a line's coordinates lie within {FARTHEST_M:g} m")
        keep = np.r_[True, np.any(np.abs(np.diff(points, axis=0)) > SAME_M, axis=1)]
        points = points[keep]
        if len(points) < 2:
            raise ValueError("a line needs two different vertices")
        steps = np.diff(points, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        self.vertices_m: Array = points
        """n x 3."""
        self.tangents: Array = steps / lengths[:, None]
        """(n - 1) x 3, unit, one per segment."""
        self.starts_m: Array = np.r_[0.0, np.cumsum(lengths)]
        """n: arc length at each vertex."""
        self.length_m = float(self.starts_m[-1])

    def segment_at(self, position_m: float) -> int:
        """Return the index of the segment at arc length `position_m`, clamped to the ends."""
        index = int(np.searchsorted(self.starts_m, position_m, side="right")) - 1
        return min(max(index, 0), len(self.tangents) - 1)

    def point_at(self, position_m: float) -> Vec3:
        """Return the point at arc length `position_m`, clamped to the ends."""
        position_m = min(max(position_m, 0.0), self.length_m)
        segment = self.segment_at(position_m)
        point = self.vertices_m[segment] + (position_m - self.starts_m[segment]) * self.tangents[segment]
        return (float(point[0]), float(point[1]), float(point[2]))

    def tangent_at(self, position_m: float) -> Vec3:
        """Return the unit direction of travel at arc length `position_m`."""
        tangent = self.tangents[self.segment_at(position_m)]
        return (float(tangent[0]), float(tangent[1]), float(tangent[2]))

    def points_at(self, positions_m: Array) -> Array:
        """Return the points at `positions_m` (k), as k x 3, clamped to the ends."""
        return np.column_stack(
            [np.interp(positions_m, self.starts_m, self.vertices_m[:, axis]) for axis in range(3)]
        )
