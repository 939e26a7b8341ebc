"""The places that a robot may be at and the ways that it may take, clear of fences, people and other robots.

A robot is an upright cylinder around its position: `apart_m`, its radius with margins, is kept sideways and
above and below. Clearance is the distance to the forbidden space less `apart_m`; below 0 the robot is in it.
It is exact outside, and along segments that keep `apart_m + least_m` of at least 0; others are sampled.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from pointit.geometry.solids import FloorArea, Vec2, point_segment_m
from pointit.geometry.vector import Vec3, add, dot, norm, scale, subtract
from pointit.schemas.environment import Fence

ObstacleKind = Literal["fence", "people", "robots"]

ROUNDING_M = 1e-6
"""Clearance that may be lost by rounding."""
FLOOR_M = 0.15
"""Depth below `low_m` of a volume to stay in at which a robot on the floor is still inside."""
SAMPLE_M = 0.05
MAX_SAMPLES = 100
"""Spacing and number of the places checked along a way out of a forbidden space."""
BEYOND_M = 1e-3
"""Distance by which the nearest permitted place is farther than needed."""

MARGIN_M = 0.1
"""Clearance of places that a robot is sent to, for its wander and overshoot."""
ROUNDS = 12
"""Attempts to find a place that is clear of all obstacles."""
BISECTIONS = 14
PASSING_M = 0.4
"""Step beside a person or robot that is exactly between the robot and its target."""
STEP_M = 1e-3
"""Step of the numeric gradient of the clearance."""


class _Fence:
    kind: ObstacleKind = "fence"

    def __init__(self, fence: Fence) -> None:
        self.name = f"fence {fence.id}"
        """For sentences, as that of every obstacle: `fence desk`, `you`, `robot quad`."""
        self._shape = FloorArea(fence.outline_m)
        self._low_m = -math.inf if fence.low_m is None else fence.low_m
        self._high_m = math.inf if fence.high_m is None else fence.high_m


class KeepOut(_Fence):
    """A volume to stay outside of."""

    def clearance_m(self, place_m: Vec3, apart_m: float) -> float:
        """Return the clearance at `place_m`, m."""
        beside_m = self._shape.signed_distance_m(place_m[:2])
        return max(beside_m, self._low_m - place_m[2], place_m[2] - self._high_m) - apart_m

    def is_clear(self, start_m: Vec3, end_m: Vec3, apart_m: float, min_m: float) -> bool:
        """Return True if the clearance is at least `min_m` all along a segment."""
        reach_m = apart_m + min_m
        if reach_m < 0.0:
            return all(self.clearance_m(each, apart_m) >= min_m for each in _samples(start_m, end_m))
        part = _between_heights(start_m, end_m, self._low_m - reach_m, self._high_m + reach_m)
        if part is None:
            return True
        return not self._shape.contains(part[0]) and self._shape.is_apart(*part, reach_m)

    def nearest(self, place_m: Vec3, apart_m: float) -> tuple[Vec3, ...]:
        """Return places near `place_m` with clearance: beside the volume, below and above it."""
        x, y = _moved(self._shape, place_m[:2], apart_m + BEYOND_M)
        places = [(x, y, place_m[2])]
        if math.isfinite(self._low_m):
            places.append((place_m[0], place_m[1], self._low_m - apart_m - BEYOND_M))
        if math.isfinite(self._high_m):
            places.append((place_m[0], place_m[1], self._high_m + apart_m + BEYOND_M))
        return tuple(places)


class KeepIn(_Fence):
    """A volume to stay inside of. Its lowest height has no margin, so that robots stand on the floor."""

    def clearance_m(self, place_m: Vec3, apart_m: float) -> float:
        """Return the clearance at `place_m`, m."""
        inside_m = -self._shape.signed_distance_m(place_m[:2]) - apart_m
        return min(inside_m, self._high_m - place_m[2] - apart_m, place_m[2] - self._low_m + FLOOR_M)

    def is_clear(self, start_m: Vec3, end_m: Vec3, apart_m: float, min_m: float) -> bool:
        """Return True if the clearance is at least `min_m` all along a segment."""
        reach_m = apart_m + min_m
        if reach_m < 0.0:
            return all(self.clearance_m(each, apart_m) >= min_m for each in _samples(start_m, end_m))
        lowest_m, highest_m = sorted((start_m[2], end_m[2]))
        return (
            lowest_m >= self._low_m - FLOOR_M + min_m
            and highest_m <= self._high_m - reach_m
            and self._shape.contains(start_m[:2])
            and self._shape.is_apart(start_m[:2], end_m[:2], reach_m)
        )

    def nearest(self, place_m: Vec3, apart_m: float) -> tuple[Vec3, ...]:
        """Return the place inside that is nearest to `place_m`."""
        x, y = _moved(self._shape, place_m[:2], -apart_m - BEYOND_M)
        z = min(max(place_m[2], self._low_m), self._high_m - apart_m - BEYOND_M)
        return ((x, y, z),)


class CylinderObstacle:
    """The space of a person, or of another robot."""

    def __init__(
        self, kind: ObstacleKind, name: str, foot_m: Vec3, radius_m: float, *, half_height_m: float = math.inf
    ) -> None:
        """Create around `foot_m`; `half_height_m` below and above, infinite for people."""
        self.kind: ObstacleKind = kind
        self.name = name
        self.radius_m = radius_m
        self._axis_m: Vec2 = foot_m[:2]
        self._low_m = foot_m[2] - half_height_m
        self._high_m = foot_m[2] + half_height_m

    def clearance_m(self, place_m: Vec3, apart_m: float) -> float:
        """Return the clearance at `place_m`, m."""
        beside_m = math.dist(place_m[:2], self._axis_m) - self.radius_m
        return max(beside_m, self._low_m - place_m[2], place_m[2] - self._high_m) - apart_m

    def is_clear(self, start_m: Vec3, end_m: Vec3, apart_m: float, min_m: float) -> bool:
        """Return True if the clearance is at least `min_m` all along a segment."""
        reach_m = apart_m + min_m
        part = _between_heights(start_m, end_m, self._low_m - reach_m, self._high_m + reach_m)
        return part is None or point_segment_m(self._axis_m, *part) >= self.radius_m + reach_m

    def nearest(self, place_m: Vec3, apart_m: float) -> tuple[Vec3, ...]:
        """Return the nearest place beside it with clearance."""
        x = place_m[0] - self._axis_m[0]
        y = place_m[1] - self._axis_m[1]
        over_m = math.hypot(x, y)
        along, across = (x / over_m, y / over_m) if over_m > ROUNDING_M else (1.0, 0.0)
        reach_m = self.radius_m + apart_m + BEYOND_M
        return ((self._axis_m[0] + along * reach_m, self._axis_m[1] + across * reach_m, place_m[2]),)


Obstacle = KeepOut | KeepIn | CylinderObstacle
"""A space that a robot keeps clear of.

`name` is for sentences: `fence desk`, `you`, `robot quad`. `nearest` returns places near one with
clearance, one in each direction to leave by.
"""


def _moved(shape: FloorArea, place_m: Vec2, to_m: float) -> Vec2:
    """Return `place_m` moved across the nearest point of the outline to the signed distance `to_m`."""
    x, y = shape.nearest(place_m)
    apart_m = shape.signed_distance_m(place_m)
    if abs(apart_m) > ROUNDING_M:
        factor = to_m / apart_m
        return (x + factor * (place_m[0] - x), y + factor * (place_m[1] - y))
    around = (
        (x + to_m * math.cos(a), y + to_m * math.sin(a)) for a in (math.tau * i / 16 for i in range(16))
    )
    return min(around, key=lambda each: abs(shape.signed_distance_m(each) - to_m))


def _between_heights(start_m: Vec3, end_m: Vec3, low_m: float, high_m: float) -> tuple[Vec2, Vec2] | None:
    """Return the part of a segment between two heights, seen from above, or None if there is none."""
    rise_m = end_m[2] - start_m[2]
    first = 0.0
    last = 1.0
    if abs(rise_m) < ROUNDING_M:
        if not low_m < max(start_m[2], end_m[2]) or not min(start_m[2], end_m[2]) < high_m:
            return None
    else:
        ends = sorted(((low_m - start_m[2]) / rise_m, (high_m - start_m[2]) / rise_m))
        first = max(first, ends[0])
        last = min(last, ends[1])
        if first >= last:
            return None
    way = subtract(end_m, start_m)
    return add(start_m, scale(way, first))[:2], add(start_m, scale(way, last))[:2]


def _samples(start_m: Vec3, end_m: Vec3) -> tuple[Vec3, ...]:
    way = subtract(end_m, start_m)
    count = min(max(math.ceil(math.dist(start_m, end_m) / SAMPLE_M), 1), MAX_SAMPLES)
    return tuple(add(start_m, scale(way, index / count)) for index in range(count + 1))


@dataclass(frozen=True)
class PermittedSegment:
    """The part of a straight way that is permitted."""

    share: float
    """0 to 1."""
    blocker: Obstacle | None
    """First obstacle on it, or None if all of it is permitted."""


class Region:
    """The space beside all obstacles.

    A robot that is in a forbidden space already may leave it: on a permitted way, no clearance becomes less
    than it is at the start, or than the margin.
    """

    def __init__(self, obstacles: Iterable[Obstacle], apart_m: float) -> None:
        """Create for a robot that keeps `apart_m` from `obstacles`: its radius and uncertainty."""
        self.obstacles: Sequence[Obstacle] = tuple(obstacles)
        self.apart_m = apart_m

    def blocker(self, place_m: Vec3, margin_m: float = MARGIN_M) -> Obstacle | None:
        """Return the obstacle with the least clearance at `place_m`, None if all have `margin_m`."""
        worst = min(self.obstacles, key=lambda each: self.clearance_m(each, place_m), default=None)
        return worst if worst is not None and self.clearance_m(worst, place_m) < margin_m else None

    def clearance_m(self, obstacle: Obstacle, place_m: Vec3) -> float:
        """Return the clearance from `obstacle`, m; below 0 `place_m` is forbidden."""
        return obstacle.clearance_m(place_m, self.apart_m)

    def way(self, start_m: Vec3, end_m: Vec3, margin_m: float = MARGIN_M) -> PermittedSegment:
        """Return the permitted part of the straight way to `end_m`."""
        share = 1.0
        blocker = None
        for obstacle in self.obstacles:
            min_m = min(margin_m, self.clearance_m(obstacle, start_m)) - ROUNDING_M
            permitted = self._permitted_share(obstacle, start_m, end_m, min_m, share)
            if permitted < share:
                share = permitted
                blocker = obstacle
        return PermittedSegment(share, blocker)

    def nearest(self, place_m: Vec3) -> Vec3 | None:
        """Return a permitted place near `place_m`, or None if none is found."""
        place = place_m
        for _ in range(ROUNDS):
            blocker = self.blocker(place)
            if blocker is None:
                return place
            choices = blocker.nearest(place, self.apart_m + MARGIN_M)
            place = min(choices, key=lambda each: (self._depth_m(each), math.dist(each, place_m)))
        return None

    def away(self, obstacle: Obstacle, place_m: Vec3) -> Vec3:
        """Return the unit direction in which the clearance from `obstacle` grows, or zeros."""
        gradient: list[float] = []
        for axis in ((STEP_M, 0.0, 0.0), (0.0, STEP_M, 0.0), (0.0, 0.0, STEP_M)):
            ahead = self.clearance_m(obstacle, add(place_m, axis))
            gradient.append(ahead - self.clearance_m(obstacle, subtract(place_m, axis)))
        direction = (gradient[0], gradient[1], gradient[2])
        length = norm(direction)
        return scale(direction, 1.0 / length) if length > 0.0 else direction

    def toward(self, start_m: Vec3, target_m: Vec3, reach_m: float) -> tuple[Vec3, Obstacle | None]:
        """Return the next position towards `target_m`, at most `reach_m` away, and the obstacle, if any.

        It is on the straight line before the first obstacle, or along an obstacle that is already reached.
        """
        goal = self.nearest(target_m)
        blocker = self.blocker(target_m)
        if goal is None:
            return start_m, blocker
        step = _within(subtract(goal, start_m), reach_m)
        for _ in range(2):  # a second obstacle ends it
            way = self.way(start_m, add(start_m, step))
            if way.blocker is None:
                return add(start_m, step), blocker
            ahead = scale(step, way.share)
            if blocker is None and way.blocker.kind == "fence":
                blocker = way.blocker
            if norm(ahead) > MARGIN_M:
                return add(start_m, ahead), blocker
            step = add(ahead, self._along(way.blocker, start_m, subtract(step, ahead)))
        way = self.way(start_m, add(start_m, step))
        step = scale(step, way.share)
        return add(start_m, step), blocker or (way.blocker if norm(step) < MARGIN_M else None)

    def _along(self, obstacle: Obstacle, start_m: Vec3, step: Vec3) -> Vec3:
        """Return `step` without its part into `obstacle`, and away from it if it is nearer than the margin.

        A person or robot between is passed on the side of the target, or on the left: not so a fence, before
        which the robot stays next to the target.
        """
        away = self.away(obstacle, start_m)
        short_m = max(MARGIN_M - self.clearance_m(obstacle, start_m), 0.0)
        along = subtract(step, scale(away, min(dot(step, away), 0.0)))
        left = (-away[1], away[0], 0.0)
        if obstacle.kind != "fence" and norm(step) > PASSING_M > norm(along) and norm(left) > 0.0:
            along = scale(left, PASSING_M / norm(left) * (1.0 if dot(step, left) >= 0.0 else -1.0))
        return add(along, scale(away, short_m))

    def _permitted_share(
        self, obstacle: Obstacle, start_m: Vec3, end_m: Vec3, min_m: float, share: float
    ) -> float:
        """Return the part, at most `share`, of a segment that has the clearance `min_m`."""
        way = subtract(end_m, start_m)

        def is_clear(part: float) -> bool:
            return obstacle.is_clear(start_m, add(start_m, scale(way, part)), self.apart_m, min_m)

        if is_clear(share):
            return share
        low = 0.0
        high = share
        for _ in range(BISECTIONS):
            middle = (low + high) / 2.0
            low, high = (middle, high) if is_clear(middle) else (low, middle)
        return low

    def _depth_m(self, place_m: Vec3) -> float:
        """Return the depth of `place_m` in forbidden space, m, rounded so that equal depths are equal."""
        min_clearance_m = min(self.clearance_m(each, place_m) for each in self.obstacles)
        return round(max(MARGIN_M - min_clearance_m, 0.0), 3)


def _within(step: Vec3, reach_m: float) -> Vec3:
    length = norm(step)
    return scale(step, reach_m / length) if length > reach_m else step
