"""How objects lie about one ray: which is pointed at, how surely, where the cursor is drawn to."""

import math
from collections.abc import Iterable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.closest import nearest_in_angle
from pointit.geometry.vector import Vec3
from pointit.schemas import Cursor

Array = NDArray[np.float64]

LINES = ("strip", "belt")
"""Surfaces with an arc length."""


class Objects(Protocol):
    """What a view asks of the objects it shows."""

    ids: list[str]
    index: dict[str, int]

    def velocity(self, index: int) -> Vec3:
        """Return the velocity of an object, {W}."""
        ...

    def extent(self, index: int) -> tuple[Vec3, float]:
        """Return the unit direction along an object (null: it has none) and half its length."""
        ...

    def place(self, index: int) -> tuple[str, str, float] | None:
        """Return surface, its id and the arc length on it of an object that is on a line."""
        ...

    def point_at(self, index: int, position_m: float) -> Vec3:
        """Return the point at an arc length of the line that an object is on."""
        ...


class View:
    """The objects as seen along one ray; valid until the next look at the same scene."""

    def __init__(
        self,
        objects: Objects,
        direction: Vec3,
        *,
        centers_m: Array,
        angles_rad: Array,
        halves_rad: Array,
        squares_m2: Array,
    ) -> None:
        """Take what was seen.

        Args:
            objects: n of them.
            direction: of the ray, unit, {W}.
            centers_m: n x 3, {W}.
            angles_rad: n, between the ray and the directions to the centres; infinite: not seen.
            halves_rad: n, half widths at the eyes.
            squares_m2: n, squared distances from the eyes.
        """
        self._objects = objects
        self._direction = direction
        self._centers_m = centers_m
        self._angles = angles_rad
        self._halves = halves_rad
        self._squares_m2 = squares_m2

    def pick(self, kept: str | None, snap_rad: float, closer: float) -> str | None:
        """Return the object at the smallest angle, of those within half width and `snap_rad`.

        `kept` is preferred until another one's angle is smaller by the share `closer`.
        """
        angles, halves = self._angles, self._halves
        within = np.where(angles <= halves + snap_rad, angles, math.inf)
        best = int(within.argmin())
        angle = float(within[best])
        if angle == math.inf:
            return None
        index = None if kept is None else self._objects.index.get(kept)
        if index is not None and index != best:
            kept_angle = float(within[index])
            if kept_angle < math.inf and angle >= (1.0 - closer) * kept_angle:
                return kept
        return self._objects.ids[best]

    def near(self, object_ids: Iterable[str], snap_rad: float, leave: float) -> set[str]:
        """Return those that the ray passes within `leave` times their half width and `snap_rad`."""
        found: set[str] = set()
        for object_id in object_ids:
            index = self._objects.index.get(object_id)
            if index is not None and self._angles[index] <= leave * (self._halves[index] + snap_rad):
                found.add(object_id)
        return found

    def is_lone(self, within_rad: float) -> bool:
        """Return whether at most one object is within `within_rad` of the ray."""
        return int(np.count_nonzero(self._angles - self._halves < within_rad)) <= 1

    def miss_rad(self, object_id: str) -> float | None:
        """Return the angle from the ray to the object, 0: on it; none: it is not seen."""
        index = self._objects.index.get(object_id)
        if index is None:
            return None
        angle = float(self._angles[index])
        return None if angle == math.inf else max(0.0, angle - float(self._halves[index]))

    def relative_rate(self, object_id: str, rate: tuple[float, float]) -> float:
        """Return how fast a ray that turns at `rate` moves against the object, rad/s at the eyes.

        Args:
            object_id: of an object that is seen.
            rate: towards greater azimuth on the sphere, and up; rad/s.
        """
        index = self._objects.index[object_id]
        velocity = self._objects.velocity(index)
        x, y, z = self._direction
        level = math.hypot(x, y) or 1e-12
        range_m = math.sqrt(float(self._squares_m2[index]))
        turned = (velocity[1] * x - velocity[0] * y) / level / range_m
        raised = (velocity[2] * level - (velocity[0] * x + velocity[1] * y) * z / level) / range_m
        return math.hypot(rate[0] - turned, rate[1] - raised)

    def confidence(self, object_id: str, aim_sigma_rad: float) -> float | None:
        """Return the probability that the object is the one meant, of all that are seen.

        Rays are taken to be spread normally about the centre of what is meant, with the sigma of people's
        aim and a quarter of the object's width: softmax of -angle²/2sigma², no object likelier beforehand.
        """
        index = self._objects.index.get(object_id)
        if index is None:
            return None
        sigmas = np.hypot(aim_sigma_rad, self._halves / 2.0)
        scores = -0.5 * np.square(self._angles / sigmas)
        highest = float(scores.max())
        if highest == -math.inf:
            return None
        weights = np.exp(scores - highest)
        return float(weights[index] / weights.sum())

    def snapped(self, object_id: str, cursor: Cursor, snap_rad: float) -> tuple[Vec3, float | None] | None:
        """Return where the cursor is drawn to, to touch the object, and its arc length on its own surface.

        On the object's own line the cursor moves along to the object's end; where it is on no line it is
        drawn from the ray to the nearest point of the object. None when it is on the object already, on
        another line, or would move by more than `snap_rad` at the eyes.
        """
        index = self._objects.index.get(object_id)
        if index is None or cursor.origin_m is None or cursor.direction is None:
            return None
        along, half_m = self._objects.extent(index)
        if cursor.surface in LINES:
            place = self._objects.place(index)
            if place is None or place[:2] != (cursor.surface, cursor.surface_id) or cursor.point_m is None:
                return None
            position_m = min(max(cursor.position_m, place[2] - half_m), place[2] + half_m)
            point_m = self._objects.point_at(index, position_m)
            shown = vector.subtract(cursor.point_m, cursor.origin_m)
            moved_rad = vector.angle_between(shown, vector.subtract(point_m, cursor.origin_m))
            is_moved = position_m != cursor.position_m
            return (point_m, position_m) if is_moved and moved_rad <= snap_rad else None
        x, y, z = self._centers_m[index].tolist()
        first = vector.subtract(vector.subtract((x, y, z), vector.scale(along, half_m)), cursor.origin_m)
        step = vector.scale(along, 2.0 * half_m)
        t, _ = nearest_in_angle(first, step, cursor.direction)
        reach = vector.add(first, vector.scale(step, t))
        if vector.angle_between(cursor.direction, reach) > snap_rad:
            return None
        return vector.add(cursor.origin_m, reach), None
