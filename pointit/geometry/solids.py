"""Planes, rectangles, cylinders, boxes, spheres: intersections with rays, closest points.

The closest point by angle is on the outline: two upright lines that rays from the origin touch, and the two
rims. The lines are segments, solved in closed form. A rim is an equation of fourth degree, solved by golden
section search around its lowest samples.
The closest point of a convex solid by angle is on its outline: on an edge of a box, or on the cone that
touches a sphere. A ray from inside intersects
the wall from within.
"""

import math
from collections.abc import Iterable
from functools import lru_cache
from itertools import product
from typing import Protocol

from pointit.geometry import vector
from pointit.geometry.polyline import TINY, nearest_in_angle
from pointit.geometry.vector import Vec3

Edge = tuple[Vec3, Vec3]
"""Start of an edge, and vector to its end."""
_Outer = tuple[float, float, float, Vec3, Vec3, Vec3]
"""Edge of an outline: x, y, z of the outward normal of its plane through the origin; start, span, and start
seen from the origin."""

RIM_POINTS = 24
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
GOLDEN_STEPS = 40
"""Steps of the golden section search, which shrink the bracket by 4e-9."""
MAX_EYES = 32
"""Limit of origins of rays for which a box keeps its outline."""
GRAZING_RAD = math.radians(5.0)
"""Angle below which a trembling hand moves the intersection too much (pointing.md §5)."""

FLOOR_RAD = math.radians(5.0)
"""Slope up to which a plane is a floor on which things stand."""
LEVEL = 1e-6
"""Inclination of the normal below which a plane is level."""


def _first_ahead(first: float, last: float) -> float | None:
    """Return where a ray meets a solid, crossed from `first` to `last`, or None if that is behind it."""
    if last < max(first, 0.0):
        return None
    return first if first >= 0.0 else last


class CylinderSolid:
    """An upright cylinder, a column or a tank.

    A position on its side is (radius · azimuth, height above its foot), on its ends (x, y) from its axis.
    """

    def __init__(self, foot_m: Vec3, radius_m: float, height_m: float) -> None:
        self._foot = foot_m
        self._radius = radius_m
        self._height = height_m
        centre = vector.add(foot_m, (0.0, 0.0, height_m / 2.0))
        self.bounding_sphere = (centre, math.hypot(radius_m, height_m / 2.0))

    def contains(self, point_m: Vec3) -> bool:
        """Return True if `point_m` is inside."""
        x, y, z = vector.subtract(point_m, self._foot)
        return math.hypot(x, y) < self._radius and 0.0 < z < self._height

    def intersect(self, origin_m: Vec3, direction: Vec3) -> float | None:
        """Return the distance to the first intersection, or to the exit for a ray from inside, or None."""
        x, y, z = vector.subtract(origin_m, self._foot)
        dx, dy, dz = direction
        first = -math.inf
        last = math.inf

        # Inside the side wall: `across` is the distance of the ray's line from the axis
        level = math.hypot(dx, dy)
        if level > 1e-12:
            across = abs(x * dy - y * dx) / level
            if across > self._radius:
                return None
            middle = -(x * dx + y * dy) / level**2
            half = math.sqrt((self._radius - across) * (self._radius + across)) / level
            first = middle - half
            last = middle + half
        elif math.hypot(x, y) > self._radius:
            return None

        # Between the ends
        if abs(dz) > 1e-12:
            foot = -z / dz
            top = (self._height - z) / dz
            first = max(first, min(foot, top))
            last = min(last, max(foot, top))
        elif not 0.0 <= z <= self._height:
            return None
        return _first_ahead(first, last)

    def closest_approach(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
        """Return the closest point to a ray that does not intersect it."""
        own = vector.subtract(origin_m, self._foot)
        return vector.add(self._foot, self._closest_point(own, direction))

    def uv_at(self, point_m: Vec3) -> tuple[float, float]:
        """Return the position on its side, or on the end that is nearer to `point_m` than the side."""
        x, y, z = vector.subtract(point_m, self._foot)
        to_side_m = abs(math.hypot(x, y) - self._radius)
        to_end_m = min(abs(z), abs(self._height - z))
        if to_side_m <= to_end_m:
            return (self._radius * math.atan2(y, x), z)
        return (x, y)

    def _closest_point(self, own: Vec3, d: Vec3) -> Vec3:
        """Return the closest point to the ray from `own` along `d`, all relative to the foot."""
        best = own
        min_cost = math.inf
        for x, y, outwards in self._touched(own):
            start = (x, y, 0.0)
            span = (0.0, 0.0, self._height)
            t, cost = nearest_in_angle(vector.subtract(start, own), span, d)
            is_within_line = 0.0 < t < 1.0 and cost < 0.0
            if is_within_line and d[0] * outwards[0] + d[1] * outwards[1] >= 0.0:
                return (x, y, t * self._height)  # the cylinder is beyond the tangent plane
            if cost < min_cost:
                best = (x, y, t * self._height)
                min_cost = cost
        for z in (0.0, self._height):
            point, cost = self._on_rim(own, d, z)
            if cost < min_cost:
                best = point
                min_cost = cost
        return best

    def _touched(self, own: Vec3) -> list[tuple[float, float, tuple[float, float]]]:
        """Return the upright lines that bound the view of its side, none from above or below.

        Each comes with the direction that leads out of that view.
        """
        x, y, _ = own
        distance = math.hypot(x, y)
        if distance <= self._radius:
            return []
        sine = self._radius / distance
        length = distance * math.sqrt((1.0 - sine) * (1.0 + sine))
        azimuth = math.atan2(-y, -x)
        half = math.asin(sine)
        touched: list[tuple[float, float, tuple[float, float]]] = []
        for side in (-1.0, 1.0):
            c = math.cos(azimuth + side * half)
            s = math.sin(azimuth + side * half)
            outwards = (-side * s, side * c)
            touched.append((x + length * c, y + length * s, outwards))
        return touched

    def _on_rim(self, own: Vec3, d: Vec3, z: float) -> tuple[Vec3, float]:
        """Return the point of the rim at height `z` at the smallest angle, and minus that angle's cosine.

        Seen edge-on, its near and its far side may each have a local minimum.
        """
        step = math.tau / RIM_POINTS
        costs = [self._minus_cosine(own, d, z, step * i) for i in range(RIM_POINTS)]
        valleys: list[float] = []
        for i, cost in enumerate(costs):
            next_cost = costs[(i + 1) % RIM_POINTS]
            if cost <= costs[i - 1] and cost <= next_cost:
                valleys.append(step * i)
        min_cost, angle = min(self._nearest_around(own, d, z, valley) for valley in valleys)
        x = self._radius * math.cos(angle)
        y = self._radius * math.sin(angle)
        return (x, y, z), min_cost

    def _nearest_around(self, own: Vec3, d: Vec3, z: float, angle: float) -> tuple[float, float]:
        """Return the minimum of minus the cosine near a point of the rim, and its angle on the rim."""
        low = angle - math.tau / RIM_POINTS
        high = angle + math.tau / RIM_POINTS
        inner = high - GOLDEN * (high - low)
        outer = low + GOLDEN * (high - low)
        at_inner = self._minus_cosine(own, d, z, inner)
        at_outer = self._minus_cosine(own, d, z, outer)

        # The bracket shrinks to the side of the lower one, which then is the other inner point
        for _ in range(GOLDEN_STEPS):
            if at_inner < at_outer:
                high = outer
                outer = inner
                at_outer = at_inner
                inner = high - GOLDEN * (high - low)
                at_inner = self._minus_cosine(own, d, z, inner)
            else:
                low = inner
                inner = outer
                at_inner = at_outer
                outer = low + GOLDEN * (high - low)
                at_outer = self._minus_cosine(own, d, z, outer)
        return (at_inner, inner) if at_inner < at_outer else (at_outer, outer)

    def _minus_cosine(self, own: Vec3, d: Vec3, z: float, angle: float) -> float:
        """Return minus the cosine of the angle between `d` and a point of the rim at height `z`."""
        x = self._radius * math.cos(angle) - own[0]
        y = self._radius * math.sin(angle) - own[1]
        z -= own[2]
        dx, dy, dz = d
        along = dx * x + dy * y + dz * z
        return -along / max(math.sqrt(x * x + y * y + z * z), 1e-12)


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

    def closest_approach(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
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
        first = -math.inf
        last = math.inf
        own = self._own(origin_m)
        ahead = vector.rotate_z(direction, -self._yaw)
        for x, d, half in zip(own, ahead, self._half, strict=True):
            if abs(d) < TINY:
                if abs(x) > half:
                    return None
                continue
            near = (-half - x) / d
            far = (half - x) / d
            first = max(first, min(near, far))
            last = min(last, max(near, far))
        return _first_ahead(first, last)

    def closest_approach(self, origin_m: Vec3, direction: Vec3) -> Vec3:
        """Return the closest point to a ray that does not intersect it."""
        passed_m = self.passed_at(origin_m, direction)
        if passed_m is None:
            return self._on_edges(origin_m, direction)
        return passed_m

    def passed_at(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
        """Return the point at the smallest angle from a ray, or None if the ray intersects the box."""
        if origin_m not in self._outlines:  # eyes that move with every ray are not worth an outline
            if len(self._outlines) >= MAX_EYES:
                self._outlines.clear()
            self._outlines[origin_m] = None
            if self.intersect(origin_m, direction) is not None:
                return None
            return self._on_edges(origin_m, direction)
        outline = self._outlines[origin_m]
        if outline is None:
            outline = self._outlines[origin_m] = _outline(self._half, self._own(origin_m))

        # The outline is convex: the nearest point is on an edge that has the ray on its outer side
        x, y, z = ahead = vector.rotate_z(direction, -self._yaw)
        nearest: tuple[Vec3, Vec3, float] | None = None
        min_cost = math.inf
        for normal_x, normal_y, normal_z, start, span, reach in outline:
            if normal_x * x + normal_y * y + normal_z * z <= 0.0:
                continue
            t, cost = nearest_in_angle(reach, span, ahead)
            if cost < min_cost:
                nearest = (start, span, t)
                min_cost = cost
        if nearest is None:
            return None
        start, span, t = nearest
        return self._in_room(vector.add(start, vector.scale(span, t)))

    def _on_edges(self, origin_m: Vec3, direction: Vec3) -> Vec3:
        own = self._own(origin_m)
        ahead = vector.rotate_z(direction, -self._yaw)
        return self._in_room(nearest_on_edges(_box_edges(self._half), own, ahead))

    def uv_at(self, point_m: Vec3) -> tuple[float, float]:
        """Return the position on the face of `point_m`."""
        x, y, z = own = self._own(point_m)
        depths = [half - abs(coordinate) for coordinate, half in zip(own, self._half, strict=True)]
        face = depths.index(min(depths))
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
        first = along - half
        last = along + half
        if first >= 0.0:
            return first
        return last if last >= 0.0 else None

    def closest_approach(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
        """Return the closest point to a ray that does not intersect it."""
        reach = vector.subtract(self._center, origin_m)
        along = vector.dot(direction, reach)
        distance = vector.norm(reach)
        if distance <= self._radius:
            return None  # on its surface, pointing away

        # In the plane of ray and centre: where a line from the origin touches it, on the ray's side
        to_center = vector.scale(reach, 1.0 / distance)
        sideways = vector.subtract(direction, vector.scale(to_center, along / distance))
        if vector.norm(sideways) < 1e-12:  # pointing straight away: all sides are equal
            is_steep = abs(to_center[2]) >= 0.9
            sideways = vector.cross(to_center, (1.0, 0.0, 0.0) if is_steep else (0.0, 0.0, 1.0))
        sine = self._radius / distance
        cosine = math.sqrt((1.0 - sine) * (1.0 + sine))
        tangent_forward = vector.scale(to_center, cosine)
        tangent_sideways = vector.scale(vector.normalized(sideways), sine)
        tangent = vector.add(tangent_forward, tangent_sideways)
        return vector.add(origin_m, vector.scale(tangent, distance * cosine))

    def uv_at(self, point_m: Vec3) -> tuple[float, float]:
        """Return the lengths of the arcs from its x axis, sideways and upwards."""
        own = vector.subtract(point_m, self._center)
        return (self._radius * vector.azimuth(own), self._radius * vector.elevation(own))


def nearest_on_edges(edges: Iterable[Edge], origin_m: Vec3, direction: Vec3) -> Vec3:
    """Return the closest point of the edges to the ray."""
    best = origin_m
    min_distance = math.inf
    for start, span in edges:
        t, cost = nearest_in_angle(vector.subtract(start, origin_m), span, direction)
        if cost < min_distance:
            best = vector.add(start, vector.scale(span, t))
            min_distance = cost
    return best


@lru_cache(1024)
def _box_edges(half: Vec3) -> list[Edge]:
    """Return the edges of a box with its centre at 0: four along each axis, x first."""
    edges: list[Edge] = []
    for axis in range(3):
        first, second = _others(axis)
        for first_sign, second_sign in product((-1.0, 1.0), repeat=2):
            start = [-extent for extent in half]
            start[first] = first_sign * half[first]
            start[second] = second_sign * half[second]
            span = [0.0, 0.0, 0.0]
            span[axis] = 2.0 * half[axis]
            edges.append(((start[0], start[1], start[2]), (span[0], span[1], span[2])))
    return edges


def _others(axis: int) -> list[int]:
    return [other for other in range(3) if other != axis]


def _outline(half: Vec3, origin_m: Vec3) -> list[_Outer]:
    """Return the edges between a face seen from `origin_m` and one that is not: none for an origin inside."""
    outline: list[_Outer] = []
    for number, (start, span) in enumerate(_box_edges(half)):
        seen_faces = 0
        for axis in _others(number // 4):
            side = math.copysign(1.0, start[axis])
            seen_faces += side * origin_m[axis] > half[axis]
        if seen_faces != 1:
            continue
        reach = vector.subtract(start, origin_m)
        normal = vector.cross(reach, span)
        outward = -1.0 if vector.dot(normal, origin_m) < 0.0 else 1.0  # away from the box's centre
        normal_x, normal_y, normal_z = vector.scale(normal, outward)
        outline.append((normal_x, normal_y, normal_z, start, span, reach))
    return outline


def plane_axes(normal: Vec3) -> tuple[Vec3, Vec3]:
    """Return u and v of a plane, unit, right-handed with its normal.

    v is the direction of steepest ascent in the plane, or y if the plane is level; u is v x normal.
    """
    n = vector.normalized(normal)
    is_inclined = math.hypot(n[0], n[1]) > LEVEL
    upwards = (0.0, 0.0, 1.0) if is_inclined else (0.0, 1.0, 0.0)
    in_plane = vector.subtract(upwards, vector.scale(n, vector.dot(upwards, n)))
    v = vector.normalized(in_plane)
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
        self._grazing = math.sin(grazing_rad)
        self._half: tuple[float, float] | None = None
        self._edges: list[Edge] = []
        self.bounding_sphere = (center_m, math.inf)
        if size_m is not None:
            half_u = size_m[0] / 2.0
            half_v = size_m[1] / 2.0
            self._half = (half_u, half_v)
            self._edges = self._rim(half_u, half_v)
            self.bounding_sphere = (center_m, math.hypot(half_u, half_v))

    def contains(self, point_m: Vec3) -> bool:  # noqa: ARG002 - of every solid
        """Return False, as a plane has no inside."""
        return False

    def intersect(self, origin_m: Vec3, direction: Vec3) -> float | None:
        """Return the distance along the ray to the intersection, or None."""
        towards = vector.dot(direction, self._normal)
        if abs(towards) <= self._grazing:
            return None
        reach = vector.subtract(self._center, origin_m)
        ahead = vector.dot(reach, self._normal) / towards
        if ahead < 0.0:
            return None
        if self._half is not None:
            point = vector.add(origin_m, vector.scale(direction, ahead))
            u, v = self.uv_at(point)
            if abs(u) > self._half[0] or abs(v) > self._half[1]:
                return None
        return ahead

    def closest_approach(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
        """Return the point of its rim that is closest to the ray."""
        if self._half is None:
            return None
        if abs(vector.dot(direction, self._normal)) <= self._grazing:
            return None
        return nearest_on_edges(self._edges, origin_m, direction)

    def uv_at(self, point_m: Vec3) -> tuple[float, float]:
        """Return the position of a point, projected onto the plane."""
        own = vector.subtract(point_m, self._center)
        return (vector.dot(own, self._u), vector.dot(own, self._v))

    def _point(self, u: float, v: float) -> Vec3:
        across = vector.add(vector.scale(self._u, u), vector.scale(self._v, v))
        return vector.add(self._center, across)

    def _rim(self, half_u: float, half_v: float) -> list[Edge]:
        along_u = vector.scale(self._u, 2.0 * half_u)
        along_v = vector.scale(self._v, 2.0 * half_v)
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
