"""Planes, rectangles, cylinders, boxes, spheres, floor areas: intersections with rays, closest points.

The closest point by angle is on the outline: two upright lines that rays from the origin touch, and the two
rims. The lines are segments, solved in closed form. A rim is an equation of fourth degree, solved by golden
section search around its lowest samples.
The closest point of a convex solid by angle is on its outline: on an edge of a box, or on the cone that
touches a sphere. A ray from inside intersects
the wall from within.
"""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import combinations, pairwise, product
from typing import Protocol

from pointit.geometry import vector
from pointit.geometry.polyline import TINY, nearest_in_angle
from pointit.geometry.vector import Vec3

Vec2 = tuple[float, float]
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

ROUNDING_M = 1e-9
"""Distance that may be lost by rounding."""


def _first_ahead(first: float, last: float) -> float | None:
    """Return where a ray meets a solid, crossed from `first` to `last`, or None if that is behind it."""
    if last < max(first, 0.0):
        return None
    return first if first >= 0.0 else last


class Polygon:
    """The area inside a closed outline, convex or not, in either order."""

    def __init__(self, outline_m: Sequence[Vec2]) -> None:
        """Create from the corners, at least three; the last is joined to the first."""
        self.corners_m: tuple[Vec2, ...] = tuple(outline_m)
        self.edges_m: tuple[tuple[Vec2, Vec2], ...] = tuple(pairwise((*self.corners_m, self.corners_m[0])))
        """Start and end of each edge."""

    @property
    def area_m2(self) -> float:
        """Return the area inside an outline that does not cross itself."""
        return abs(sum(ax * by - bx * ay for (ax, ay), (bx, by) in self.edges_m)) / 2.0

    def crossing(self) -> tuple[int, int] | None:
        """Return the indices of two edges that cross or touch, neighbours apart, or None."""
        last = len(self.edges_m) - 1
        for first, second in combinations(range(len(self.edges_m)), 2):
            if second - first == 1 or (first == 0 and second == last):
                continue
            if do_intersect(*self.edges_m[first], *self.edges_m[second]):
                return first, second
        return None


def _side(a: Vec2, b: Vec2, c: Vec2) -> float:
    """Return a number above 0 if c is left of the line from a to b, below 0 if it is right of it."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def do_intersect(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> bool:
    """Return True if the segments from a to b and from c to d cross or touch."""
    abc = _side(a, b, c)
    abd = _side(a, b, d)
    cda = _side(c, d, a)
    cdb = _side(c, d, b)
    if abc * abd < 0.0 and cda * cdb < 0.0:
        return True
    return (
        (abc == 0.0 and _is_between(a, b, c))
        or (abd == 0.0 and _is_between(a, b, d))
        or (cda == 0.0 and _is_between(c, d, a))
        or (cdb == 0.0 and _is_between(c, d, b))
    )


def _is_between(a: Vec2, b: Vec2, c: Vec2) -> bool:
    return min(a[0], b[0]) <= c[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= c[1] <= max(a[1], b[1])


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
        level = math.hypot(dx, dy)
        across = abs(x * dy - y * dx) / level if level > 1e-12 else math.hypot(x, y)
        if across > self._radius:
            return None
        if level > 1e-12:
            middle = -(x * dx + y * dy) / level**2
            half = math.sqrt((self._radius - across) * (self._radius + across)) / level
            first = middle - half
            last = middle + half
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
        on_side = abs(math.hypot(x, y) - self._radius) <= min(abs(z), abs(self._height - z))
        return (self._radius * math.atan2(y, x), z) if on_side else (x, y)

    def _closest_point(self, own: Vec3, d: Vec3) -> Vec3:
        best = own
        min_distance = math.inf
        for x, y, outwards in self._touched(own):
            start = (x, y, 0.0)
            span = (0.0, 0.0, self._height)
            t, cost = nearest_in_angle(vector.subtract(start, own), span, d)
            if 0.0 < t < 1.0 and cost < 0.0 and d[0] * outwards[0] + d[1] * outwards[1] >= 0.0:
                return (x, y, t * self._height)  # the cylinder is beyond the tangent plane
            if cost < min_distance:
                best = (x, y, t * self._height)
                min_distance = cost
        for z in (0.0, self._height):
            point, cost = self._on_rim(own, d, z)
            if cost < min_distance:
                best = point
                min_distance = cost
        return best

    def _touched(self, own: Vec3) -> list[tuple[float, float, tuple[float, float]]]:
        """Return the upright lines that bound the view of its side, none from above or below.

        Each comes with the direction that leads out of that view.
        """
        distance = math.hypot(own[0], own[1])
        if distance <= self._radius:
            return []
        sine = self._radius / distance
        length = distance * math.sqrt((1.0 - sine) * (1.0 + sine))
        azimuth = math.atan2(-own[1], -own[0])
        half = math.asin(sine)
        touched: list[tuple[float, float, tuple[float, float]]] = []
        for side in (-1.0, 1.0):
            c = math.cos(azimuth + side * half)
            s = math.sin(azimuth + side * half)
            touched.append((own[0] + length * c, own[1] + length * s, (-side * s, side * c)))
        return touched

    def _on_rim(self, own: Vec3, d: Vec3, z: float) -> tuple[Vec3, float]:
        """Return the point of the rim at height `z` at the smallest angle, and minus that angle's cosine.

        Seen edge-on, its near and its far side may each have a local minimum.
        """
        step = math.tau / RIM_POINTS
        costs = [self._minus_cosine(own, d, z, step * i) for i in range(RIM_POINTS)]
        valleys = [
            step * i
            for i, cost in enumerate(costs)
            if cost <= costs[i - 1] and cost <= costs[(i + 1) % RIM_POINTS]
        ]
        cost, angle = min(self._nearest_around(own, d, z, angle) for angle in valleys)
        return (self._radius * math.cos(angle), self._radius * math.sin(angle), z), cost

    def _nearest_around(self, own: Vec3, d: Vec3, z: float, angle: float) -> tuple[float, float]:
        """Return the minimum of minus the cosine near a point of the rim, and its angle on the rim."""
        low = angle - math.tau / RIM_POINTS
        high = angle + math.tau / RIM_POINTS
        inner = high - GOLDEN * (high - low)
        outer = low + GOLDEN * (high - low)
        at_inner, at_outer = (self._minus_cosine(own, d, z, at) for at in (inner, outer))
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
        x = self._radius * math.cos(angle) - own[0]
        y = self._radius * math.sin(angle) - own[1]
        z -= own[2]
        return -(d[0] * x + d[1] * y + d[2] * z) / max(math.sqrt(x * x + y * y + z * z), 1e-12)


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
        return self._on_edges(origin_m, direction) if passed_m is None else passed_m

    def passed_at(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
        """Return the point at the smallest angle from a ray, or None if the ray intersects the box."""
        if origin_m not in self._outlines:  # eyes that move with every ray are not worth an outline
            if len(self._outlines) >= MAX_EYES:
                self._outlines.clear()
            self._outlines[origin_m] = None
            met = self.intersect(origin_m, direction)
            return self._on_edges(origin_m, direction) if met is None else None
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

    def _on_edges(self, origin_m: Vec3, direction: Vec3) -> Vec3:
        own = self._own(origin_m)
        ahead = vector.rotate_z(direction, -self._yaw)
        return self._in_room(nearest_on_edges(_box_edges(self._half), own, ahead))

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

    def closest_approach(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
        """Return the closest point to a ray that does not intersect it."""
        reach = vector.subtract(self._center, origin_m)
        along = vector.dot(direction, reach)
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

    def closest_approach(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
        """Return the point of its rim that is closest to the ray."""
        if self._half is None or abs(vector.dot(direction, self._normal)) <= self._grazing:
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


class FloorArea(Polygon):
    """The area inside a closed outline, convex or not, in either order, with distances to the outline."""

    def contains(self, point_m: Vec2) -> bool:
        """Return True if `point_m` is inside (even-odd rule)."""
        x, y = point_m
        inside = False
        for (ax, ay), (bx, by) in self.edges_m:
            if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                inside = not inside
        return inside

    def nearest(self, point_m: Vec2) -> Vec2:
        """Return the point of the outline that is nearest to `point_m`."""
        return min((_nearest_on(a, b, point_m) for a, b in self.edges_m), key=lambda c: math.dist(c, point_m))

    def signed_distance_m(self, point_m: Vec2) -> float:
        """Return the distance from `point_m` to the outline, negative if the point is inside."""
        apart_m = min(math.dist(_nearest_on(a, b, point_m), point_m) for a, b in self.edges_m)
        return -apart_m if self.contains(point_m) else apart_m

    def is_apart(self, start_m: Vec2, end_m: Vec2, min_m: float) -> bool:
        """Return True if no point of a segment is nearer to the outline than `min_m`."""
        (cx, cy), (dx, dy) = start_m, end_m
        reach_m = min_m + ROUNDING_M
        west = min(cx, dx) - reach_m
        east = max(cx, dx) + reach_m
        south = min(cy, dy) - reach_m
        north = max(cy, dy) + reach_m
        for a, b in self.edges_m:
            (ax, ay), (bx, by) = a, b
            # most edges are farther along one axis alone, which is all that robots have time for
            if (ax < west and bx < west) or (ax > east and bx > east):
                continue
            if (ay < south and by < south) or (ay > north and by > north):
                continue
            if not _segments_apart_m(a, b, start_m, end_m) >= min_m:
                return False
        return True


def _nearest_on(a: Vec2, b: Vec2, point_m: Vec2) -> Vec2:
    ux = b[0] - a[0]
    uy = b[1] - a[1]
    along = ((point_m[0] - a[0]) * ux + (point_m[1] - a[1]) * uy) / max(ux * ux + uy * uy, TINY)
    along = min(max(along, 0.0), 1.0)
    return (a[0] + along * ux, a[1] + along * uy)


def point_segment_m(point_m: Vec2, start_m: Vec2, end_m: Vec2) -> float:
    """Return the distance from a point to a segment."""
    return math.dist(_nearest_on(start_m, end_m, point_m), point_m)


def _segments_apart_m(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> float:
    if do_intersect(a, b, c, d):
        return 0.0
    return min(
        point_segment_m(c, a, b), point_segment_m(d, a, b), point_segment_m(a, c, d), point_segment_m(b, c, d)
    )
