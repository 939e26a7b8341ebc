"""Areas of the floor inside a closed outline: crossings, points inside, distances."""

import math
from collections.abc import Sequence
from itertools import combinations, pairwise

from pointit.geometry.polyline import TINY

Vec2 = tuple[float, float]

ROUNDING_M = 1e-9
"""Distance that may be lost by rounding."""


class Polygon:
    """The area inside a closed outline, convex or not, in either order."""

    def __init__(self, outline_m: Sequence[Vec2]) -> None:
        """Create from the corners, at least three; the last is joined to the first."""
        self.corners_m: tuple[Vec2, ...] = tuple(outline_m)
        closed_m = (*self.corners_m, self.corners_m[0])
        self.edges_m: tuple[tuple[Vec2, Vec2], ...] = tuple(pairwise(closed_m))
        """Start and end of each edge."""

    @property
    def area_m2(self) -> float:
        """Return the area inside an outline that does not cross itself."""
        doubled_m2 = sum(ax * by - bx * ay for (ax, ay), (bx, by) in self.edges_m)
        return abs(doubled_m2) / 2.0

    def crossing(self) -> tuple[int, int] | None:
        """Return the indices of two edges that cross or touch, neighbours apart, or None."""
        last = len(self.edges_m) - 1
        for first, second in combinations(range(len(self.edges_m)), 2):
            is_next = second - first == 1
            closes_outline = first == 0 and second == last
            if is_next or closes_outline:
                continue
            if do_intersect(*self.edges_m[first], *self.edges_m[second]):
                return first, second
        return None


def _side(a: Vec2, b: Vec2, c: Vec2) -> float:
    """Return a number above 0 if c is left of the line from a to b, below 0 if it is right of it."""
    ax, ay = a
    bx, by = b
    cx, cy = c
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


def do_intersect(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> bool:
    """Return True if the segments from a to b and from c to d cross or touch."""
    abc = _side(a, b, c)
    abd = _side(a, b, d)
    cda = _side(c, d, a)
    cdb = _side(c, d, b)
    if abc * abd < 0.0 and cda * cdb < 0.0:
        return True

    # An end of one lies on the other
    if abc == 0.0 and _is_between(a, b, c):
        return True
    if abd == 0.0 and _is_between(a, b, d):
        return True
    if cda == 0.0 and _is_between(c, d, a):
        return True
    return cdb == 0.0 and _is_between(c, d, b)


def _is_between(a: Vec2, b: Vec2, c: Vec2) -> bool:
    """Return True if c, on the line through a and b, is on the segment between them."""
    if not min(a[0], b[0]) <= c[0] <= max(a[0], b[0]):
        return False
    return min(a[1], b[1]) <= c[1] <= max(a[1], b[1])


class FloorArea(Polygon):
    """The area inside a closed outline, convex or not, in either order, with distances to the outline."""

    def contains(self, point_m: Vec2) -> bool:
        """Return True if `point_m` is inside (even-odd rule)."""
        x, y = point_m
        inside = False
        for (ax, ay), (bx, by) in self.edges_m:
            if (ay > y) == (by > y):
                continue
            crossing_x = ax + (y - ay) / (by - ay) * (bx - ax)
            if x < crossing_x:
                inside = not inside
        return inside

    def nearest(self, point_m: Vec2) -> Vec2:
        """Return the point of the outline that is nearest to `point_m`."""
        candidates_m = [_nearest_on(a, b, point_m) for a, b in self.edges_m]
        return min(candidates_m, key=lambda candidate_m: math.dist(candidate_m, point_m))

    def signed_distance_m(self, point_m: Vec2) -> float:
        """Return the distance from `point_m` to the outline, negative if the point is inside."""
        distance_m = min(math.dist(_nearest_on(a, b, point_m), point_m) for a, b in self.edges_m)
        return -distance_m if self.contains(point_m) else distance_m

    def is_apart(self, start_m: Vec2, end_m: Vec2, min_m: float) -> bool:
        """Return True if no point of a segment is nearer to the outline than `min_m`."""
        cx, cy = start_m
        dx, dy = end_m
        reach_m = min_m + ROUNDING_M
        west = min(cx, dx) - reach_m
        east = max(cx, dx) + reach_m
        south = min(cy, dy) - reach_m
        north = max(cy, dy) + reach_m
        for a, b in self.edges_m:
            ax, ay = a
            bx, by = b
            # most edges are farther along one axis alone, which is all that robots have time for
            if ax < west and bx < west:
                continue
            if ax > east and bx > east:
                continue
            if ay < south and by < south:
                continue
            if ay > north and by > north:
                continue
            if not _segments_apart_m(a, b, start_m, end_m) >= min_m:
                return False
        return True


def _nearest_on(a: Vec2, b: Vec2, point_m: Vec2) -> Vec2:
    """Return the point of the segment from a to b that is nearest to `point_m`."""
    ax, ay = a
    ux = b[0] - ax
    uy = b[1] - ay
    px = point_m[0] - ax
    py = point_m[1] - ay
    t = (px * ux + py * uy) / max(ux * ux + uy * uy, TINY)
    t = min(max(t, 0.0), 1.0)
    return (ax + t * ux, ay + t * uy)


def point_segment_m(point_m: Vec2, start_m: Vec2, end_m: Vec2) -> float:
    """Return the distance from a point to a segment."""
    return math.dist(_nearest_on(start_m, end_m, point_m), point_m)


def _segments_apart_m(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> float:
    if do_intersect(a, b, c, d):
        return 0.0
    ends_to_first_m = min(point_segment_m(c, a, b), point_segment_m(d, a, b))
    ends_to_second_m = min(point_segment_m(a, c, d), point_segment_m(b, c, d))
    return min(ends_to_first_m, ends_to_second_m)
