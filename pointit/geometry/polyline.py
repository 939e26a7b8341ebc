"""Polylines by arc length: strips, belts, lanes; closest point of a segment to a ray, by angle.

A ray starts at o and has the unit direction d. A segment runs from o + a to o + a + u. Its points are
o + a + t·u with t from 0 to 1. Plain Python for single segments; `ray_cast` has the same formulas on arrays.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3

TINY = 1e-30
"""Replaces vanishing denominators, so that quotients grow large but not infinite."""


FARTHEST_M = 1e6
"""Limit of coordinates, m."""
SAME_M = 1e-9
"""Distance below which vertices are merged, m, as they have no direction."""
AT_ONCE = 500_000
"""Maximum number of pairs of point and segment in memory at once."""


class Hit(NamedTuple):
    """A point of a target, and its distances to the ray."""

    target: int
    """Index of the target."""
    position_m: float
    """Arc length along the target from its start, 0 for a point."""
    point_m: Vec3
    miss_m: float
    """Distance of the point to the ray, or to its origin if the point lies behind it."""
    miss_rad: float
    """Angle at the ray's origin between the ray and the point, 0 to pi."""
    range_m: float
    """Distance from the ray's origin to the point."""
    uv_m: tuple[float, float] | None = None
    """Position on a thing with an area, in its own two axes."""


def make_hit(target: int, position_m: float, point_m: Vec3, origin_m: Vec3, direction: Vec3) -> Hit:
    """Return the hit of `point_m` with its misses by the ray from `origin_m` along the unit `direction`."""
    px, py, pz = point_m
    ox, oy, oz = origin_m
    dx, dy, dz = direction
    x = px - ox
    y = py - oy
    z = pz - oz
    along = dx * x + dy * y + dz * z
    across = math.hypot(dy * z - dz * y, dz * x - dx * z, dx * y - dy * x)
    range_m = math.hypot(x, y, z)
    miss_m = across if along >= 0.0 else range_m
    return Hit(target, position_m, point_m, miss_m, math.atan2(across, along), range_m)


def nearest_in_angle(a: Vec3, u: Vec3, d: Vec3) -> tuple[float, float]:
    """Return t of the segment's point at the smallest angle from d, and minus that angle's cosine.

    The cosine (p + q·t) / |a + t·u|, with p = d·a and q = d·u, has a single stationary point, t = (q·a² -
    p·(a·u)) / (p·u² - q·(a·u)). A maximum counts, clamped to the segment. If it is a minimum, an end is
    nearest. The point at the ray's own origin has no angle and is chosen last.
    """
    ax, ay, az = a
    ux, uy, uz = u
    dx, dy, dz = d
    p = dx * ax + dy * ay + dz * az
    q = dx * ux + dy * uy + dz * uz
    aa = ax * ax + ay * ay + az * az
    au = ax * ux + ay * uy + az * uz
    uu = ux * ux + uy * uy + uz * uz

    # The start, then the end
    best_t = 0.0
    best_cost = -p / math.sqrt(aa) if aa > TINY else 1.0
    square = aa + (2.0 * au + uu)
    cost = -(p + q) / math.sqrt(square) if square > TINY else 1.0
    if cost < best_cost:
        best_t = 1.0
        best_cost = cost

    # The stationary point. Beyond the ends, it is an end; and so where the denominator is not positive.
    slope = p * uu - q * au
    denominator = slope if slope > TINY else TINY  # noqa: FURB136 - `max` costs as much as all this
    t = (q * aa - p * au) / denominator
    if 0.0 < t < 1.0:
        square = aa + t * (2.0 * au + t * uu)
        cost = -(p + t * q) / math.sqrt(square) if square > TINY else 1.0
        if cost < best_cost:
            best_t = t
            best_cost = cost
    return best_t, best_cost


def clip_to_reach(p: float, q: float, reach_m: float) -> tuple[float, float] | None:
    """Return the interval of t in which a segment is within `reach_m` along the ray, or None.

    Args:
        p: distance along the ray of the segment's start, d·a.
        q: additional distance of its end, d·u.
        reach_m: maximum distance along the ray.
    """
    if max(p, p + q) <= reach_m:
        return 0.0, 1.0
    if min(p, p + q) > reach_m:
        return None
    crossing = (reach_m - p) / q
    return (0.0, crossing) if q > 0.0 else (crossing, 1.0)


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
        is_new = np.any(np.abs(np.diff(points, axis=0)) > SAME_M, axis=1)
        points = points[np.r_[True, is_new]]
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
        along_m = position_m - self.starts_m[segment]
        x, y, z = (self.vertices_m[segment] + along_m * self.tangents[segment]).tolist()
        return (x, y, z)

    def tangent_at(self, position_m: float) -> Vec3:
        """Return the unit direction of travel at arc length `position_m`."""
        x, y, z = self.tangents[self.segment_at(position_m)].tolist()
        return (x, y, z)

    def points_at(self, positions_m: Array) -> Array:
        """Return the points at `positions_m` (k), as k x 3, clamped to the ends."""
        coordinates = [np.interp(positions_m, self.starts_m, axis_m) for axis_m in self.vertices_m.T]
        return np.column_stack(coordinates)

    def nearest_to(self, points_m: Array) -> tuple[Array, Array]:
        """Return the arc length nearest to each of `points_m` (k x 3), and its distance, m (k each)."""
        lengths_m = np.diff(self.starts_m)
        positions_m = np.zeros(len(points_m))
        distances_m = np.zeros(len(points_m))

        # All segments with some points at a time, which bounds the memory
        rows = max(AT_ONCE // len(lengths_m), 1)
        for start in range(0, len(points_m), rows):
            part = slice(start, start + rows)
            offsets_m = points_m[part, None, :] - self.vertices_m[None, :-1, :]
            along_m = np.clip(np.einsum("psk,sk->ps", offsets_m, self.tangents), 0.0, lengths_m)
            across_m = np.linalg.norm(offsets_m - along_m[..., None] * self.tangents, axis=2)
            segment = np.argmin(across_m, axis=1)
            point = np.arange(len(segment))
            distances_m[part] = across_m[point, segment]
            positions_m[part] = self.starts_m[segment] + along_m[point, segment]
        return positions_m, distances_m

    def is_beyond_ends(self, points_m: Array, positions_m: Array, by_m: float = 0.0) -> NDArray[np.bool_]:
        """Return True for points (k x 3, nearest at `positions_m`) more than `by_m` beyond an end."""
        before_m = (points_m - self.vertices_m[0]) @ self.tangents[0]
        after_m = (points_m - self.vertices_m[-1]) @ self.tangents[-1]
        is_before: NDArray[np.bool_] = (positions_m <= 0.0) & (before_m < -by_m)
        is_after: NDArray[np.bool_] = (positions_m >= self.length_m) & (after_m > by_m)
        return is_before | is_after
