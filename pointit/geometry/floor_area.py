"""Areas on the floor that robots keep to or clear of: inside, and distances to a point and to a segment."""

import math

from pointit.geometry.solids import Polygon, Vec2, do_intersect

ROUNDING_M = 1e-9
"""Distance that may be lost by rounding."""
TINY = 1e-30
"""Replaces the squared length of an edge without length."""


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
        west, east = min(cx, dx) - reach_m, max(cx, dx) + reach_m
        south, north = min(cy, dy) - reach_m, max(cy, dy) + reach_m
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
    ux, uy = b[0] - a[0], b[1] - a[1]
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
