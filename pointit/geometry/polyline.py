"""Polylines by arc length: strips, belts, lanes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.vector import Vec3

Array = NDArray[np.float64]

FARTHEST_M = 1e6
"""Limit of coordinates, m."""
SAME_M = 1e-9
"""Distance below which vertices are merged, m, as they have no direction."""
AT_ONCE = 500_000
"""Maximum number of pairs of point and segment in memory at once."""


class Polyline:
    """A line through vertices, addressed by the distance from its start."""

    def __init__(self, vertices_m: Sequence[Vec3]) -> None:
        """Create from `vertices_m`, at least two, not all equal. Repeated ones are dropped.

        Raises:
            ValueError: If the line has no length, or a coordinate exceeds the limit.
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

    def nearest_to(self, points_m: Array) -> tuple[Array, Array]:
        """Return the arc length nearest to each of `points_m` (k x 3), and its distance, m (k each)."""
        steps_m = np.diff(self.starts_m)
        positions_m, apart_m = np.zeros(len(points_m)), np.zeros(len(points_m))
        rows = max(AT_ONCE // len(steps_m), 1)
        for start in range(0, len(points_m), rows):
            part = slice(start, start + rows)
            reach_m = points_m[part, None, :] - self.vertices_m[None, :-1, :]
            along_m = np.clip(np.einsum("psk,sk->ps", reach_m, self.tangents), 0.0, steps_m)
            apart = np.linalg.norm(reach_m - along_m[..., None] * self.tangents, axis=2)
            segment = np.argmin(apart, axis=1)
            each = np.arange(len(segment))
            apart_m[part] = apart[each, segment]
            positions_m[part] = self.starts_m[segment] + along_m[each, segment]
        return positions_m, apart_m

    def is_beyond_ends(self, points_m: Array, positions_m: Array, by_m: float = 0.0) -> NDArray[np.bool_]:
        """Return True for points (k x 3, nearest at `positions_m`) more than `by_m` beyond an end."""
        before_m = (points_m - self.vertices_m[0]) @ self.tangents[0]
        after_m = (points_m - self.vertices_m[-1]) @ self.tangents[-1]
        is_before: NDArray[np.bool_] = (positions_m <= 0.0) & (before_m < -by_m)
        is_after: NDArray[np.bool_] = (positions_m >= self.length_m) & (after_m > by_m)
        return is_before | is_after
