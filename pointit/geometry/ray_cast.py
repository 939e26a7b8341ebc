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
        met = [
            (ahead, i)
            for bound, i in near
            if bound <= SLACK_RAD and (ahead := self._solids[i].intersect(origin_m, direction)) is not None
        ]
        first, index = min(met, default=(math.inf, -1))
        if index >= 0 and first <= reach_m:  # all misses are larger
            return self._hit(index, first, origin_m, direction)
        behind = {i for _, i in met}
        passed = [each for each in near if each[1] not in behind]
        return self._closest(passed, origin_m, direction, tolerance, reach_m)

    def first_hit_m(self, origin_m: Vec3, direction: Vec3) -> float:
        """Return the distance along the ray to the first intersection, or infinity.

        Solids that contain the ray's origin are ignored.
        """
        direction = vector.normalized(direction)
        ahead = math.inf
        for _, i in self._near(origin_m, direction, 0.0):
            solid = self._solids[i]
            met = solid.intersect(origin_m, direction)
            if met is not None and met < ahead and not solid.contains(origin_m):
                ahead = met
        return ahead

    def _hit(self, index: int, ahead: float, origin_m: Vec3, direction: Vec3) -> Hit:
        point = vector.add(origin_m, vector.scale(direction, ahead))
        return Hit(index, 0.0, point, 0.0, 0.0, ahead, self._solids[index].uv_at(point))

    def _closest(
        self, near: list[tuple[float, int]], origin_m: Vec3, direction: Vec3, tolerance: float, reach_m: float
    ) -> Hit | None:
        best: Hit | None = None
        best_miss = tolerance
        for bound, i in near:
            if bound > best_miss + SLACK_RAD:
                break
            point = self._solids[i].closest_approach(origin_m, direction)
            if point is None or vector.dot(direction, vector.subtract(point, origin_m)) > reach_m:
                continue
            hit = make_hit(i, 0.0, point, origin_m, direction)
            miss = hit.miss_rad
            if miss <= best_miss and (best is None or miss < best_miss - SAME or hit.range_m < best.range_m):
                best = hit
                best_miss = miss
        return None if best is None else best._replace(uv_m=self._solids[best.target].uv_at(best.point_m))

    def _near(self, origin_m: Vec3, direction: Vec3, tolerance: float) -> list[tuple[float, int]]:
        """Return least miss and number of each solid whose ball comes within `tolerance` of the ray."""
        if len(self._solids) <= FEW_SOLIDS:
            bounds = [(self._bound(i, origin_m, direction), i) for i in range(len(self._solids))]
            return [each for each in bounds if each[0] <= tolerance + SLACK_RAD]
        sights, balls, min_cosine = self._cones(origin_m, tolerance)
        cosines = np.array(direction) @ sights
        near = (cosines >= min_cosine).nonzero()[0]
        misses = np.arccos(np.minimum(cosines[near], 1.0)) - balls[near]
        return list(zip(misses.tolist(), near.tolist(), strict=True))

    def _cones_from(self, origin_m: Vec3, tolerance: float) -> tuple[Array, Array, Array]:
        """Return unit vectors to the centres (3 x n), angles of the balls, and least cosines of rays near."""
        c = self._centres - np.array(origin_m)[:, None]
        distances = np.maximum(np.sqrt(np.einsum("ij,ij->j", c, c)), 1e-12)
        balls = np.where(
            distances <= self._radii, np.inf, np.arcsin(np.minimum(self._radii / distances, 1.0))
        )
        min_cosine = np.cos(np.minimum(balls + (tolerance + SLACK_RAD), math.pi)) - ROUNDING
        return c / distances, balls, min_cosine

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
        whole = [piece for target, line in enumerate(lines) for piece in _segments(line, target)]
        alone = [
            _Segment(point, (0.0, 0.0, 0.0), 0.0, 0.0, len(lines) + index)
            for index, point in enumerate(points)
        ]
        self._few = [*whole, *alone] if len(whole) + len(alone) <= FEW else []
        if not self._few:
            self._lay_out(lines, alone)

    def _lay_out(self, lines: Sequence[Polyline], single_segments: list[_Segment]) -> None:
        segments: list[list[_Segment]] = []
        centres: list[Vec3] = []
        for target, line in enumerate(lines):
            for run in _runs([cut for piece in _segments(line, target) for cut in _cuts(piece)]):
                segments.append(run)
                end_m = run[-1].position_m + run[-1].length_m
                centres.append(line.point_at((run[0].position_m + end_m) / 2.0))
        for point in single_segments:
            segments.append([point])
            centres.append(point.start_m)
        self._width = width = max(len(run) for run in segments)
        radii = [_radius(run, centre) for run, centre in zip(segments, centres, strict=True)]
        # runs are padded with their last segment, which cannot win against itself
        self._segments: list[_Segment] = [run[min(i, len(run) - 1)] for run in segments for i in range(width)]
        starts = np.array([segment.start_m for segment in self._segments])
        spans = np.array([segment.span_m for segment in self._segments])
        squares = np.einsum("ij,ij->i", spans, spans)
        self._runs: Array = np.ascontiguousarray(
            np.column_stack([starts, spans, squares]).T.reshape(7, len(segments), width)
        )
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
            found = self._among_few(origin_m, direction, reach_m)
        else:
            found = self._among_many(origin_m, direction, tolerance, reach_m)
        if found is None:
            return None
        segment, t = found
        (x, y, z), (u, v, w), position_m, length_m, target = segment
        point = (x + u * t, y + v * t, z + w * t)
        hit = make_hit(target, position_m + t * length_m, point, origin_m, direction)
        return hit if hit.miss_rad <= tolerance else None

    def _among_few(self, origin_m: Vec3, direction: Vec3, reach_m: float) -> tuple[_Segment, float] | None:
        best: tuple[_Segment, float] | None = None
        min_distance = math.inf
        ox, oy, oz = origin_m
        for segment in self._few:
            (x, y, z), span = segment.start_m, segment.span_m
            a = (x - ox, y - oy, z - oz)
            if reach_m < math.inf:
                within = clip_to_reach(vector.dot(direction, a), vector.dot(direction, span), reach_m)
                if within is None:
                    continue
                low, high = within
                a = vector.add(a, vector.scale(span, low))
                u = vector.scale(span, high - low)
            else:
                low = 0.0
                high = 1.0
                u = span
            t, cost = nearest_in_angle(a, u, direction)
            if cost < min_distance:
                best = (segment, low + t * (high - low))
                min_distance = cost
        return best

    def _among_many(
        self, origin_m: Vec3, direction: Vec3, tolerance: float, reach_m: float
    ) -> tuple[_Segment, float] | None:
        origin = np.array(origin_m)[:, None]
        d = np.array(direction)
        candidates: list[int] = self._candidates(origin, d, tolerance, reach_m).tolist()
        if not candidates:
            return None
        segments = self._runs.take(candidates, axis=1)
        flat = segments.reshape(7, -1)
        a = flat[:3] - origin
        u = flat[3:6]
        uu = flat[6]
        p = d @ a
        q = d @ u
        low, high = _spans_within(p, q, reach_m) if reach_m < math.inf else (None, None)
        if low is not None and high is not None:
            a = a + low * u
            u = (high - low) * u
            uu = (high - low) ** 2 * uu
            p = p + low * q
            q = (high - low) * q
        aa = np.einsum("ij,ij->j", a, a)
        au = np.einsum("ij,ij->j", a, u)
        t, cost = _nearest_in_angle(p, q, aa, au, uu)
        if low is not None and high is not None:
            cost[:, high < low] = math.inf
            t = low + t * (high - low)
        best = int(cost.argmin())
        if math.isinf(cost.flat[best]):
            return None
        row, column = divmod(best % len(uu), self._width)
        return self._segments[candidates[row] * self._width + column], float(t.flat[best])

    def _candidates(self, origin: Array, d: Array, tolerance: float, reach_m: float) -> NDArray[np.intp]:
        """Return the runs that may hold the closest point."""
        c = self._centres - origin
        along = d @ c
        square = np.einsum("ij,ij->j", c, c)
        is_near = True if math.isinf(reach_m) else along - self._radii <= reach_m
        across = np.sqrt(np.maximum(square - along * along, 0.0))
        cosines = along / np.sqrt(np.maximum(square, TINY))
        if reach_m < math.inf:
            cosines[along > reach_m] = -1.0
        cone = min(math.acos(min(max(float(cosines.max()), -1.0), 1.0)), tolerance)
        # the centre's distance to the cone if that is in front, otherwise a smaller value
        return np.flatnonzero((across * math.cos(cone) - along * math.sin(cone) <= self._radii) & is_near)


def _spans_within(p: Array, q: Array, reach_m: float) -> tuple[Array, Array]:
    """Return the intervals of t in which segments are within the reach, with end < start if they are not."""
    crossing = np.minimum(np.maximum((reach_m - p) / np.where(q == 0.0, TINY, q), 0.0), 1.0)
    low = np.where((p > reach_m) & (q < 0.0), crossing, 0.0)
    high = np.where((p + q > reach_m) & (q > 0.0), crossing, 1.0)
    return low, np.where(np.minimum(p, p + q) > reach_m, -1.0, high)


def _nearest_in_angle(p: Array, q: Array, aa: Array, au: Array, uu: Array) -> tuple[Array, Array]:
    """Return t and minus the cosine at the starts, the ends and the stationary points, each 3 x n."""
    t = np.zeros((3, len(p)))
    t[1] = 1.0
    t[2] = np.minimum(np.maximum((q * aa - p * au) / np.maximum(p * uu - q * au, TINY), 0.0), 1.0)
    square = aa + t * (2.0 * au + t * uu)
    return t, (p + t * q) / -np.sqrt(np.maximum(square, TINY))


def _segments(line: Polyline, target: int) -> list[_Segment]:
    vertices: list[list[float]] = line.vertices_m.tolist()
    positions: list[float] = line.starts_m.tolist()
    segments: list[_Segment] = []
    for i, (start, end) in enumerate(pairwise(vertices)):
        a = (start[0], start[1], start[2])
        b = (end[0], end[1], end[2])
        length = positions[i + 1] - positions[i]
        segments.append(_Segment(a, vector.subtract(b, a), positions[i], length, target))
    return segments


def _cuts(segment: _Segment) -> list[_Segment]:
    count = max(1, math.ceil(segment.length_m / RUN_M))
    span = vector.scale(segment.span_m, 1.0 / count)
    length = segment.length_m / count
    return [
        _Segment(
            vector.add(segment.start_m, vector.scale(segment.span_m, i / count)),
            span,
            segment.position_m + i * length,
            length,
            segment.target,
        )
        for i in range(count)
    ]


def _runs(pieces: list[_Segment]) -> list[list[_Segment]]:
    segments: list[list[_Segment]] = []
    room_m = 0.0
    for piece in pieces:
        if not segments or len(segments[-1]) >= RUN_SEGMENTS or piece.length_m > room_m:
            segments.append([])
            room_m = RUN_M
        segments[-1].append(piece)
        room_m -= piece.length_m
    return segments


def _radius(run: list[_Segment], centre: Vec3) -> float:
    ends = [vector.add(segment.start_m, segment.span_m) for segment in run]
    return max(vector.norm(vector.subtract(point, centre)) for point in [run[0].start_m, *ends])
