"""Exact closest point of many lines and points to a ray, in tens of microseconds.

Lines are divided into short runs of segments, each in a ball around a point of the line itself. The best of
the balls' centres is a real point, so every run whose ball lies wholly outside that cone is
excluded. The closed form then decides among the remaining few.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.geometry.polyline import TINY, Hit, Polyline, clip_to_reach, make_hit, nearest_in_angle
from pointit.geometry.solids import MAX_EYES, Solid
from pointit.geometry.vector import Vec3

FEW_SOLIDS = 6
"""Number of solids up to which plain Python on each ball is faster than arrays."""
SLACK_RAD = 1e-6
"""Margin of bounds by balls, rad."""
ROUNDING = 1e-14
"""Margin of cosines."""
SAME = 1e-9
"""Difference below which misses are equal. The nearer solid wins then."""

RUN_M = 0.25
"""Maximum length of a run, m. Longer segments are cut."""
RUN_SEGMENTS = 16
"""Maximum number of segments of a run."""
FEW = 8
"""Number of segments and points up to which plain Python on each is faster than arrays."""
SLACK_M = 1e-6
"""Margin of the balls' radii, so that rounding never loses a run."""


class SolidCaster:
    """Static solids. Targets are numbered as given."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        """Create from the solids.

        Raises:
            ValueError: If there are no solids.
        """
        if not solids:
            raise ValueError("a solid caster needs at least one solid")
        self._solids = list(solids)
        self._centres = np.array([solid.bounding_sphere[0] for solid in solids]).T.copy()
        """3 x n."""
        self._radii = np.array([solid.bounding_sphere[1] for solid in solids])
        self._cones = lru_cache(MAX_EYES)(self._cones_from)

    def cast(
        self, origin_m: Vec3, direction: Vec3, tolerance: float = math.inf, reach_m: float = math.inf
    ) -> Hit | None:
        """Return the first intersection of the ray, or else the closest point within `tolerance`.

        Args:
            origin_m: origin of the ray.
            direction: direction of the ray, normalized here.
            tolerance: rad.
            reach_m: points further along the ray are ignored.
        """
        direction = vector.normalized(direction)
        near = sorted(self._near(origin_m, direction, tolerance))
        first = math.inf
        first_index = -1
        passed: list[tuple[float, int]] = []
        for bound, index in near:
            ahead: float | None = None
            if bound <= SLACK_RAD:
                ahead = self._solids[index].intersect(origin_m, direction)
            if ahead is None:
                passed.append((bound, index))
            elif (ahead, index) < (first, first_index) or first_index < 0:
                first = ahead
                first_index = index
        if first_index >= 0 and first <= reach_m:  # all misses are larger
            return self._hit(first_index, first, origin_m, direction)

        # Solids that the ray intersects beyond the reach are no candidates
        return self._closest(passed, origin_m, direction, tolerance, reach_m)

    def first_hit_m(self, origin_m: Vec3, direction: Vec3) -> float:
        """Return the distance along the ray to the first intersection, or infinity.

        Solids that contain the ray's origin are ignored.
        """
        direction = vector.normalized(direction)
        first = math.inf
        for _, index in self._near(origin_m, direction, 0.0):
            solid = self._solids[index]
            ahead = solid.intersect(origin_m, direction)
            if ahead is None or ahead >= first:
                continue
            if not solid.contains(origin_m):
                first = ahead
        return first

    def _hit(self, index: int, ahead: float, origin_m: Vec3, direction: Vec3) -> Hit:
        point = vector.add(origin_m, vector.scale(direction, ahead))
        return Hit(index, 0.0, point, 0.0, 0.0, ahead, self._solids[index].uv_at(point))

    def _closest(
        self, near: list[tuple[float, int]], origin_m: Vec3, direction: Vec3, tolerance: float, reach_m: float
    ) -> Hit | None:
        """Return the closest point of the solids `near`, with the least misses first, or None."""
        best: Hit | None = None
        best_miss = tolerance
        for bound, index in near:
            if bound > best_miss + SLACK_RAD:
                break
            point = self._solids[index].closest_approach(origin_m, direction)
            if point is None:
                continue
            along_m = vector.dot(direction, vector.subtract(point, origin_m))
            if along_m > reach_m:
                continue
            hit = make_hit(index, 0.0, point, origin_m, direction)
            miss = hit.miss_rad
            if miss > best_miss:
                continue

            # Of equal misses, as at an edge of two solids, the nearer one
            is_better = best is None or miss < best_miss - SAME or hit.range_m < best.range_m
            if is_better:
                best = hit
                best_miss = miss
        if best is None:
            return None
        return best._replace(uv_m=self._solids[best.target].uv_at(best.point_m))

    def _near(self, origin_m: Vec3, direction: Vec3, tolerance: float) -> list[tuple[float, int]]:
        """Return least miss and number of each solid whose ball comes within `tolerance` of the ray."""
        if len(self._solids) <= FEW_SOLIDS:
            bounds = [(self._bound(index, origin_m, direction), index) for index in range(len(self._solids))]
            return [(bound, index) for bound, index in bounds if bound <= tolerance + SLACK_RAD]
        sights, balls, min_cosines = self._cones(origin_m, tolerance)
        cosines = np.array(direction) @ sights
        near = (cosines >= min_cosines).nonzero()[0]
        misses = np.arccos(np.minimum(cosines[near], 1.0)) - balls[near]
        return list(zip(misses.tolist(), near.tolist(), strict=True))

    def _cones_from(self, origin_m: Vec3, tolerance: float) -> tuple[Array, Array, Array]:
        """Return unit vectors to the centres (3 x n), angles of the balls, and least cosines of rays near."""
        reaches = self._centres - np.array(origin_m)[:, None]
        squares = np.einsum("ij,ij->j", reaches, reaches)
        distances = np.maximum(np.sqrt(squares), 1e-12)
        outside_balls = np.arcsin(np.minimum(self._radii / distances, 1.0))
        balls = np.where(distances <= self._radii, np.inf, outside_balls)
        max_misses = np.minimum(balls + (tolerance + SLACK_RAD), math.pi)
        min_cosines = np.cos(max_misses) - ROUNDING
        return reaches / distances, balls, min_cosines

    def _bound(self, index: int, origin_m: Vec3, direction: Vec3) -> float:
        """Return the miss of the solid's ball, negative if the ray meets it or begins inside."""
        centre, radius = self._solids[index].bounding_sphere
        reach = vector.subtract(centre, origin_m)
        distance = vector.norm(reach)
        if distance <= radius:
            return -math.inf
        return vector.angle_between(direction, reach) - math.asin(radius / distance)


class _Segment(NamedTuple):
    start_m: Vec3
    span_m: Vec3
    """Vector from its start to its end, zero for a point."""
    position_m: float
    """Arc length of its start along its target."""
    length_m: float
    target: int


class RayCaster:
    """Static lines and points, arranged for casting rays at them.

    Targets are numbered lines first, then points, as given.
    """

    def __init__(self, lines: Sequence[Polyline], points: Sequence[Vec3] = ()) -> None:
        """Create from the targets.

        Raises:
            ValueError: If there are no targets.
        """
        if not lines and not points:
            raise ValueError("a ray caster needs at least one line or point")
        line_segments: list[_Segment] = []
        for target, line in enumerate(lines):
            line_segments += _segments(line, target)
        point_segments = [
            _Segment(point, (0.0, 0.0, 0.0), 0.0, 0.0, len(lines) + index)
            for index, point in enumerate(points)
        ]
        segments = [*line_segments, *point_segments]
        self._few = segments if len(segments) <= FEW else []
        if not self._few:
            self._lay_out(lines, point_segments)

    def _lay_out(self, lines: Sequence[Polyline], point_segments: list[_Segment]) -> None:
        """Arrange the segments in runs, and these in arrays."""
        # Runs of one line each, around a point of it; a point is a run of its own
        runs: list[list[_Segment]] = []
        centres: list[Vec3] = []
        for target, line in enumerate(lines):
            pieces: list[_Segment] = []
            for segment in _segments(line, target):
                pieces += _cuts(segment)
            for run in _runs(pieces):
                runs.append(run)
                end_m = run[-1].position_m + run[-1].length_m
                centres.append(line.point_at((run[0].position_m + end_m) / 2.0))
        for segment in point_segments:
            runs.append([segment])
            centres.append(segment.start_m)
        radii = [_radius(run, centre) for run, centre in zip(runs, centres, strict=True)]

        # Runs are padded with their last segment, which cannot win against itself
        self._width = max(len(run) for run in runs)
        self._segments: list[_Segment] = []
        for run in runs:
            padding = [run[-1]] * (self._width - len(run))
            self._segments += [*run, *padding]

        starts = np.array([segment.start_m for segment in self._segments])
        spans = np.array([segment.span_m for segment in self._segments])
        squares = np.einsum("ij,ij->i", spans, spans)
        columns = np.column_stack([starts, spans, squares])
        self._runs: Array = np.ascontiguousarray(columns.T.reshape(7, len(runs), self._width))
        """7 x runs x width: start (3), span (3), squared length."""
        self._centres: Array = np.ascontiguousarray(np.array(centres).T)
        """3 x runs."""
        self._radii: Array = np.array(radii) + SLACK_M

    def cast(
        self, origin_m: Vec3, direction: Vec3, tolerance: float = math.inf, reach_m: float = math.inf
    ) -> Hit | None:
        """Return the closest point to the ray, or None beyond `tolerance`, rad.

        Points further along the ray than `reach_m` are ignored. The choice between points has a resolution of
        2e-8 rad; the misses of the hit are exact.
        """
        direction = vector.normalized(direction)
        if self._few:
            nearest = self._among_few(origin_m, direction, reach_m)
        else:
            nearest = self._among_many(origin_m, direction, tolerance, reach_m)
        if nearest is None:
            return None
        segment, t = nearest
        (x, y, z), (u, v, w), position_m, length_m, target = segment
        point = (x + u * t, y + v * t, z + w * t)
        hit = make_hit(target, position_m + t * length_m, point, origin_m, direction)
        return hit if hit.miss_rad <= tolerance else None

    def _among_few(self, origin_m: Vec3, direction: Vec3, reach_m: float) -> tuple[_Segment, float] | None:
        best: tuple[_Segment, float] | None = None
        min_cost = math.inf
        ox, oy, oz = origin_m
        for segment in self._few:
            x, y, z = segment.start_m
            span = segment.span_m
            a = (x - ox, y - oy, z - oz)

            # The part of the segment within the reach, from `low` to `high` of its span
            if reach_m < math.inf:
                p = vector.dot(direction, a)
                q = vector.dot(direction, span)
                interval = clip_to_reach(p, q, reach_m)
                if interval is None:
                    continue
                low, high = interval
                a = vector.add(a, vector.scale(span, low))
                u = vector.scale(span, high - low)
            else:
                low = 0.0
                high = 1.0
                u = span
            t, cost = nearest_in_angle(a, u, direction)
            if cost < min_cost:
                best = (segment, low + t * (high - low))
                min_cost = cost
        return best

    def _among_many(
        self, origin_m: Vec3, direction: Vec3, tolerance: float, reach_m: float
    ) -> tuple[_Segment, float] | None:
        origin = np.array(origin_m)[:, None]
        d = np.array(direction)
        candidates: list[int] = self._candidates(origin, d, tolerance, reach_m).tolist()
        if not candidates:
            return None

        # The segments of the runs that remain, as in `nearest_in_angle`
        runs = self._runs.take(candidates, axis=1)
        segments = runs.reshape(7, -1)
        a = segments[:3] - origin
        u = segments[3:6]
        uu = segments[6]
        p = d @ a
        q = d @ u

        # Their parts within the reach, from `low` to `high` of their spans
        intervals: tuple[Array, Array] | None = None
        if reach_m < math.inf:
            low, high = intervals = _spans_within(p, q, reach_m)
            share = high - low
            a = a + low * u
            u = share * u
            uu = share**2 * uu
            p = p + low * q
            q = share * q
        aa = np.einsum("ij,ij->j", a, a)
        au = np.einsum("ij,ij->j", a, u)
        t, cost = _nearest_in_angle(p, q, aa, au, uu)
        if intervals is not None:
            low, high = intervals
            cost[:, high < low] = math.inf
            t = low + t * (high - low)

        # Costs are those of starts, ends and stationary points, one row each
        best = int(cost.argmin())
        if math.isinf(cost.flat[best]):
            return None
        row, column = divmod(best % len(uu), self._width)
        segment = self._segments[candidates[row] * self._width + column]
        return segment, float(t.flat[best])

    def _candidates(self, origin: Array, d: Array, tolerance: float, reach_m: float) -> NDArray[np.intp]:
        """Return the runs that may hold the closest point."""
        reaches = self._centres - origin
        along = d @ reaches
        square = np.einsum("ij,ij->j", reaches, reaches)
        across = np.sqrt(np.maximum(square - along * along, 0.0))
        cosines = along / np.sqrt(np.maximum(square, TINY))
        if reach_m < math.inf:
            cosines[along > reach_m] = -1.0
        max_cosine = min(max(float(cosines.max()), -1.0), 1.0)
        cone = min(math.acos(max_cosine), tolerance)

        # The centre's distance to the cone if that is in front, otherwise a smaller value
        to_cone = across * math.cos(cone) - along * math.sin(cone)
        is_near = to_cone <= self._radii
        if not math.isinf(reach_m):
            is_near &= along - self._radii <= reach_m
        return np.flatnonzero(is_near)


def _spans_within(p: Array, q: Array, reach_m: float) -> tuple[Array, Array]:
    """Return the intervals of t in which segments are within the reach, with end < start if they are not."""
    ends = p + q
    crossings = (reach_m - p) / np.where(q == 0.0, TINY, q)
    clipped = np.minimum(np.maximum(crossings, 0.0), 1.0)
    low = np.where((p > reach_m) & (q < 0.0), clipped, 0.0)
    high = np.where((ends > reach_m) & (q > 0.0), clipped, 1.0)
    return low, np.where(np.minimum(p, ends) > reach_m, -1.0, high)


def _nearest_in_angle(p: Array, q: Array, aa: Array, au: Array, uu: Array) -> tuple[Array, Array]:
    """Return t and minus the cosine at the starts, the ends and the stationary points, each 3 x n."""
    stationary = (q * aa - p * au) / np.maximum(p * uu - q * au, TINY)
    t = np.zeros((3, len(p)))
    t[1] = 1.0
    t[2] = np.minimum(np.maximum(stationary, 0.0), 1.0)
    square = aa + t * (2.0 * au + t * uu)
    return t, (p + t * q) / -np.sqrt(np.maximum(square, TINY))


def _segments(line: Polyline, target: int) -> list[_Segment]:
    """Return the segments of `line`."""
    vertices: list[list[float]] = line.vertices_m.tolist()
    positions: list[float] = line.starts_m.tolist()
    segments: list[_Segment] = []
    for i, ((ax, ay, az), (bx, by, bz)) in enumerate(pairwise(vertices)):
        start = (ax, ay, az)
        span = (bx - ax, by - ay, bz - az)
        length = positions[i + 1] - positions[i]
        segments.append(_Segment(start, span, positions[i], length, target))
    return segments


def _cuts(segment: _Segment) -> list[_Segment]:
    """Return `segment` in equal pieces of at most `RUN_M`."""
    count = max(1, math.ceil(segment.length_m / RUN_M))
    span = vector.scale(segment.span_m, 1.0 / count)
    length = segment.length_m / count
    pieces: list[_Segment] = []
    for i in range(count):
        start = vector.add(segment.start_m, vector.scale(segment.span_m, i / count))
        position_m = segment.position_m + i * length
        pieces.append(_Segment(start, span, position_m, length, segment.target))
    return pieces


def _runs(pieces: list[_Segment]) -> list[list[_Segment]]:
    """Return consecutive pieces in runs, within the limits of their length and number."""
    runs: list[list[_Segment]] = []
    remaining_m = 0.0
    for piece in pieces:
        is_full = not runs or len(runs[-1]) >= RUN_SEGMENTS
        if is_full or piece.length_m > remaining_m:
            runs.append([])
            remaining_m = RUN_M
        runs[-1].append(piece)
        remaining_m -= piece.length_m
    return runs


def _radius(run: list[_Segment], centre: Vec3) -> float:
    """Return the radius of the ball around `centre` that holds `run`."""
    ends = [vector.add(segment.start_m, segment.span_m) for segment in run]
    points = [run[0].start_m, *ends]
    return max(vector.norm(vector.subtract(point, centre)) for point in points)
