"""The places that a robot may be at, and the ways that it may take."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pointit.geometry.vector import Vec3, add, dot, norm, scale, subtract
from pointit.services.robot.safety.obstacles import ROUNDING_M, Obstacle

MARGIN_M = 0.1
"""Clearance of places that a robot is sent to, for its wander and overshoot."""
ROUNDS = 12
"""Attempts to find a place that is clear of all obstacles."""
BISECTIONS = 14
PASSING_M = 0.4
"""Step beside a person or robot that is exactly between the robot and its target."""
STEP_M = 1e-3
"""Step of the numeric gradient of the clearance."""


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
        share, blocker = 1.0, None
        for obstacle in self.obstacles:
            min_m = min(margin_m, self.clearance_m(obstacle, start_m)) - ROUNDING_M
            permitted = self._permitted_share(obstacle, start_m, end_m, min_m, share)
            if permitted < share:
                share, blocker = permitted, obstacle
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
        low, high = 0.0, share
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
