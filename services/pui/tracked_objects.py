"""Tracked objects and things of a map: positions at a given time, duplicates of two trackers. Pure.

Two report one object by one id, or by two ids that stay at one place.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Thing, TrackedObject, TrackedObjects
from pointit.services.pui.workspace import WorkspaceError

TRACKER = "things"
PERIOD_S = 0.4
"""Period at which the things are listed again, s. Subscribers take silence for the end of their tracker."""

Array = NDArray[np.float64]

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
    on_strip = thing.strip in lines
    length_m = Polyline(lines[thing.strip]).length_m if on_strip else 0.0
    start_m, end_m = (min(max(at_m, 0.0), length_m) for at_m in thing.part_m)
    return TrackedObject(
        id=thing.id,
        position_m=thing.center_m,
        length_m=end_m - start_m if on_strip else max(thing.size_m[:2]),
        surface="strip" if on_strip else "none",
        surface_id=thing.strip if on_strip else "",
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
        fresh_ns = MAX_STAMP_DIFFERENCE_S * NS_PER_S
        there = {
            name: newest
            for name, newest in sorted(self._newest.items())
            if newest.objects and abs(now_ns - newest.stamp_ns) <= fresh_ns
        }
        near = set(_near(there, now_ns))
        self._since_ns = {duplicate: min(self._since_ns.get(duplicate, now_ns), now_ns) for duplicate in near}

    @property
    def duplicates(self) -> tuple[DuplicateObject, ...]:
        """Return the objects that two trackers report now, in order."""
        now_ns = self._checked_ns or 0
        return tuple(
            sorted(
                duplicate
                for duplicate, since_ns in self._since_ns.items()
                if duplicate.object_id == duplicate.other_id or now_ns - since_ns >= STAYS_S * NS_PER_S
            )
        )


def _near(trackers: dict[str, TrackedObjects], now_ns: int) -> Iterator[DuplicateObject]:
    """Yield the pairs of objects of different trackers with one id, or at one place at `now_ns`."""
    names = list(trackers)
    for index, name in enumerate(names):
        own, places, sigmas = _placed(trackers[name], now_ns)
        ids = {item.id for item in own}
        order = np.argsort(places[:, 0])
        for other in names[index + 1 :]:
            other_objects, other_places, other_sigmas = _placed(trackers[other], now_ns)
            for item in other_objects:
                if item.id in ids:
                    yield DuplicateObject(name, item.id, other, item.id)
            reach_m = GATE * math.hypot(float(sigmas.max()), float(other_sigmas.max()))
            ends = np.searchsorted(places[order, 0], other_places[:, :1] + (-reach_m, reach_m))
            for row, (begin, end) in enumerate(ends.tolist()):
                columns = order[begin:end]
                apart_m = np.linalg.norm(places[columns] - other_places[row], axis=1)
                is_near = apart_m <= GATE * np.hypot(sigmas[columns], other_sigmas[row])
                for column in map(int, columns[is_near]):
                    if own[column].id != other_objects[row].id:
                        yield DuplicateObject(name, own[column].id, other, other_objects[row].id)


def _placed(message: TrackedObjects, now_ns: int) -> tuple[tuple[TrackedObject, ...], Array, Array]:
    """Return the objects, their positions at `now_ns` (n x 3), and the standard deviations of these (n)."""
    late_s = (now_ns - message.stamp_ns) / NS_PER_S
    places = np.array([item.position_m for item in message.objects], dtype=np.float64)
    speeds = np.array([item.velocity_mps for item in message.objects], dtype=np.float64)
    sigmas = [SIGMA_M if item.position_sigma_m is None else item.position_sigma_m for item in message.objects]
    return message.objects, places + late_s * speeds, np.array(sigmas, dtype=np.float64)


class Tracked:
    """The newest objects of every tracker, moved from their stamp to any other time."""

    def __init__(self, environment: Environment) -> None:
        """Set the map, along whose lines objects move."""
        self._lines: dict[tuple[str, str], tuple[Vec3, ...]] = {
            **{("strip", strip.id): strip.line_m for strip in environment.strips},
            **{("belt", belt.id): belt.line_m for belt in environment.belts},
        }
        self._newest: dict[str, TrackedObjects] = {}

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Set the objects of `tracker`."""
        self._newest[tracker] = message

    def where(self, object_id: str, stamp_ns: int) -> Vec3:
        """Return the centre of an object at `stamp_ns`, {W}.

        Raises:
            WorkspaceError: If it is not tracked, or has not been for a while.
        """
        known = [
            (message.stamp_ns, tracked)
            for message in self._newest.values()
            for tracked in message.objects
            if tracked.id == object_id
        ]
        if not known:
            raise WorkspaceError(f"no object {object_id!r} is known: use the id of one that is tracked now")
        seen_ns, tracked = min(known, key=lambda pair: abs(stamp_ns - pair[0]))
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
        line = self._lines.get((tracked.surface, tracked.surface_id))
        if line is not None:  # along its bends, at the same offset from the line
            polyline = Polyline(line)
            there = polyline.point_at(tracked.surface_position_m + tracked.surface_speed_mps * late_s)
            shift = vector.subtract(there, polyline.point_at(tracked.surface_position_m))
        else:
            shift = vector.scale(tracked.velocity_mps, late_s)
        return vector.add(tracked.position_m, shift)
