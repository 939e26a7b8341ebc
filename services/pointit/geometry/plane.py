"""Planes and rectangles: intersection with a ray, and the closest point of their rim."""

import math

from pointit.geometry import vector
from pointit.geometry.closest import Measure
from pointit.geometry.solids import Edge, nearer, nearest_on_edges
from pointit.geometry.vector import Vec3

GRAZING_RAD = math.radians(5.0)
"""Angle below which a trembling hand moves the intersection too much (pointing.md §5)."""

FLOOR_RAD = math.radians(5.0)
"""Slope up to which a plane is a floor on which things stand."""
LEVEL = 1e-6
"""Inclination of the normal below which a plane is level."""


def plane_axes(normal: Vec3) -> tuple[Vec3, Vec3]:
    """Return u and v of a plane, unit, right-handed with its normal.

    v is the direction of steepest ascent in the plane, or y if the plane is level; u is v x normal.
    """
    n = vector.normalized(normal)
    upwards = (0.0, 0.0, 1.0) if math.hypot(n[0], n[1]) > LEVEL else (0.0, 1.0, 0.0)
    v = vector.normalized(vector.subtract(upwards, vector.scale(n, vector.dot(upwards, n))))
    return vector.cross(v, n), v


class PlaneSolid:
    """A plane, or an upright or inclined rectangle, two-sided. A position is (u, v) from its centre."""

    def __init__(
        self,
        center_m: Vec3,
        normal: Vec3,
        size_m: tuple[float, float] | None = None,
        *,
        grazing_rad: float = GRAZING_RAD,
    ) -> None:
        """Create from a point of it, its normal, and its extents along u and v, or None if unbounded.

        A ray within `grazing_rad` of it has neither an intersection nor a closest point.
        """
        self._center = center_m
        self._normal = vector.normalized(normal)
        self._u, self._v = plane_axes(normal)
        self._half = None if size_m is None else (size_m[0] / 2.0, size_m[1] / 2.0)
        self._grazing = math.sin(grazing_rad)
        self._edges: list[Edge] = [] if self._half is None else self._rim(*self._half)
        self.bounding_sphere = (center_m, math.inf if self._half is None else math.hypot(*self._half))

    def contains(self, point_m: Vec3) -> bool:  # noqa: ARG002 - of every solid
        """Return False, as a plane has no inside."""
        return False

    def intersect(self, origin_m: Vec3, direction: Vec3) -> float | None:
        """Return the distance along the ray to the intersection, or None."""
        towards = vector.dot(direction, self._normal)
        if abs(towards) <= self._grazing:
            return None
        ahead = vector.dot(vector.subtract(self._center, origin_m), self._normal) / towards
        if ahead < 0.0:
            return None
        if self._half is not None:
            u, v = self.uv_at(vector.add(origin_m, vector.scale(direction, ahead)))
            if abs(u) > self._half[0] or abs(v) > self._half[1]:
                return None
        return ahead

    def closest_approach(self, origin_m: Vec3, direction: Vec3, measure: Measure) -> Vec3 | None:
        """Return the point of its rim, or the nearest to the ray's origin, that is closest to the ray."""
        if self._half is None or abs(vector.dot(direction, self._normal)) <= self._grazing:
            return None
        found = nearest_on_edges(self._edges, origin_m, direction, measure)
        if measure == "metres":
            u, v = self.uv_at(origin_m)
            held = (min(max(u, -self._half[0]), self._half[0]), min(max(v, -self._half[1]), self._half[1]))
            found = nearer(self._point(*held), found, origin_m, direction)
        return found

    def uv_at(self, point_m: Vec3) -> tuple[float, float]:
        """Return the position of a point, projected onto the plane."""
        own = vector.subtract(point_m, self._center)
        return (vector.dot(own, self._u), vector.dot(own, self._v))

    def _point(self, u: float, v: float) -> Vec3:
        across = vector.add(vector.scale(self._u, u), vector.scale(self._v, v))
        return vector.add(self._center, across)

    def _rim(self, half_u: float, half_v: float) -> list[Edge]:
        along_u, along_v = vector.scale(self._u, 2.0 * half_u), vector.scale(self._v, 2.0 * half_v)
        corner = self._point(-half_u, -half_v)
        return [
            (corner, along_u),
            (corner, along_v),
            (self._point(-half_u, half_v), along_u),
            (self._point(half_u, -half_v), along_v),
        ]


def is_level(normal: Vec3) -> bool:
    """Return True if a plane with that normal, of any length, is level enough to stand on."""
    return abs(normal[2]) >= math.cos(FLOOR_RAD) * vector.norm(normal)
