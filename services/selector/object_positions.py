"""Object under a cursor, with positions at the time when the cursor was captured."""

import math
from collections.abc import Container, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, TrackedObject, TrackedObjects
from pointit.schemas.environment import ThingMode
from pointit.schemas.pointing import LINES

Indices = NDArray[np.int64]

OWN = ""
"""Name of the selector's own clock. Others have the names of their trackers."""
LEFT_AFTER_NS = NS_PER_S // 2
"""Time after which an object that is missing from its tracker's list has left, ns."""

MAX_TRACKERS = 64
"""Limit of trackers. Beyond it the one silent for longest is forgotten."""


class Departures:
    """Gives missing objects some time to come back.

    An object that its tracker no longer lists has left after `LEFT_AFTER_NS`. One that was selected before a
    restart and has not been seen since has left after `unseen_after_s`. The time must pass on one clock,
    whichever is first, since trackers on other machines have clocks of their own.
    """

    def __init__(self, unseen_after_s: float) -> None:
        self._unseen_ns = round(unseen_after_s * NS_PER_S)
        self._missed: dict[str, tuple[int, dict[str, int]]] = {}
        """By object: time to wait, ns, and by clock the time since which it is missing, ns."""

    def expect(self, object_ids: Iterable[str], now_ns: int) -> None:
        """Wait for `object_ids` to be seen for the first time. `now_ns` is on our own clock."""
        for object_id in object_ids:
            self._missed[object_id] = (self._unseen_ns, {OWN: now_ns})

    def step(
        self, selected: Iterable[str], present: Container[str], now_ns: int, clock: str = OWN
    ) -> list[str]:
        """Return those of `selected` that have left by `now_ns` of `clock`, given the `present` objects."""
        left_ids: list[str] = []
        for object_id in selected:
            if object_id in present:
                self._missed.pop(object_id, None)
                continue
            wait_ns, missing_since_ns = self._missed.setdefault(object_id, (LEFT_AFTER_NS, {}))
            began_ns = missing_since_ns.setdefault(clock, now_ns)
            if began_ns > now_ns + NS_PER_S:  # the tracker's clock was set back
                missing_since_ns[clock] = now_ns
            elif now_ns - began_ns >= wait_ns:
                del self._missed[object_id]
                left_ids.append(object_id)
        return left_ids


class _OnLine:
    """Objects on one strip or belt."""

    def __init__(self, objects: Sequence[TrackedObject], margin_m: float) -> None:
        self._objects: list[tuple[float, float, float, TrackedObject]] = []
        """Position, speed and reach of each; plain numbers, as a line has few objects."""
        for tracked in objects:
            reach_m = tracked.length_m / 2.0 + margin_m
            position_m = tracked.surface_position_m
            self._objects.append((position_m, tracked.surface_speed_mps, reach_m, tracked))

    def nearest(self, position_m: float, elapsed_s: float) -> tuple[float, TrackedObject] | None:
        """Return the object nearest to an arc length after a time, and the distance, m. None: none is."""
        nearest: tuple[float, TrackedObject] | None = None
        min_m = math.inf
        for start_m, speed_mps, reach_m, tracked in self._objects:
            gap_m = abs(start_m + speed_mps * elapsed_s - position_m)
            if gap_m <= reach_m and gap_m < min_m:
                nearest = (gap_m, tracked)
                min_m = gap_m
        return nearest


class _InSpace:
    """Objects that are on no line: robots, free things."""

    def __init__(self, objects: Sequence[TrackedObject], margin_m: float) -> None:
        self.objects = objects
        self._positions_m: Array = np.array([tracked.position_m for tracked in objects])
        self._velocities_mps: Array = np.array([tracked.velocity_mps for tracked in objects])
        self._reaches_m: Array = np.array([tracked.length_m / 2.0 + margin_m for tracked in objects])

    def nearest(self, point_m: Vec3, elapsed_s: float) -> tuple[float, TrackedObject] | None:
        """Return the object nearest to a point after a time, and the distance, m. None: none is near."""
        offsets_m = self._positions_m + self._velocities_mps * elapsed_s - np.asarray(point_m)
        gaps_m = np.linalg.norm(offsets_m, axis=1)
        gaps_m[~(gaps_m <= self._reaches_m)] = math.inf  # NaN, too
        index = int(gaps_m.argmin())
        gap_m = float(gaps_m[index])
        return None if gap_m == math.inf else (gap_m, self.objects[index])


class _Listing:
    """Last message of one tracker."""

    def __init__(self, message: TrackedObjects, margin_m: float) -> None:
        self.stamp_ns = message.stamp_ns
        self.objects = {tracked.id: tracked for tracked in message.objects}
        lines: dict[tuple[str, str], list[TrackedObject]] = {}
        free: list[TrackedObject] = []
        for tracked in message.objects:
            if tracked.surface in LINES:
                lines.setdefault((tracked.surface, tracked.surface_id), []).append(tracked)
            else:
                free.append(tracked)
        self.lines = {line: _OnLine(objects, margin_m) for line, objects in lines.items()}
        self.free = _InSpace(free, margin_m) if free else None


class ObjectPositions:
    """Positions of all trackers' objects, and the object under a cursor."""

    def __init__(
        self,
        *,
        margin_m: float = 0.05,
        stale_after_s: float = 1.0,
        ended_after_s: float = 30.0,
        lead_s: float = 0.0,
    ) -> None:
        """Create without trackers.

        Args:
            margin_m: distance beside an object within which a cursor still hovers it.
            stale_after_s: objects whose last report is older cannot be hovered.
            ended_after_s: a tracker silent for longer has ended.
            lead_s: time before the decision on its bay from which an object cannot be changed.
        """
        self._lead_ns = round(lead_s * NS_PER_S)
        self._ended_ns = int(ended_after_s * NS_PER_S)
        self._margin_m = margin_m
        self._stale_ns = int(stale_after_s * NS_PER_S)
        self.has_trackers = False
        """True once any tracker has listed its objects."""
        self._trackers: dict[str, _Listing] = {}
        self._objects: dict[str, TrackedObject] = {}

    @property
    def objects(self) -> Mapping[str, TrackedObject]:
        """Return all objects by id, as last listed."""
        return self._objects

    def update(self, tracker: str, message: TrackedObjects) -> list[str]:
        """Replace the list of `tracker`. Return trackers that were forgotten to make room."""
        self.has_trackers = True
        self._trackers.pop(tracker, None)  # append, so that the first is the one silent for longest
        self._trackers[tracker] = _Listing(message, self._margin_m)
        forgotten: list[str] = []
        while len(self._trackers) > MAX_TRACKERS:
            oldest = next(iter(self._trackers))
            forgotten.append(oldest)
            del self._trackers[oldest]
        self._list_objects()
        return forgotten

    def _list_objects(self) -> None:
        objects: dict[str, TrackedObject] = {}
        for listing in self._trackers.values():
            objects.update(listing.objects)
        self._objects = objects

    def mode(self, object_id: str) -> ThingMode:
        """Return the effect of selecting an object: of an unknown one, that it is claimed."""
        tracked = self._objects.get(object_id)
        return "claim" if tracked is None else tracked.mode

    def is_pressed(self, object_id: str) -> bool:
        """Return True if an object is selected by pressing while pointing at it only."""
        tracked = self._objects.get(object_id)
        return tracked is not None and tracked.press

    def too_late(self, object_id: str, now_ns: int) -> str:
        """Return the reason for which the bay of an object cannot be changed at `now_ns`, or `""`.

        If its tracker is silent, the result is `""`, since nothing is known.
        """
        for listing in self._trackers.values():
            tracked = listing.objects.get(object_id)
            if tracked is None or tracked.bay_until_ns is None:
                continue
            if not self._fits(listing, now_ns):
                continue
            if now_ns + self._lead_ns >= tracked.bay_until_ns:
                kind = tracked.kind or "object"
                return f"{kind} is past its last way to another bay, it goes on to bay {tracked.bay}"
        return ""

    def silent(self, now_ns: int) -> list[str]:
        """Return the trackers whose last list is too far from `now_ns` to be used."""
        return [name for name, listing in self._trackers.items() if not self._fits(listing, now_ns)]

    def forget(self, now_ns: int) -> list[str]:
        """Forget and return the trackers whose silence means that they have ended."""
        ended: list[str] = []
        for name, listing in self._trackers.items():
            if abs(now_ns - listing.stamp_ns) > self._ended_ns:
                ended.append(name)
        for name in ended:
            del self._trackers[name]
        if ended:
            self._list_objects()
        return ended

    def hit_test(self, cursor: Cursor) -> TrackedObject | None:
        """Return the object whose centre is nearest to `cursor`, within half its length and the margin.

        Objects are moved by their speed to where they are seen at the cursor's stamp. Those on a strip or
        belt are compared by arc length with cursors on the same one, all others by distance to the cursor's
        point.
        """
        nearest: tuple[float, TrackedObject] | None = None
        stamp_ns = cursor.stamp_ns
        for listing in self._trackers.values():
            if not self._fits(listing, stamp_ns):
                continue
            elapsed_s = (stamp_ns - listing.stamp_ns) / NS_PER_S
            line = listing.lines.get((cursor.surface, cursor.surface_id))
            if line is not None:
                nearest = _nearer(nearest, line.nearest(cursor.position_m, elapsed_s))
            if listing.free is not None and cursor.point_m is not None:
                nearest = _nearer(nearest, listing.free.nearest(cursor.point_m, elapsed_s))
        if nearest is None:
            return None
        _gap_m, tracked = nearest
        return tracked

    def _fits(self, listing: _Listing, stamp_ns: int) -> bool:
        """Return True if a list is not too far from `stamp_ns` to be used."""
        return abs(stamp_ns - listing.stamp_ns) <= self._stale_ns


def _nearer(
    a: tuple[float, TrackedObject] | None, b: tuple[float, TrackedObject] | None
) -> tuple[float, TrackedObject] | None:
    """Return the pair with the smaller distance, `a` if they are equal."""
    if a is None:
        return b
    if b is None:
        return a
    return b if b[0] < a[0] else a


class LineTable:
    """Concatenated polylines, each addressed by its number and arc length.

    Lines are extended straight beyond their ends.
    """

    def __init__(self, lines: Mapping[tuple[str, str], Polyline]) -> None:
        self._lines = dict(lines)
        self._numbers = {key: number for number, key in enumerate(lines)}
        starts: list[float] = []
        # without the empty arrays `concatenate` would refuse a map without lines
        arcs: list[Array] = [np.zeros(0)]
        vertices: list[Array] = [np.zeros((0, 3))]
        tangents: list[Array] = [np.zeros((0, 3))]
        start = 0.0
        for line in lines.values():
            starts.append(start)
            arcs.append(start + line.starts_m)
            vertices.append(line.vertices_m)
            tangents.append(np.vstack([line.tangents, line.tangents[-1:]]))
            start += line.length_m + 1.0  # a gap, so that no end is the next start
        self._starts: Array = np.array(starts)
        self._lengths_m: Array = np.array([line.length_m for line in lines.values()])
        self._arcs: Array = np.concatenate(arcs)
        self._vertices: Array = np.concatenate(vertices)
        self._tangents: Array = np.concatenate(tangents)

    def has(self, surface: str, surface_id: str) -> bool:
        """Return True if the table has this line."""
        return (surface, surface_id) in self._numbers

    def index(self, surface: str, surface_id: str) -> int:
        """Return the number of a line."""
        return self._numbers[surface, surface_id]

    def line(self, surface: str, surface_id: str) -> Polyline:
        """Return the polyline of a line."""
        return self._lines[surface, surface_id]

    def at(self, which: Indices, positions_m: Array) -> tuple[Array, Array]:
        """Return points and tangents (n x 3 each) at `positions_m` (n) of the lines numbered `which` (n)."""
        segments, beyond_m = self._segments(which, positions_m)
        tangents = self._tangents[segments]
        points_m = self._vertices[segments] + beyond_m[:, None] * tangents
        return points_m, tangents

    def around(self, which: Indices, positions_m: Array) -> tuple[Array, Array, Array, Array]:
        """Return points, tangents, and the straight distances before and after, m (infinite at ends)."""
        points_m, tangents = self.at(which, positions_m)
        segments, beyond_m = self._segments(which, positions_m)
        arcs = self._arcs
        starts = self._starts[which]
        ends = starts + self._lengths_m[which]
        segment_starts = arcs[segments]
        next_starts = arcs[np.minimum(segments + 1, len(arcs) - 1)]
        is_first = segment_starts <= starts + 1e-9
        is_last = next_starts >= ends - 1e-9
        before_m = np.where(is_first, math.inf, beyond_m)
        after_m = np.where(is_last, math.inf, next_starts - segment_starts - beyond_m)
        return points_m, tangents, before_m, after_m

    def _segments(self, which: Indices, positions_m: Array) -> tuple[Indices, Array]:
        """Return the table's row of each position, and the distance of the position behind that vertex, m."""
        starts = self._starts[which]
        within_m = np.minimum(np.maximum(positions_m, 0.0), self._lengths_m[which])
        segments = self._arcs.searchsorted(starts + within_m, side="right") - 1
        return segments, starts + positions_m - self._arcs[segments]
