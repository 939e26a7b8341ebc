"""Boxes and spheres: intersection with a ray, and the closest point to one.

The closest point of a convex solid by angle is on its outline: on an edge of a box, or on the cone that
touches a sphere. By metres it may also be inside a face, nearest to the ray's origin. A ray from inside
intersects the wall from within.
"""

import math
from collections.abc import Iterable
from functools import lru_cache
from itertools import product
from typing import Protocol

from pointit.geometry import vector
from pointit.geometry.closest import TINY, Measure, nearest_in_angle, nearest_in_metres
from pointit.geometry.vector import Vec3

Edge = tuple[Vec3, Vec3]
"""Start of an edge, and vector to its end."""

MAX_EYES = 32
"""Limit of origins of rays for which a box keeps its outline."""


class Solid(Protocol):
    """A convex solid."""

    bounding_sphere: tuple[Vec3, float]
    """Centre and radius of a bounding ball. The radius is infinite for an unbounded solid."""

    def contains(self, point_m: Vec3) -> bool:
        """Return True if `point_m` is inside."""
        ...

    def intersect(self, origin_m: Vec3, direction: Vec3) -> float | None:
        """Return the distance along the ray (unit direction) to the first intersection, or None."""
        ...

    def closest_approach(self, origin_m: Vec3, direction: Vec3, measure: Measure) -> Vec3 | None:
        """Return the closest point to a ray that does not intersect it, or None if there is none."""
        ...

    def uv_at(self, point_m: Vec3) -> tuple[float, float]:
        """Return the position of a point of its surface in its own two axes, m."""
        ...


class BoxSolid:
    """An upright box, rotated about z.

    Its own axes begin at its centre. A position is (x, y) on top and bottom, (y, z) on the faces across its x
    axis, (x, z) on those across its y axis. The face follows from the point.
    """

    def __init__(self, center_m: Vec3, size_m: Vec3, yaw_rad: float = 0.0) -> None:
        """Create from centre, extents along its own axes, and the azimuth of its x axis."""
        self._center = center_m
        self._half = vector.scale(size_m, 0.5)
        self._yaw = yaw_rad
        self._outlines: dict[Vec3, list[_Outer] | None] = {}
        """Its outlines, by the origins of rays: people's eyes mostly stay. None after the first ray."""
        self.bounding_sphere = (center_m, vector.norm(self._half))

    def contains(self, point_m: Vec3) -> bool:
        """Return True if `point_m` is inside."""
        own = self._own(point_m)
        return all(abs(x) < half for x, half in zip(own, self._half, strict=True))

    def intersect(self, origin_m: Vec3, direction: Vec3) -> float | None:
        """Return the distance to the first intersection, or to the exit for a ray from inside, or None."""
        first, last = -math.inf, math.inf
        own, ahead = self._own(origin_m), vector.rotate_z(direction, -self._yaw)
        for x, d, half in zip(own, ahead, self._half, strict=True):
            if abs(d) < TINY:
                if abs(x) > half:
                    return None
                continue
            near, far = (-half - x) / d, (half - x) / d
            first, last = max(first, min(near, far)), min(last, max(near, far))
        if last < max(first, 0.0):
            return None
        return first if first >= 0.0 else last

    def closest_approach(self, origin_m: Vec3, direction: Vec3, measure: Measure) -> Vec3:
        """Return the closest point to a ray that does not intersect it."""
        passed_m = self.passed_at(origin_m, direction) if measure == "angle" else None
        return self._on_edges(origin_m, direction, measure) if passed_m is None else passed_m

    def passed_at(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
        """Return the point at the smallest angle from a ray, or None if the ray intersects the box."""
        if origin_m not in self._outlines:  # eyes that move with every ray are not worth an outline
            if len(self._outlines) >= MAX_EYES:
                self._outlines.clear()
            self._outlines[origin_m] = None
            met = self.intersect(origin_m, direction)
            return self._on_edges(origin_m, direction, "angle") if met is None else None
        outline = self._outlines[origin_m]
        if outline is None:
            outline = self._outlines[origin_m] = _outline(self._half, self._own(origin_m))
        x, y, z = ahead = vector.rotate_z(direction, -self._yaw)
        # the outline is convex: the nearest point is on an edge that has the ray on its outer side
        passed = [edge for edge in outline if edge[0] * x + edge[1] * y + edge[2] * z > 0.0]
        if not passed:
            return None
        found = [(nearest_in_angle(reach, span, ahead), start, span) for *_, start, span, reach in passed]
        (t, _), start, span = min(found, key=lambda each: each[0][1])
        return self._in_room(vector.add(start, vector.scale(span, t)))

    def _on_edges(self, origin_m: Vec3, direction: Vec3, measure: Measure) -> Vec3:
        own, ahead = self._own(origin_m), vector.rotate_z(direction, -self._yaw)
        found = nearest_on_edges(_box_edges(self._half), own, ahead, measure)
        if measure == "metres":
            foot = tuple(min(max(x, -half), half) for x, half in zip(own, self._half, strict=True))
            found = nearer((foot[0], foot[1], foot[2]), found, own, ahead)
        return self._in_room(found)

    def uv_at(self, point_m: Vec3) -> tuple[float, float]:
        """Return the position on the face of `point_m`."""
        x, y, z = own = self._own(point_m)
        inside = [half - abs(at) for at, half in zip(own, self._half, strict=True)]
        face = inside.index(min(inside))
        return ((y, z), (x, z), (x, y))[face]

    def _own(self, point_m: Vec3) -> Vec3:
        return vector.rotate_z(vector.subtract(point_m, self._center), -self._yaw)

    def _in_room(self, own_m: Vec3) -> Vec3:
        return vector.add(self._center, vector.rotate_z(own_m, self._yaw))


class SphereSolid:
    """A sphere. A position is (radius · azimuth, radius · elevation) seen from its centre."""

    def __init__(self, center_m: Vec3, radius_m: float) -> None:
        self._center = center_m
        self._radius = radius_m
        self.bounding_sphere = (center_m, radius_m)

    def contains(self, point_m: Vec3) -> bool:
        """Return True if `point_m` is inside."""
        return math.dist(point_m, self._center) < self._radius

    def intersect(self, origin_m: Vec3, direction: Vec3) -> float | None:
        """Return the distance to the first intersection, or to the exit for a ray from inside, or None."""
        reach = vector.subtract(self._center, origin_m)
        along = vector.dot(direction, reach)
        across = vector.norm(vector.cross(direction, reach))
        if across > self._radius:
            return None
        half = math.sqrt((self._radius - across) * (self._radius + across))
        if along - half >= 0.0:
            return along - half
        return along + half if along + half >= 0.0 else None

    def closest_approach(self, origin_m: Vec3, direction: Vec3, measure: Measure) -> Vec3 | None:
        """Return the closest point to a ray that does not intersect it."""
        reach = vector.subtract(self._center, origin_m)
        along = vector.dot(direction, reach)
        if measure == "metres":
            nearest = vector.add(origin_m, vector.scale(direction, max(along, 0.0)))
            outwards = vector.normalized(vector.subtract(nearest, self._center))
            return vector.add(self._center, vector.scale(outwards, self._radius))
        distance = vector.norm(reach)
        if distance <= self._radius:
            return None  # on its surface, pointing away
        # in the plane of ray and centre: where a line from the origin touches it, on the ray's side
        to_center = vector.scale(reach, 1.0 / distance)
        sideways = vector.subtract(direction, vector.scale(to_center, along / distance))
        if vector.norm(sideways) < 1e-12:  # pointing straight away: all sides are equal
            sideways = vector.cross(
                to_center, (0.0, 0.0, 1.0) if abs(to_center[2]) < 0.9 else (1.0, 0.0, 0.0)
            )
        sine = self._radius / distance
        cosine = math.sqrt((1.0 - sine) * (1.0 + sine))
        touching = vector.add(
            vector.scale(to_center, cosine), vector.scale(vector.normalized(sideways), sine)
        )
        return vector.add(origin_m, vector.scale(touching, distance * cosine))

    def uv_at(self, point_m: Vec3) -> tuple[float, float]:
        """Return the lengths of the arcs from its x axis, sideways and upwards."""
        own = vector.subtract(point_m, self._center)
        return (self._radius * vector.azimuth(own), self._radius * vector.elevation(own))


def nearest_on_edges(edges: Iterable[Edge], origin_m: Vec3, direction: Vec3, measure: Measure) -> Vec3:
    """Return the closest point of the edges to the ray."""
    nearest = nearest_in_angle if measure == "angle" else nearest_in_metres
    best, min_distance = origin_m, math.inf
    for start, span in edges:
        t, cost = nearest(vector.subtract(start, origin_m), span, direction)
        if cost < min_distance:
            best, min_distance = vector.add(start, vector.scale(span, t)), cost
    return best


def nearer(a: Vec3, b: Vec3, origin_m: Vec3, direction: Vec3) -> Vec3:
    """Return the one of two points that is nearer to the ray, in metres."""
    return min(a, b, key=lambda point: distance_to_ray(point, origin_m, direction))


def distance_to_ray(point_m: Vec3, origin_m: Vec3, direction: Vec3) -> float:
    """Return the distance from the ray to a point."""
    ahead = max(vector.dot(direction, vector.subtract(point_m, origin_m)), 0.0)
    return math.dist(point_m, vector.add(origin_m, vector.scale(direction, ahead)))


@lru_cache(1024)
def _box_edges(half: Vec3) -> list[Edge]:
    edges: list[Edge] = []
    for axis in range(3):
        for signs in product((-1.0, 1.0), repeat=2):
            start = [sign * half[other] for sign, other in zip(signs, _others(axis), strict=True)]
            start.insert(axis, -half[axis])
            span = [2.0 * half[i] if i == axis else 0.0 for i in range(3)]
            edges.append(((start[0], start[1], start[2]), (span[0], span[1], span[2])))
    return edges


def _others(axis: int) -> list[int]:
    return [other for other in range(3) if other != axis]


_Outer = tuple[float, float, float, Vec3, Vec3, Vec3]
"""Edge of an outline: x, y, z of the outward normal of its plane through the origin; start, span, and start
seen from the origin."""


def _outline(half: Vec3, origin_m: Vec3) -> list[_Outer]:
    """Return the edges between a face seen from `origin_m` and one that is not: none for an origin inside."""
    outline: list[_Outer] = []
    for number, (start, span) in enumerate(_box_edges(half)):
        if sum(math.copysign(1.0, start[k]) * origin_m[k] > half[k] for k in _others(number // 4)) == 1:
            reach = vector.subtract(start, origin_m)
            normal = vector.cross(reach, span)
            outward = -1.0 if vector.dot(normal, origin_m) < 0.0 else 1.0  # away from the box's centre
            outline.append((*vector.scale(normal, outward), start, span, reach))
    return outline
