"""Objects near one ray: the object pointed at, its probability, and the snapped cursor."""

import math
from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

from pointit.geometry import vector
from pointit.geometry.closest import nearest_in_angle
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import Cursor, TrackedObject
from pointit.schemas.pointing import LINES

SAME_M = 1e-9
"""Positions nearer to each other than this are equal, m."""


class OnLine(NamedTuple):
    """Position of an object on a strip or belt, at the time of the view."""

    surface: str
    surface_id: str
    position_m: float
    line: Polyline


class VisibleObject(NamedTuple):
    """An object as seen along a ray."""

    id: str
    angle_rad: float
    """Angle to its centre, from the ray or from the direction in which the cursor is shown."""
    half_rad: float
    """Its half width: half its length along its line, as it appears from the eyes."""
    center_m: Vec3
    velocity_mps: Vec3
    along: Vec3
    """Unit direction of its line. Zero if it is on none."""
    half_m: float
    range_m: float
    """Distance from the eyes to its centre."""
    place: OnLine | None
    tracked: TrackedObject
    outline_m: Vec3 | None = None
    """Point of its outline nearest to the ray, if its `size_m` is known and the ray passes it."""


class View:
    """The objects near one ray."""

    def __init__(self, direction: Vec3, seen: Sequence[VisibleObject]) -> None:
        """Create from what is seen along the unit `direction` in {W}."""
        self._direction = direction
        self._seen = {one.id: one for one in seen}

    @property
    def seen(self) -> Collection[VisibleObject]:
        """Return the objects."""
        return self._seen.values()

    def pick(self, kept: str | None, snap_rad: float, hysteresis: float) -> str | None:
        """Return the object at the smallest angle, among those within half width and `snap_rad`.

        `kept` is preferred until another angle is smaller by the share `hysteresis`.
        """
        best: VisibleObject | None = None
        for one in self._seen.values():
            if one.angle_rad <= one.half_rad + snap_rad and (best is None or one.angle_rad < best.angle_rad):
                best = one
        if best is None or kept is None or best.id == kept:
            return None if best is None else best.id
        before = self._seen.get(kept)
        if before is None or before.angle_rad > before.half_rad + snap_rad:
            return best.id
        return kept if best.angle_rad >= (1.0 - hysteresis) * before.angle_rad else best.id

    def near(self, object_ids: Iterable[str], snap_rad: float, leave_factor: float) -> set[str]:
        """Return the ids whose angle from the ray is at most `leave_factor` x (half width + `snap_rad`)."""
        seen = self._seen
        return {
            object_id
            for object_id in object_ids
            if object_id in seen
            and seen[object_id].angle_rad <= leave_factor * (seen[object_id].half_rad + snap_rad)
        }

    def is_isolated(self, within_rad: float) -> bool:
        """Return True if at most one object is within `within_rad` of the ray."""
        return sum(one.angle_rad - one.half_rad < within_rad for one in self._seen.values()) <= 1

    def miss_rad(self, object_id: str, cursor: Cursor) -> float | None:
        """Return the angle from the ray itself to the object, 0 if on it. None if it is not near."""
        one = self._seen.get(object_id)
        if one is None or cursor.origin_m is None:
            return None
        reach = vector.subtract(one.center_m, cursor.origin_m)
        return max(0.0, vector.angle_between(self._direction, reach) - one.half_rad)

    def relative_rate(self, object_id: str, rate: tuple[float, float]) -> float:
        """Return the angular speed of a ray that turns at `rate` relative to the object, rad/s at the eyes.

        The object is near; `rate` is the speed of azimuth on the sphere and of elevation, rad/s.
        """
        one = self._seen[object_id]
        u, v, w = one.velocity_mps
        x, y, z = self._direction
        level = math.hypot(x, y) or 1e-12
        turned = (v * x - u * y) / level / one.range_m
        raised = (w * level - (u * x + v * y) * z / level) / one.range_m
        return math.hypot(rate[0] - turned, rate[1] - raised)

    def confidence(self, object_id: str, aim_sigma_rad: float) -> float | None:
        """Return the probability that the object is the target, among all that are near.

        Rays are assumed normal about the centre of the target, with the standard deviation of people's aim
        and a quarter of the object's width: softmax of -angle²/2sigma² with a uniform prior.
        """
        if object_id not in self._seen:
            return None
        scores = {
            one.id: -0.5 * (one.angle_rad / math.hypot(aim_sigma_rad, one.half_rad / 2.0)) ** 2
            for one in self._seen.values()
        }
        highest = max(scores.values())
        weights = {name: math.exp(score - highest) for name, score in scores.items()}
        return weights[object_id] / math.fsum(weights.values())

    def snapped(self, object_id: str, cursor: Cursor, snap_rad: float) -> tuple[Vec3, float | None] | None:
        """Return the snapped cursor on the object, and its arc length on its own surface.

        On the object's own line the cursor moves along to the object's end. If it is on no line it moves from
        the ray to the nearest point of the object. None if it is on the object already, on another line, or
        would move by more than `snap_rad` at the eyes.
        """
        one = self._seen.get(object_id)
        if one is None or cursor.origin_m is None or cursor.direction is None:
            return None
        if cursor.surface in LINES:
            return _drawn_along(one, cursor, cursor.origin_m, snap_rad)
        first = vector.subtract(
            vector.subtract(one.center_m, vector.scale(one.along, one.half_m)), cursor.origin_m
        )
        step = vector.scale(one.along, 2.0 * one.half_m)
        t, _ = nearest_in_angle(first, step, cursor.direction)
        reach = vector.add(first, vector.scale(step, t))
        if vector.angle_between(cursor.direction, reach) > snap_rad:
            return None
        return vector.add(cursor.origin_m, reach), None


def _drawn_along(
    one: VisibleObject, cursor: Cursor, origin_m: Vec3, snap_rad: float
) -> tuple[Vec3, float | None] | None:
    place = one.place
    if place is None or cursor.point_m is None:
        return None
    if (place.surface, place.surface_id) != (cursor.surface, cursor.surface_id):
        return None
    beside_m = cursor.position_m - place.position_m
    position_m = place.position_m + min(max(beside_m, -one.half_m), one.half_m)
    if abs(position_m - cursor.position_m) < SAME_M:
        return None
    point_m = place.line.point_at(position_m)
    shown = vector.subtract(cursor.point_m, origin_m)
    moved_rad = vector.angle_between(shown, vector.subtract(point_m, origin_m))
    return None if moved_rad > snap_rad else (point_m, position_m)
