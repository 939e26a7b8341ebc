"""Upright cylinders with both ends: intersection with a ray, and the closest point to one.

The closest point by angle is on the outline: two upright lines that rays from the origin touch, and the two
rims. The lines are segments, solved in closed form. A rim is an equation of fourth degree, solved by golden
section search around its lowest samples. By metres, the distance from the ray's points to a convex body falls
and then rises along the ray, so its minimum is found by bisection.
"""

import math

from pointit.geometry import vector
from pointit.geometry.closest import Measure, nearest_in_angle
from pointit.geometry.vector import Vec3

RIM_POINTS = 24
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
GOLDEN_STEPS = 40
"""Steps of the golden section search, which shrink the bracket by 4e-9."""
HALVINGS = 60


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
        first, last = -math.inf, math.inf
        level = math.hypot(dx, dy)
        across = abs(x * dy - y * dx) / level if level > 1e-12 else math.hypot(x, y)
        if across > self._radius:
            return None
        if level > 1e-12:
            middle = -(x * dx + y * dy) / level**2
            half = math.sqrt((self._radius - across) * (self._radius + across)) / level
            first, last = middle - half, middle + half
        if abs(dz) > 1e-12:
            foot, top = -z / dz, (self._height - z) / dz
            first, last = max(first, min(foot, top)), min(last, max(foot, top))
        elif not 0.0 <= z <= self._height:
            return None
        if last < max(first, 0.0):
            return None
        return first if first >= 0.0 else last

    def closest_approach(self, origin_m: Vec3, direction: Vec3, measure: Measure) -> Vec3 | None:
        """Return the closest point to a ray that does not intersect it."""
        own = vector.subtract(origin_m, self._foot)
        found = self._by_angle(own, direction) if measure == "angle" else self._by_metres(own, direction)
        return vector.add(self._foot, found)

    def uv_at(self, point_m: Vec3) -> tuple[float, float]:
        """Return the position on its side, or on the end that is nearer to `point_m` than the side."""
        x, y, z = vector.subtract(point_m, self._foot)
        on_side = abs(math.hypot(x, y) - self._radius) <= min(abs(z), abs(self._height - z))
        return (self._radius * math.atan2(y, x), z) if on_side else (x, y)

    def _by_angle(self, own: Vec3, d: Vec3) -> Vec3:
        best, min_distance = own, math.inf
        for x, y, outwards in self._touched(own):
            start, span = (x, y, 0.0), (0.0, 0.0, self._height)
            t, cost = nearest_in_angle(vector.subtract(start, own), span, d)
            if 0.0 < t < 1.0 and cost < 0.0 and d[0] * outwards[0] + d[1] * outwards[1] >= 0.0:
                return (x, y, t * self._height)  # the cylinder is beyond the tangent plane
            if cost < min_distance:
                best, min_distance = (x, y, t * self._height), cost
        for z in (0.0, self._height):
            point, cost = self._on_rim(own, d, z)
            if cost < min_distance:
                best, min_distance = point, cost
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
        azimuth, half = math.atan2(-own[1], -own[0]), math.asin(sine)
        touched: list[tuple[float, float, tuple[float, float]]] = []
        for side in (-1.0, 1.0):
            c, s = math.cos(azimuth + side * half), math.sin(azimuth + side * half)
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
        low, high = angle - math.tau / RIM_POINTS, angle + math.tau / RIM_POINTS
        inner, outer = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        at_inner, at_outer = (self._minus_cosine(own, d, z, at) for at in (inner, outer))
        for _ in range(GOLDEN_STEPS):
            if at_inner < at_outer:
                high, outer, at_outer = outer, inner, at_inner
                inner = high - GOLDEN * (high - low)
                at_inner = self._minus_cosine(own, d, z, inner)
            else:
                low, inner, at_inner = inner, outer, at_outer
                outer = low + GOLDEN * (high - low)
                at_outer = self._minus_cosine(own, d, z, outer)
        return (at_inner, inner) if at_inner < at_outer else (at_outer, outer)

    def _minus_cosine(self, own: Vec3, d: Vec3, z: float, angle: float) -> float:
        x = self._radius * math.cos(angle) - own[0]
        y = self._radius * math.sin(angle) - own[1]
        z -= own[2]
        return -(d[0] * x + d[1] * y + d[2] * z) / max(math.sqrt(x * x + y * y + z * z), 1e-12)

    def _by_metres(self, own: Vec3, d: Vec3) -> Vec3:
        centre = (0.0, 0.0, self._height / 2.0)
        low = 0.0
        high = max(0.0, vector.dot(d, vector.subtract(centre, own))) + self.bounding_sphere[1]
        for _ in range(HALVINGS):
            middle = (low + high) / 2.0
            at = vector.add(own, vector.scale(d, middle))
            if vector.dot(d, vector.subtract(at, self._nearest(at))) < 0.0:
                low = middle
            else:
                high = middle
        return self._nearest(vector.add(own, vector.scale(d, low)))

    def _nearest(self, point: Vec3) -> Vec3:
        x, y, z = point
        shrink = min(1.0, self._radius / max(math.hypot(x, y), 1e-12))
        return (x * shrink, y * shrink, min(max(z, 0.0), self._height))
