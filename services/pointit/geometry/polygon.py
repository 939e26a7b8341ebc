"""Polygons on the floor: their area, and crossings of their outline."""

from collections.abc import Sequence
from itertools import combinations, pairwise

Vec2 = tuple[float, float]


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
