"""Tracked objects and things of a map: positions at a given time, duplicates of two trackers. Pure.

Two report one object by one id, or by two ids that stay at one place.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Thing, TrackedObject, TrackedObjects
from pointit.services.pui.workspace import WorkspaceError

TRACKER = "things"
PERIOD_S = 0.4
"""Period at which the things are listed again, s. Subscribers take silence for the end of their tracker."""


CHECK_S = 0.5
"""Time between two comparisons."""

MAX_STAMP_DIFFERENCE_S = 1.0
"""Objects of trackers whose stamps differ by more are not compared."""

STAYS_S = 2.0
"""Time for which two objects must stay at one place to count as one."""

SIGMA_M = 0.05
"""Standard deviation of positions whose tracker does not state it, m."""

GATE = 2.0
"""Number of standard deviations of the distance up to which two positions are the same place."""

MAX_OBJECT_AGE_NS = 2 * NS_PER_S
"""Age at which an object's position is unknown, ns."""


def listing(environment: Environment, stamp_ns: int) -> TrackedObjects:
    """Return the things of `environment`, those with a part of a strip as objects on it."""
    lines = {strip.id: strip.line_m for strip in environment.strips}
    objects = tuple(_tracked(thing, lines) for thing in environment.fixed_things)
    return TrackedObjects(stamp_ns=stamp_ns, objects=objects)


def _tracked(thing: Thing, lines: dict[str, tuple[tuple[float, float, float], ...]]) -> TrackedObject:
    if thing.strip not in lines:
        return TrackedObject(
            id=thing.id,
            position_m=thing.center_m,
            length_m=max(thing.size_m[:2]),
            yaw_rad=thing.yaw_rad,
            size_m=thing.size_m,
            **thing.object_fields,
        )

    # a part may be stated beyond the ends of its strip
    strip_m = Polyline(lines[thing.strip]).length_m
    start_m, end_m = (min(max(at_m, 0.0), strip_m) for at_m in thing.part_m)
    return TrackedObject(
        id=thing.id,
        position_m=thing.center_m,
        length_m=end_m - start_m,
        surface="strip",
        surface_id=thing.strip,
        surface_position_m=(start_m + end_m) / 2.0,
        yaw_rad=thing.yaw_rad,
        size_m=thing.size_m,
        **thing.object_fields,
    )


@dataclass(frozen=True, order=True)
class DuplicateObject:
    """An object that two trackers report."""

    tracker: str
    object_id: str
    other_tracker: str
    other_id: str

    @property
    def sentence(self) -> str:
        """Return the problem and the remedy."""
        if self.object_id == self.other_id:
            return (
                f"the trackers {self.tracker} and {self.other_tracker} both report {self.object_id}: leave "
                "it out of one of them, or rename it if these are two things"
            )
        return (
            f"{self.object_id} of the tracker {self.tracker} and {self.other_id} of {self.other_tracker} "
            "stay at one place: if they are one thing, leave it out of one of them"
        )


class DuplicateFinder:
    """Compares the newest objects of all trackers."""

    def __init__(self) -> None:
        self._newest: dict[str, TrackedObjects] = {}
        self._since_ns: dict[DuplicateObject, int] = {}
        self._checked_ns: int | None = None

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Set the objects of `tracker`, and compare if it is time."""
        self._newest[tracker] = message
        now_ns = message.stamp_ns
        if len(self._newest) < 2:
            return
        if self._checked_ns is not None and abs(now_ns - self._checked_ns) < CHECK_S * NS_PER_S:
            return

        self._checked_ns = now_ns
        since_ns: dict[DuplicateObject, int] = {}
        for duplicate in _near(self._comparable(now_ns), now_ns):
            # the clock may have been set back, so a time in the future becomes now
            since_ns[duplicate] = min(self._since_ns.get(duplicate, now_ns), now_ns)
        self._since_ns = since_ns

    def _comparable(self, now_ns: int) -> dict[str, TrackedObjects]:
        """Return the newest objects of the trackers that have sent some about `now_ns`, by name in order."""
        max_difference_ns = MAX_STAMP_DIFFERENCE_S * NS_PER_S
        comparable: dict[str, TrackedObjects] = {}
        for name, newest in sorted(self._newest.items()):
            is_recent = abs(now_ns - newest.stamp_ns) <= max_difference_ns
            if newest.objects and is_recent:
                comparable[name] = newest
        return comparable

    @property
    def duplicates(self) -> tuple[DuplicateObject, ...]:
        """Return the objects that two trackers report now, in order."""
        now_ns = self._checked_ns or 0
        duplicates: list[DuplicateObject] = []
        for duplicate, since_ns in self._since_ns.items():
            # objects with two ids may meet for a moment, such as packages on crossing belts
            has_one_id = duplicate.object_id == duplicate.other_id
            if has_one_id or now_ns - since_ns >= STAYS_S * NS_PER_S:
                duplicates.append(duplicate)
        return tuple(sorted(duplicates))


def _near(trackers: dict[str, TrackedObjects], now_ns: int) -> Iterator[DuplicateObject]:
    """Yield the pairs of objects of different trackers with one id, or at one place at `now_ns`."""
    placed = {name: _placed(message, now_ns) for name, message in trackers.items()}
    for (name, own), (other_name, others) in itertools.combinations(placed.items(), 2):
        own_ids = {item.id for item in own.objects}
        for item in others.objects:
            if item.id in own_ids:
                yield DuplicateObject(name, item.id, other_name, item.id)
        for own_row, other_row in _pairs_at_one_place(own, others):
            own_id = own.objects[own_row].id
            other_id = others.objects[other_row].id
            if own_id != other_id:
                yield DuplicateObject(name, own_id, other_name, other_id)


def _pairs_at_one_place(own: "_PlacedObjects", others: "_PlacedObjects") -> Iterator[tuple[int, int]]:
    """Yield the rows of objects whose distance is within `GATE` standard deviations, row by row of `others`.

    Only objects whose x is near are compared, so that many objects cost little.
    """
    by_x = np.argsort(own.positions_m[:, 0])
    own_x_m = own.positions_m[by_x, 0]
    reach_m = GATE * math.hypot(float(own.sigmas_m.max()), float(others.sigmas_m.max()))
    ranges = np.searchsorted(own_x_m, others.positions_m[:, :1] + (-reach_m, reach_m))
    for other_row, (begin, end) in enumerate(ranges.tolist()):
        candidates = by_x[begin:end]
        offsets_m = own.positions_m[candidates] - others.positions_m[other_row]
        distances_m = np.linalg.norm(offsets_m, axis=1)
        sigmas_m = np.hypot(own.sigmas_m[candidates], others.sigmas_m[other_row])
        for own_row in candidates[distances_m <= GATE * sigmas_m]:
            yield int(own_row), other_row


@dataclass(frozen=True)
class _PlacedObjects:
    """The objects of a tracker at one time."""

    objects: tuple[TrackedObject, ...]
    positions_m: Array
    """Position of each in {W}, n x 3, m."""
    sigmas_m: Array
    """Standard deviation of each position, n, m."""


def _placed(message: TrackedObjects, now_ns: int) -> _PlacedObjects:
    """Return the objects of `message`, moved to `now_ns` with their velocities."""
    elapsed_s = (now_ns - message.stamp_ns) / NS_PER_S
    positions_m = np.array([item.position_m for item in message.objects], dtype=np.float64)
    velocities_mps = np.array([item.velocity_mps for item in message.objects], dtype=np.float64)
    sigmas_m = [
        SIGMA_M if item.position_sigma_m is None else item.position_sigma_m for item in message.objects
    ]
    return _PlacedObjects(
        objects=message.objects,
        positions_m=positions_m + elapsed_s * velocities_mps,
        sigmas_m=np.array(sigmas_m, dtype=np.float64),
    )


class Tracked:
    """The newest objects of every tracker, moved from their stamp to any other time."""

    def __init__(self, environment: Environment) -> None:
        """Set the map, along whose lines objects move."""
        self._lines: dict[tuple[str, str], tuple[Vec3, ...]] = {}
        for strip in environment.strips:
            self._lines["strip", strip.id] = strip.line_m
        for belt in environment.belts:
            self._lines["belt", belt.id] = belt.line_m
        self._newest: dict[str, TrackedObjects] = {}

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Set the objects of `tracker`."""
        self._newest[tracker] = message

    def where(self, object_id: str, stamp_ns: int) -> Vec3:
        """Return the centre of an object at `stamp_ns`, {W}.

        Raises:
            WorkspaceError: If it is not tracked, or has not been for a while.
        """
        candidates: list[tuple[int, TrackedObject]] = []
        for message in self._newest.values():
            candidates += [(message.stamp_ns, item) for item in message.objects if item.id == object_id]
        if not candidates:
            raise WorkspaceError(f"no object {object_id!r} is known: use the id of one that is tracked now")

        # several trackers may report it: the newest about that time counts
        seen_ns, tracked = min(candidates, key=lambda candidate: abs(stamp_ns - candidate[0]))
        late_ns = stamp_ns - seen_ns
        if late_ns < -MAX_OBJECT_AGE_NS:
            raise WorkspaceError(
                f"object {object_id!r} is tracked by a clock {-late_ns / NS_PER_S:.1f} s ahead of the "
                "person's rays: set the clocks alike, or point first"
            )
        if late_ns > MAX_OBJECT_AGE_NS:
            raise WorkspaceError(
                f"object {object_id!r} was last seen {late_ns / NS_PER_S:.1f} s ago: look for it"
            )
        return self._moved(tracked, late_ns / NS_PER_S)

    def _moved(self, tracked: TrackedObject, late_s: float) -> Vec3:
        """Return the centre of `tracked` after `late_s`, {W}."""
        line = self._lines.get((tracked.surface, tracked.surface_id))
        if line is None:
            step_m = vector.scale(tracked.velocity_mps, late_s)
            return vector.add(tracked.position_m, step_m)

        # along the bends of its line, at the same offset from the line
        polyline = Polyline(line)
        moved_m = polyline.point_at(tracked.surface_position_m + tracked.surface_speed_mps * late_s)
        step_m = vector.subtract(moved_m, polyline.point_at(tracked.surface_position_m))
        return vector.add(tracked.position_m, step_m)
