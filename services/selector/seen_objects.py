"""Objects as seen from a person's eyes, at the time of their ray, and the object that is pointed at."""

import math
from collections.abc import Collection, Iterable, Sequence
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.geometry.polyline import Polyline, nearest_in_angle
from pointit.geometry.solids import MAX_EYES, BoxSolid
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Environment, TrackedObject, TrackedObjects
from pointit.schemas.pointing import LINES
from pointit.services.selector.object_positions import LineTable

_Sights = tuple[Array, Array, Array, Array, Array]
"""Centres of objects and vectors to them, n x 3; distances, m; half widths, and angles up to which they are
near a ray, rad, n each."""

LEAVE_FACTOR = 1.5
"""The pointer leaves an object beyond this multiple of the object's tolerance."""

SPARSE_RAD = math.radians(10.0)
"""Angle from the ray within which another object counts as near."""

SAME_M = 1e-9
"""Positions nearer to each other than this are equal, m."""

NEAREST_M = 1e-3
"""Lower limit of the distance to the eyes, m."""

HAIR_M = 1e-6
"""Length that is added to distances, m: it keeps them above 0, and cosines above -1."""

MAX_SEEN = 32
"""Limit of objects near a ray. Beyond it those at the smallest angles are used."""

STRAIGHT_M = 0.02
"""Distance along a line that counts as straight, m. On an arc of 0.5 m radius the error is 0.4 mm."""

MAX_SOLIDS = 8
"""The same where objects are boxes, by the balls around them: their outlines cost more."""

_box = lru_cache(1024)(BoxSolid)
"""Returns the box of a centre, size and yaw: most stand still."""

OPAQUE = frozenset({"box", "cylinder", "sphere"})
"""Solids that hide what is behind them. Planes are floors and table tops, on which objects stand."""

XYZ = np.ones(3)


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
        self._seen = {visible.id: visible for visible in seen}

    @property
    def seen(self) -> Collection[VisibleObject]:
        """Return the objects."""
        return self._seen.values()

    def pick(self, kept: str | None, snap_rad: float, hysteresis: float) -> str | None:
        """Return the object at the smallest angle, among those within half width and `snap_rad`.

        `kept` is preferred until another angle is smaller by the share `hysteresis`.
        """
        nearest: VisibleObject | None = None
        for visible in self._seen.values():
            is_within = visible.angle_rad <= visible.half_rad + snap_rad
            if not is_within:
                continue
            if nearest is None or visible.angle_rad < nearest.angle_rad:
                nearest = visible
        if nearest is None:
            return None
        if kept is None or nearest.id == kept:
            return nearest.id

        # The object that was picked before, if the ray is still within its tolerance
        previous = self._seen.get(kept)
        if previous is None or previous.angle_rad > previous.half_rad + snap_rad:
            return nearest.id
        is_similar = nearest.angle_rad >= (1.0 - hysteresis) * previous.angle_rad
        return kept if is_similar else nearest.id

    def near(self, object_ids: Iterable[str], snap_rad: float, leave_factor: float) -> set[str]:
        """Return the ids whose angle from the ray is at most `leave_factor` x (half width + `snap_rad`)."""
        near_ids: set[str] = set()
        for object_id in object_ids:
            visible = self._seen.get(object_id)
            if visible is None:
                continue
            tolerance_rad = visible.half_rad + snap_rad
            if visible.angle_rad <= leave_factor * tolerance_rad:
                near_ids.add(object_id)
        return near_ids

    def is_isolated(self, within_rad: float) -> bool:
        """Return True if at most one object is within `within_rad` of the ray."""
        count = 0
        for visible in self._seen.values():
            if visible.angle_rad - visible.half_rad < within_rad:
                count += 1
        return count <= 1

    def miss_rad(self, object_id: str, cursor: Cursor) -> float | None:
        """Return the angle from the ray itself to the object, 0 if on it. None if it is not near."""
        visible = self._seen.get(object_id)
        if visible is None or cursor.origin_m is None:
            return None
        reach = vector.subtract(visible.center_m, cursor.origin_m)
        angle_rad = vector.angle_between(self._direction, reach)
        return max(0.0, angle_rad - visible.half_rad)

    def relative_rate(self, object_id: str, rate: tuple[float, float]) -> float:
        """Return the angular speed of a ray that turns at `rate` relative to the object, rad/s at the eyes.

        The object is near. `rate` is the speed of azimuth on the sphere and of elevation, rad/s.
        """
        visible = self._seen[object_id]
        u, v, w = visible.velocity_mps
        x, y, z = self._direction
        level = math.hypot(x, y) or 1e-12  # a vertical ray has no azimuth
        azimuth_rate = (v * x - u * y) / level / visible.range_m
        elevation_rate = (w * level - (u * x + v * y) * z / level) / visible.range_m
        return math.hypot(rate[0] - azimuth_rate, rate[1] - elevation_rate)

    def confidence(self, object_id: str, aim_sigma_rad: float) -> float | None:
        """Return the probability that the object is the target, among all that are near.

        Rays are assumed normal about the centre of the target, with the standard deviation of people's aim
        and a quarter of the object's width: softmax of -angle²/2sigma² with a uniform prior.
        """
        if object_id not in self._seen:
            return None
        scores: dict[str, float] = {}
        for visible in self._seen.values():
            sigma_rad = math.hypot(aim_sigma_rad, visible.half_rad / 2.0)
            scores[visible.id] = -0.5 * (visible.angle_rad / sigma_rad) ** 2
        highest = max(scores.values())  # subtracted, so that not all weights vanish
        weights = {name: math.exp(score - highest) for name, score in scores.items()}
        return weights[object_id] / math.fsum(weights.values())

    def snapped(self, object_id: str, cursor: Cursor, snap_rad: float) -> tuple[Vec3, float | None] | None:
        """Return the snapped cursor on the object, and its arc length on its own surface.

        On the object's own line the cursor moves along to the object's end. If it is on no line it moves from
        the ray to the nearest point of the object. None if it is on the object already, on another line, or
        would move by more than `snap_rad` at the eyes.
        """
        visible = self._seen.get(object_id)
        if visible is None:
            return None
        if cursor.origin_m is None or cursor.direction is None:
            return None
        if cursor.surface in LINES:
            return _snapped_along_line(visible, cursor, cursor.origin_m, snap_rad)

        # On no line: from the ray to the nearest point between the two ends of the object
        to_start = vector.scale(visible.along, visible.half_m)
        start_m = vector.subtract(vector.subtract(visible.center_m, to_start), cursor.origin_m)
        step_m = vector.scale(visible.along, 2.0 * visible.half_m)
        t, _ = nearest_in_angle(start_m, step_m, cursor.direction)
        nearest_m = vector.add(start_m, vector.scale(step_m, t))
        if vector.angle_between(cursor.direction, nearest_m) > snap_rad:
            return None
        return vector.add(cursor.origin_m, nearest_m), None


def _snapped_along_line(
    visible: VisibleObject, cursor: Cursor, origin_m: Vec3, snap_rad: float
) -> tuple[Vec3, float | None] | None:
    """Return point and arc length of a cursor that moves along its line to the end of an object.

    None under the conditions of `View.snapped`.
    """
    place = visible.place
    if place is None or cursor.point_m is None:
        return None
    if (place.surface, place.surface_id) != (cursor.surface, cursor.surface_id):
        return None
    offset_m = cursor.position_m - place.position_m
    position_m = place.position_m + min(max(offset_m, -visible.half_m), visible.half_m)
    if abs(position_m - cursor.position_m) < SAME_M:
        return None
    point_m = place.line.point_at(position_m)
    shown = vector.subtract(cursor.point_m, origin_m)
    snapped = vector.subtract(point_m, origin_m)
    moved_rad = vector.angle_between(shown, snapped)
    return None if moved_rad > snap_rad else (point_m, position_m)


class SeenObjects:
    """The map's lines and every tracker's objects, viewed from any eyes at any time."""

    def __init__(
        self,
        *,
        stale_after_s: float = 1.0,
        reach_rad: float = SPARSE_RAD,
        aim: Literal["cursor", "ray"] = "cursor",
    ) -> None:
        """Create an empty scene.

        Args:
            stale_after_s: objects whose list is farther from a ray in time are not seen.
            reach_rad: angle beyond `LEAVE_FACTOR` times their half width within which objects are near a ray.
            aim: reference of angles: the ray, or with `cursor`, if that is on a line, the direction in which
                it is shown. A line does not show how far the ray passes beside it, so people cannot correct
                that: their ray may pass by degrees while the light is on the object.
        """
        self._stale_s = stale_after_s
        self._reach_rad = reach_rad
        self._aims_at_cursor = aim == "cursor"
        self._lines = LineTable({})
        self._listings: dict[str, TrackedObjects] = {}
        self._set_objects([], [])

    def on_map(self, environment: Environment) -> None:
        """Set the lines of the map. A line without length is ignored."""
        lines: dict[tuple[str, str], Polyline] = {}
        for surface, items in (("strip", environment.strips), ("belt", environment.belts)):
            for item in items:
                try:
                    lines[surface, item.id] = Polyline(item.line_m)
                except ValueError:
                    continue  # the map's publisher reports it; its objects move straight
        self._lines = LineTable(lines)
        self._relist()

    def update(self, tracker: str, message: TrackedObjects) -> None:
        """Replace the list of `tracker`."""
        self._listings[tracker] = message
        self._relist()

    def forget(self, tracker: str) -> None:
        """Forget the objects of `tracker`."""
        if self._listings.pop(tracker, None) is not None:
            self._relist()

    def view_from(self, cursor: Cursor) -> View | None:
        """Return the objects around the ray of `cursor`. None if it has no ray or there are no objects."""
        origin_m = cursor.origin_m
        direction = cursor.direction
        if origin_m is None or direction is None:
            return None
        if not self._tracked:
            return None

        # All objects as seen from these eyes, from the cache while nothing moves
        age_s = (cursor.stamp_ns - self._base_ns) / NS_PER_S
        sights = self._sights.get(origin_m) or self._sights_from(origin_m, age_s)
        centers_m, reach_m, ranges_m, halves_rad, limits_rad = sights

        # Angles from the ray to boxes, whose outlines it passes, and from the cursor as shown to all others
        aim = self._aim_direction(cursor, origin_m, direction)
        along_m = reach_m @ np.array(aim)
        if self._solids and aim is not direction:
            along_m[self._solid] = reach_m[self._solid] @ np.array(direction)
        angles = np.arccos(np.minimum(along_m / ranges_m, 1.0))

        # Those near the ray: not too many, in time, and not behind something opaque
        near = (angles <= limits_rad).nonzero()[0]
        if self._solids and len(near) > MAX_SOLIDS:
            gaps_rad = (angles - halves_rad)[near]
            near = near[gaps_rad.argpartition(MAX_SOLIDS)[:MAX_SOLIDS]]
        elif len(near) > MAX_SEEN:
            near = near[angles[near].argpartition(MAX_SEEN)[:MAX_SEEN]]
        if self._ages_s is not None:
            near = near[np.abs(age_s + self._ages_s[near]) <= self._stale_s]
        elif abs(age_s) > self._stale_s:
            near = near[:0]
        if cursor.solid in OPAQUE:
            near = near[ranges_m[near] - self._halves_m[near] <= cursor.range_m]

        # From here on plain numbers, as few objects are left
        rows = zip(
            near.tolist(),
            centers_m[near].tolist(),
            angles[near].tolist(),
            ranges_m[near].tolist(),
            strict=True,
        )
        seen: list[VisibleObject] = []
        for index, center, angle, range_m in rows:
            seen.append(self._visible(index, cursor, center, angle, range_m))
        return View(direction, seen)

    def _sights_from(self, origin_m: Vec3, elapsed_s: float) -> "_Sights":
        """Return all objects from some eyes after a time, and store them while nothing moves."""
        if self._ages_s is not None:
            centers_m = self._moved_m(elapsed_s + self._ages_s)
        elif self._straight_s[0] <= elapsed_s <= self._straight_s[1]:
            centers_m = self._centers_m + self._velocities_mps * elapsed_s
        else:
            centers_m = self._moved_m(np.full(len(self._tracked), elapsed_s))
        reach_m = centers_m - origin_m
        # slightly more than it is: avoids division by zero and keeps cosines above -1
        ranges_m = np.sqrt((reach_m * reach_m) @ XYZ) + HAIR_M
        halves_rad = self._halves_m / ranges_m
        limits_rad = LEAVE_FACTOR * halves_rad + self._reach_rad
        sights = (centers_m, reach_m, ranges_m, halves_rad, limits_rad)
        if self._are_still:
            if len(self._sights) >= MAX_EYES:
                self._sights.clear()
            self._sights[origin_m] = sights
        return sights

    def _aim_direction(self, cursor: Cursor, origin_m: Vec3, direction: Vec3) -> Vec3:
        """Return the direction of reference: to the cursor as shown on a line, or else that of the ray."""
        if not self._aims_at_cursor or cursor.surface not in LINES:
            return direction
        if cursor.point_m is None:
            return direction
        shown = vector.subtract(cursor.point_m, origin_m)
        if vector.norm(shown) > NEAREST_M:
            return vector.normalized(shown)
        return direction

    def _visible(
        self, index: int, cursor: Cursor, center: Sequence[float], angle_rad: float, range_m: float
    ) -> VisibleObject:
        """Return the object of `index` as seen along the ray of `cursor`."""
        tracked = self._tracked[index]
        x, y, z = center
        center_m = (x, y, z)
        half_m = tracked.length_m / 2.0
        range_m = max(range_m, NEAREST_M)
        along = (0.0, 0.0, 0.0)
        velocity_mps = tracked.velocity_mps
        place = None
        across = 1.0

        # On a line: its position there at the time of the ray, and how much shorter it looks from the side
        if index < self._on_lines:
            age_s = 0.0 if self._ages_s is None else float(self._ages_s[index])
            elapsed_s = (cursor.stamp_ns - self._base_ns) / NS_PER_S + age_s
            position_m = tracked.surface_position_m + tracked.surface_speed_mps * elapsed_s
            line = self._lines.line(tracked.surface, tracked.surface_id)
            along = self._tangents[index]
            if not self._straight_s[0] <= elapsed_s <= self._straight_s[1]:
                along = line.tangent_at(position_m)
            velocity_mps = vector.scale(along, tracked.surface_speed_mps)
            place = OnLine(tracked.surface, tracked.surface_id, position_m, line)
            reach = vector.subtract(center_m, cursor.origin_m or center_m)
            foreshortened = vector.dot(along, reach) / range_m
            across = math.sqrt(max(0.0, 1.0 - foreshortened * foreshortened))
        half_rad = math.atan(half_m * across / range_m)

        # A box: its half width ends at the nearest point of its outline, and holds the ray that meets it
        outline_m = None
        size_m = self._solids.get(index)
        if size_m is not None and cursor.origin_m is not None and cursor.direction is not None:
            solid = _box(center_m, size_m, tracked.yaw_rad or 0.0)
            outline_m = solid.passed_at(cursor.origin_m, cursor.direction)
            half_rad = max(angle_rad, half_rad)
            if outline_m is not None:
                to_outline = vector.subtract(outline_m, cursor.origin_m)
                outline_rad = vector.angle_between(cursor.direction, to_outline)
                half_rad = max(angle_rad - outline_rad, 0.0)
        return VisibleObject(
            tracked.id,
            angle_rad,
            half_rad,
            center_m,
            velocity_mps,
            along,
            half_m,
            range_m,
            place,
            tracked,
            outline_m,
        )

    def _moved_m(self, elapsed_s: Array) -> Array:
        """Return the centres after `elapsed_s` (n), moved along their lines or straight."""
        count = self._on_lines
        centers_m = self._centers_m + self._velocities_mps * elapsed_s[:, None]
        if count:
            along_m = self._along_m + self._speeds_mps * elapsed_s[:count]
            points_m, _tangents = self._lines.at(self._which, along_m)
            centers_m[:count] = self._beside_m + points_m
        return centers_m

    def _relist(self) -> None:
        """Sort the objects of all trackers: those on lines first."""
        on_lines: list[tuple[TrackedObject, int]] = []
        free: list[tuple[TrackedObject, int]] = []
        for message in self._listings.values():
            for tracked in message.objects:
                if self._lines.has(tracked.surface, tracked.surface_id):
                    on_lines.append((tracked, message.stamp_ns))
                else:
                    free.append((tracked, message.stamp_ns))
        self._set_objects(on_lines, free)

    def _set_objects(
        self, on_lines: Sequence[tuple[TrackedObject, int]], free: Sequence[tuple[TrackedObject, int]]
    ) -> None:
        """Fill the arrays, in which the objects on lines come first."""
        # Ages, relative to the newest list
        objects_with_stamps = [*on_lines, *free]
        self._tracked = [tracked for tracked, _ in objects_with_stamps]
        stamps_ns = [stamp_ns for _, stamp_ns in objects_with_stamps]
        self._base_ns = max(stamps_ns, default=0)
        self._ages_s: Array | None = None
        if min(stamps_ns, default=0) != self._base_ns:  # from several trackers
            self._ages_s = np.array([(self._base_ns - stamp_ns) / NS_PER_S for stamp_ns in stamps_ns])

        # Sizes: of a box the half diagonal, as it may stand in any direction
        self._solids: dict[int, Vec3] = {}
        """Sizes of the objects that are boxes, by index."""
        halves_m: list[float] = []
        for index, tracked in enumerate(self._tracked):
            if tracked.size_m is None:
                halves_m.append(tracked.length_m / 2.0)
            else:
                self._solids[index] = tracked.size_m
                halves_m.append(vector.norm(tracked.size_m) / 2.0)
        self._solid = np.array(list(self._solids), dtype=np.intp)
        self._halves_m: Array = np.array(halves_m)

        # Motion: straight, or along a line
        positions_m = [tracked.position_m for tracked in self._tracked]
        velocities_mps = [tracked.velocity_mps for tracked in self._tracked]
        self._centers_m: Array = np.array(positions_m).reshape(-1, 3)
        self._velocities_mps: Array = np.array(velocities_mps).reshape(-1, 3)
        self._straight_s = (-math.inf, math.inf)
        count = len(on_lines)
        self._on_lines = count
        if count:
            lined = self._tracked[:count]
            self._which = np.array([self._lines.index(item.surface, item.surface_id) for item in lined])
            self._along_m: Array = np.array([item.surface_position_m for item in lined])
            self._speeds_mps: Array = np.array([item.surface_speed_mps for item in lined])
            points_m, tangents, before_m, after_m = self._lines.around(self._which, self._along_m)
            self._beside_m = self._centers_m[:count] - points_m
            """Offset from the line, kept in motion: height above the line, the tracker's noise."""
            self._velocities_mps[:count] = tangents * self._speeds_mps[:, None]
            self._tangents: list[Vec3] = [(x, y, z) for x, y, z in tangents.tolist()]
            self._straight_s = _straight_s(self._speeds_mps, before_m, after_m)
        self._are_still = not self._velocities_mps.any()
        self._sights: dict[Vec3, _Sights] = {}
        """Objects as seen from the eyes of people, kept while nothing moves."""


def _straight_s(speeds_mps: Array, before_m: Array, after_m: Array) -> tuple[float, float]:
    """Return the interval in which all objects move straight, s, from the straight distances around them."""
    fast = np.maximum(np.abs(speeds_mps), 1e-9)
    is_forward = speeds_mps >= 0.0
    ahead_m = np.where(is_forward, after_m, before_m)
    behind_m = np.where(is_forward, before_m, after_m)
    future_s = np.maximum(ahead_m, STRAIGHT_M) / fast
    past_s = np.maximum(behind_m, STRAIGHT_M) / fast
    return -float(past_s.min()), float(future_s.min())
