"""Where objects are seen from somebody's eyes: as angles to their ray, at the time of their ray."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Environment, TrackedObject, TrackedObjects
from pointit.services.selector.view import View

Array = NDArray[np.float64]

NEAREST_M2 = 1e-6
"""Squared distance from the eyes below which nothing is."""

OPAQUE = frozenset({"box", "cylinder", "sphere"})
"""Solids that hide what is behind them; planes are floors and table tops, on which things stand."""


@dataclass(frozen=True, slots=True)
class _Place:
    """A line's place in the table of all lines."""

    start: float
    length_m: float
    line: Polyline


class _Lines:
    """All strips and belts one behind the other, so that one look-up moves all objects along theirs."""

    def __init__(self, lines: Mapping[tuple[str, str], Polyline]) -> None:
        self.places: dict[tuple[str, str], _Place] = {}
        arcs: list[Array] = []
        vertices: list[Array] = []
        tangents: list[Array] = []
        start = 0.0
        for key, line in lines.items():
            self.places[key] = _Place(start, line.length_m, line)
            arcs.append(start + line.starts_m)
            vertices.append(line.vertices_m)
            tangents.append(np.vstack([line.tangents, line.tangents[-1:]]))  # beyond the end: straight on
            start += line.length_m + 1.0
        self._arcs: Array = np.concatenate(arcs) if arcs else np.zeros(1)
        self._vertices: Array = np.concatenate(vertices) if arcs else np.zeros((1, 3))
        self._tangents: Array = np.concatenate(tangents) if arcs else np.zeros((1, 3))

    def at(self, starts: Array, lengths_m: Array, positions_m: Array) -> tuple[Array, Array]:
        """Return points and tangents at `positions_m` (n) of lines given by `starts` and `lengths_m`."""
        within = np.minimum(np.maximum(positions_m, 0.0), lengths_m)
        index = self._arcs.searchsorted(starts + within, side="right") - 1
        tangents = self._tangents[index]
        beyond = starts + positions_m - self._arcs[index]
        return self._vertices[index] + beyond[:, None] * tangents, tangents


class Scene:
    """Knows the map's lines and every tracker's objects, and sees them from any eyes at any time."""

    def __init__(self, *, stale_after_s: float = 1.0, display_lag_s: float = 0.0) -> None:
        """Begin with an empty room.

        Args:
            stale_after_s: objects whose list is farther from a ray in time are not seen.
            display_lag_s: at t people see an object where it was that much earlier.
        """
        self._stale_s = stale_after_s
        self._lag_ns = round(display_lag_s * NS_PER_S)
        self._lines = _Lines({})
        self._listings: dict[str, TrackedObjects] = {}
        self._set([], [])

    def on_map(self, environment: Environment) -> None:
        """Take the lines of the map; one without length is none."""
        lines: dict[tuple[str, str], Polyline] = {}
        for surface, those in (("strip", environment.strips), ("belt", environment.belts)):
            for item in those:
                try:
                    lines[surface, item.id] = Polyline(item.line_m)
                except ValueError:
                    continue  # whoever publishes the map complains about it; its objects move straight on
        self._lines = _Lines(lines)
        self._relist()

    def update(self, tracker: str, message: TrackedObjects) -> None:
        """Take the list of `tracker` in place of its last one."""
        self._listings[tracker] = message
        self._relist()

    def forget(self, tracker: str) -> None:
        """Forget what `tracker` listed."""
        if self._listings.pop(tracker, None) is not None:
            self._relist()

    def look(self, cursor: Cursor) -> View | None:
        """Return how the objects lie about the ray of `cursor`; none when it has none or nothing is there."""
        if cursor.origin_m is None or cursor.direction is None or not self.ids:
            return None
        since_base_s = (cursor.stamp_ns - self._base_ns) / NS_PER_S
        elapsed_s = since_base_s - self._lag_ns / NS_PER_S - self._stamps_s
        count = self._on_lines
        self._seen_m = self._along_m + self._speeds_mps * elapsed_s[:count]
        positions_m, tangents = self._lines.at(self._starts, self._lengths_m, self._seen_m)
        centers_m = self._offsets_m + self._velocities_mps * elapsed_s[:, None]
        centers_m[:count] += positions_m
        self._tangents[:count] = tangents
        reach_m = centers_m - cursor.origin_m
        along_m = reach_m @ cursor.direction
        square_m2 = np.maximum((reach_m * reach_m).sum(1), NEAREST_M2)
        angles = np.arctan2(np.sqrt(np.maximum(square_m2 - along_m * along_m, 0.0)), along_m)
        foreshortened_m = (self._tangents * reach_m).sum(1)
        across_m = np.sqrt(np.maximum(square_m2 - foreshortened_m * foreshortened_m, 0.0))
        halves = np.arctan(self._halves_m * across_m / square_m2)
        if self._is_mixed or abs(since_base_s) > self._stale_s:
            angles[np.abs(since_base_s - self._stamps_s) > self._stale_s] = math.inf
        if cursor.solid in OPAQUE:
            angles[np.sqrt(square_m2) - self._halves_m > cursor.range_m] = math.inf
        return View(
            self,
            cursor.direction,
            centers_m=centers_m,
            angles_rad=angles,
            halves_rad=halves,
            squares_m2=square_m2,
        )

    def velocity(self, index: int) -> Vec3:
        """Return the velocity of object `index` when it was last looked at, {W}."""
        if index < self._on_lines:
            x, y, z = (self._tangents[index] * self._speeds_mps[index]).tolist()
        else:
            x, y, z = self._velocities_mps[index].tolist()
        return (x, y, z)

    def extent(self, index: int) -> tuple[Vec3, float]:
        """Return the unit direction and half the length of object `index` when it was last looked at."""
        x, y, z = self._tangents[index].tolist()
        return (x, y, z), float(self._halves_m[index])

    def place(self, index: int) -> tuple[str, str, float] | None:
        """Return surface, its id and the arc length on it of an object that is on a line, as last seen."""
        if index >= self._on_lines:
            return None
        return *self._lines_of[index], float(self._seen_m[index])

    def point_at(self, index: int, position_m: float) -> Vec3:
        """Return the point at an arc length of the line that object `index` is on."""
        return self._lines.places[self._lines_of[index]].line.point_at(position_m)

    def _relist(self) -> None:
        on_lines: list[tuple[TrackedObject, int]] = []
        free: list[tuple[TrackedObject, int]] = []
        places = self._lines.places
        for message in self._listings.values():
            for tracked in message.objects:
                is_on_line = (tracked.surface, tracked.surface_id) in places
                (on_lines if is_on_line else free).append((tracked, message.stamp_ns))
        self._set(on_lines, free)

    def _set(
        self, on_lines: Sequence[tuple[TrackedObject, int]], free: Sequence[tuple[TrackedObject, int]]
    ) -> None:
        everything = [*on_lines, *free]
        self.ids = [tracked.id for tracked, _ in everything]
        """Of the objects, in the order of all arrays."""
        self.index = {object_id: index for index, object_id in enumerate(self.ids)}
        stamps_ns = [stamp_ns for _, stamp_ns in everything]
        self._base_ns = max(stamps_ns, default=0)
        self._is_mixed = min(stamps_ns, default=0) != self._base_ns
        self._stamps_s: Array = np.array([(stamp_ns - self._base_ns) / NS_PER_S for stamp_ns in stamps_ns])
        self._on_lines = len(on_lines)
        self._lines_of = [(tracked.surface, tracked.surface_id) for tracked, _ in on_lines]
        places = [self._lines.places[line] for line in self._lines_of]
        self._starts: Array = np.array([place.start for place in places])
        self._lengths_m: Array = np.array([place.length_m for place in places])
        self._along_m: Array = np.array([tracked.surface_position_m for tracked, _ in on_lines])
        self._seen_m = self._along_m
        self._speeds_mps: Array = np.array([tracked.surface_speed_mps for tracked, _ in on_lines])
        self._halves_m: Array = np.array([tracked.length_m / 2.0 for tracked, _ in everything])
        self._tangents: Array = np.zeros((len(everything), 3))
        self._velocities_mps: Array = np.zeros((len(everything), 3))
        self._offsets_m: Array = np.array([tracked.position_m for tracked, _ in everything]).reshape(-1, 3)
        if on_lines:
            # What is carried along: height above the line, the tracker's noise across it.
            self._offsets_m[: len(on_lines)] -= self._lines.at(self._starts, self._lengths_m, self._along_m)[
                0
            ]
        for row, (tracked, _) in enumerate(free, start=len(on_lines)):
            self._velocities_mps[row] = tracked.velocity_mps
