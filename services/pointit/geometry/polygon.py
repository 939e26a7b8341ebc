"""Polygons on the floor: inside, distance to a point and to a segment, crossings of the outline."""

import math
from collections.abc import Sequence
from itertools import combinations, pairwise

Vec2 = tuple[float, float]

ROUNDING_M = 1e-9
"""Distance that may be lost by rounding."""
TINY = 1e-30
"""Replaces the squared length of an edge without length."""


class Polygon:
    """The area inside a closed outline, convex or not, in either order."""

    def __init__(self, outline_m: Sequence[Vec2]) -> None:
        """Create from the corners, at least three; the last is joined to the first."""
        self.corners_m: tuple[Vec2, ...] = tuple(outline_m)
        self.edges_m: tuple[tuple[Vec2, Vec2], ...] = tuple(pairwise((*self.corners_m, self.corners_m[0])))
        """Start and end of each edge."""

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
            if _do_intersect(*self.edges_m[first], *self.edges_m[second]):
                return first, second
        return None


def _nearest_on(a: Vec2, b: Vec2, point_m: Vec2) -> Vec2:
    ux, uy = b[0] - a[0], b[1] - a[1]
    along = ((point_m[0] - a[0]) * ux + (point_m[1] - a[1]) * uy) / max(ux * ux + uy * uy, TINY)
    along = min(max(along, 0.0), 1.0)
    return (a[0] + along * ux, a[1] + along * uy)


def point_segment_m(point_m: Vec2, start_m: Vec2, end_m: Vec2) -> float:
    """Return the distance from a point to a segment."""
    return math.dist(_nearest_on(start_m, end_m, point_m), point_m)


def _segments_apart_m(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> float:
    if _do_intersect(a, b, c, d):
        return 0.0
    return min(
        point_segment_m(c, a, b), point_segment_m(d, a, b), point_segment_m(a, c, d), point_segment_m(b, c, d)
    )


def _side(a: Vec2, b: Vec2, c: Vec2) -> float:
    """Return a number above 0 if c is left of the line from a to b, below 0 if it is right of it."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _do_intersect(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> bool:
    abc, abd, cda, cdb = _side(a, b, c), _side(a, b, d), _side(c, d, a), _side(c, d, b)
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
