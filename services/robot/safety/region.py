"""The places that a robot may be at and the ways that it may take, clear of fences, people and other robots.

A robot is an upright cylinder around its position: `apart_m`, its radius with margins, is kept sideways and
above and below. Clearance is the distance to the forbidden space less `apart_m`; below 0 the robot is in it.
It is exact outside, and along segments that keep `apart_m + least_m` of at least 0; others are sampled.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from pointit.geometry.floor_area import FloorArea, Vec2, point_segment_m
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
        below_m = self._low_m - place_m[2]
        above_m = place_m[2] - self._high_m
        return max(beside_m, below_m, above_m) - apart_m

    def is_clear(self, start_m: Vec3, end_m: Vec3, apart_m: float, min_m: float) -> bool:
        """Return True if the clearance is at least `min_m` all along a segment."""
        reach_m = apart_m + min_m
        if reach_m < 0.0:
            samples = _samples(start_m, end_m)
            return all(self.clearance_m(place_m, apart_m) >= min_m for place_m in samples)
        part = _between_heights(start_m, end_m, self._low_m - reach_m, self._high_m + reach_m)
        if part is None:
            return True
        part_start_m, part_end_m = part
        if self._shape.contains(part_start_m):
            return False
        return self._shape.is_apart(part_start_m, part_end_m, reach_m)

    def nearest(self, place_m: Vec3, apart_m: float) -> tuple[Vec3, ...]:
        """Return places near `place_m` with clearance: beside the volume, below and above it."""
        x, y, z = place_m
        beside_x, beside_y = _moved_across(self._shape, (x, y), apart_m + BEYOND_M)
        places = [(beside_x, beside_y, z)]
        if math.isfinite(self._low_m):
            below_m = self._low_m - apart_m - BEYOND_M
            places.append((x, y, below_m))
        if math.isfinite(self._high_m):
            above_m = self._high_m + apart_m + BEYOND_M
            places.append((x, y, above_m))
        return tuple(places)


class KeepIn(_Fence):
    """A volume to stay inside of. Its lowest height has no margin, so that robots stand on the floor."""

    def clearance_m(self, place_m: Vec3, apart_m: float) -> float:
        """Return the clearance at `place_m`, m."""
        to_sides_m = -self._shape.signed_distance_m(place_m[:2]) - apart_m
        to_top_m = self._high_m - place_m[2] - apart_m
        to_bottom_m = place_m[2] - self._low_m + FLOOR_M
        return min(to_sides_m, to_top_m, to_bottom_m)

    def is_clear(self, start_m: Vec3, end_m: Vec3, apart_m: float, min_m: float) -> bool:
        """Return True if the clearance is at least `min_m` all along a segment."""
        reach_m = apart_m + min_m
        if reach_m < 0.0:
            samples = _samples(start_m, end_m)
            return all(self.clearance_m(place_m, apart_m) >= min_m for place_m in samples)
        lowest_m, highest_m = sorted((start_m[2], end_m[2]))
        is_high_enough = lowest_m >= self._low_m - FLOOR_M + min_m
        is_low_enough = highest_m <= self._high_m - reach_m
        if not is_high_enough or not is_low_enough:
            return False
        if not self._shape.contains(start_m[:2]):
            return False
        return self._shape.is_apart(start_m[:2], end_m[:2], reach_m)

    def nearest(self, place_m: Vec3, apart_m: float) -> tuple[Vec3, ...]:
        """Return the place inside that is nearest to `place_m`."""
        x, y = _moved_across(self._shape, place_m[:2], -apart_m - BEYOND_M)
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
        below_m = self._low_m - place_m[2]
        above_m = place_m[2] - self._high_m
        return max(beside_m, below_m, above_m) - apart_m

    def is_clear(self, start_m: Vec3, end_m: Vec3, apart_m: float, min_m: float) -> bool:
        """Return True if the clearance is at least `min_m` all along a segment."""
        reach_m = apart_m + min_m
        part = _between_heights(start_m, end_m, self._low_m - reach_m, self._high_m + reach_m)
        if part is None:
            return True
        part_start_m, part_end_m = part
        distance_m = point_segment_m(self._axis_m, part_start_m, part_end_m)
        return distance_m >= self.radius_m + reach_m

    def nearest(self, place_m: Vec3, apart_m: float) -> tuple[Vec3, ...]:
        """Return the nearest place beside it with clearance."""
        axis_x, axis_y = self._axis_m
        x = place_m[0] - axis_x
        y = place_m[1] - axis_y
        distance_m = math.hypot(x, y)

        # On the axis any direction is as good
        direction_x = 1.0
        direction_y = 0.0
        if distance_m > ROUNDING_M:
            direction_x = x / distance_m
            direction_y = y / distance_m
        reach_m = self.radius_m + apart_m + BEYOND_M
        return ((axis_x + direction_x * reach_m, axis_y + direction_y * reach_m, place_m[2]),)


Obstacle = KeepOut | KeepIn | CylinderObstacle
"""A space that a robot keeps clear of.

`name` is for sentences: `fence desk`, `you`, `robot quad`. `nearest` returns places near one with
clearance, one in each direction to leave by.
"""


def _moved_across(shape: FloorArea, place_m: Vec2, to_m: float) -> Vec2:
    """Return `place_m` moved across the nearest point of the outline to the signed distance `to_m`."""
    x, y = shape.nearest(place_m)
    apart_m = shape.signed_distance_m(place_m)
    if abs(apart_m) > ROUNDING_M:
        factor = to_m / apart_m
        return (x + factor * (place_m[0] - x), y + factor * (place_m[1] - y))

    # On the outline itself the direction across it is not known: the best of 16
    candidates: list[Vec2] = []
    for number in range(16):
        angle_rad = math.tau * number / 16
        candidates.append((x + to_m * math.cos(angle_rad), y + to_m * math.sin(angle_rad)))
    return min(candidates, key=lambda moved_m: abs(shape.signed_distance_m(moved_m) - to_m))


def _between_heights(start_m: Vec3, end_m: Vec3, low_m: float, high_m: float) -> tuple[Vec2, Vec2] | None:
    """Return the part of a segment between two heights, seen from above, or None if there is none."""
    start_z = start_m[2]
    rise_m = end_m[2] - start_z
    first = 0.0
    last = 1.0
    if abs(rise_m) < ROUNDING_M:
        is_above_low = low_m < max(start_z, end_m[2])
        is_below_high = min(start_z, end_m[2]) < high_m
        if not is_above_low or not is_below_high:
            return None
    else:
        at_low = (low_m - start_z) / rise_m
        at_high = (high_m - start_z) / rise_m
        first = max(first, min(at_low, at_high))
        last = min(last, max(at_low, at_high))
        if first >= last:
            return None
    way = subtract(end_m, start_m)
    first_m = add(start_m, scale(way, first))
    last_m = add(start_m, scale(way, last))
    return first_m[:2], last_m[:2]


def _samples(start_m: Vec3, end_m: Vec3) -> tuple[Vec3, ...]:
    way = subtract(end_m, start_m)
    intervals = math.ceil(math.dist(start_m, end_m) / SAMPLE_M)
    count = min(max(intervals, 1), MAX_SAMPLES)
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
        nearest = min(self.obstacles, key=lambda obstacle: self.clearance_m(obstacle, place_m), default=None)
        if nearest is not None and self.clearance_m(nearest, place_m) < margin_m:
            return nearest
        return None

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
            # Out of all other obstacles, too, if possible, and near the place asked for
            choices = blocker.nearest(place, self.apart_m + MARGIN_M)
            place = min(choices, key=lambda choice: (self._depth_m(choice), math.dist(choice, place_m)))
        return None

    def away(self, obstacle: Obstacle, place_m: Vec3) -> Vec3:
        """Return the unit direction in which the clearance from `obstacle` grows, or zeros."""
        gradient: list[float] = []
        for axis in ((STEP_M, 0.0, 0.0), (0.0, STEP_M, 0.0), (0.0, 0.0, STEP_M)):
            ahead_m = self.clearance_m(obstacle, add(place_m, axis))
            behind_m = self.clearance_m(obstacle, subtract(place_m, axis))
            gradient.append(ahead_m - behind_m)
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

        # Straight on as far as permitted. Before an obstacle, along it: a second obstacle ends that
        step = _within(subtract(goal, start_m), reach_m)
        for _ in range(2):
            way = self.way(start_m, add(start_m, step))
            if way.blocker is None:
                return add(start_m, step), blocker
            ahead = scale(step, way.share)
            if blocker is None and way.blocker.kind == "fence":
                blocker = way.blocker
            if norm(ahead) > MARGIN_M:
                return add(start_m, ahead), blocker
            rest = subtract(step, ahead)
            step = add(ahead, self._along(way.blocker, start_m, rest))

        # The obstacle that holds it, if it hardly gets on
        way = self.way(start_m, add(start_m, step))
        step = scale(step, way.share)
        if blocker is None and norm(step) < MARGIN_M:
            blocker = way.blocker
        return add(start_m, step), blocker

    def _along(self, obstacle: Obstacle, start_m: Vec3, step: Vec3) -> Vec3:
        """Return `step` without its part into `obstacle`, and away from it if it is nearer than the margin.

        A person or robot between is passed on the side of the target, or on the left: not so a fence, before
        which the robot stays next to the target.
        """
        away = self.away(obstacle, start_m)
        short_m = max(MARGIN_M - self.clearance_m(obstacle, start_m), 0.0)
        inward = min(dot(step, away), 0.0)
        along = subtract(step, scale(away, inward))

        # Exactly between robot and target hardly anything is left of the step
        is_held = norm(step) > PASSING_M > norm(along)
        left = (-away[1], away[0], 0.0)
        if obstacle.kind != "fence" and is_held and norm(left) > 0.0:
            side = 1.0 if dot(step, left) >= 0.0 else -1.0
            along = scale(left, PASSING_M / norm(left) * side)
        return add(along, scale(away, short_m))

    def _permitted_share(
        self, obstacle: Obstacle, start_m: Vec3, end_m: Vec3, min_m: float, share: float
    ) -> float:
        """Return the part, at most `share`, of a segment that has the clearance `min_m`."""
        way = subtract(end_m, start_m)

        def is_clear(part: float) -> bool:
            part_end_m = add(start_m, scale(way, part))
            return obstacle.is_clear(start_m, part_end_m, self.apart_m, min_m)

        if is_clear(share):
            return share
        low = 0.0
        high = share
        for _ in range(BISECTIONS):
            middle = (low + high) / 2.0
            if is_clear(middle):
                low = middle
            else:
                high = middle
        return low

    def _depth_m(self, place_m: Vec3) -> float:
        """Return the depth of `place_m` in forbidden space, m, rounded so that equal depths are equal."""
        min_clearance_m = min(self.clearance_m(obstacle, place_m) for obstacle in self.obstacles)
        depth_m = max(MARGIN_M - min_clearance_m, 0.0)
        return round(depth_m, 3)


def _within(step: Vec3, reach_m: float) -> Vec3:
    length = norm(step)
    return scale(step, reach_m / length) if length > reach_m else step
