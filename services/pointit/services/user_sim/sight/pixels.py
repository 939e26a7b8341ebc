"""Positions of the strips' pixels, and the points of strips and belts that they show."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.schemas import Belt, Environment, Strip
from pointit.schemas.environment import BESIDE_BELT_M

Array = NDArray[np.float64]
Kind = Literal["strip", "belt"]
Key = tuple[Kind, str]
T = TypeVar("T", Strip, Belt)

MAX_PIXELS = 64 * 4096
"""Limit of the pixels of all strips, that of a frame."""
MAX_PAIRS = 20_000_000
"""Limit of pixels times segments of belts that are compared, beyond that of any hall."""


@dataclass(frozen=True, slots=True)
class ShownLine:
    """A strip or a belt, and the pixels that show it, by arc length."""

    kind: Kind
    id: str
    line: Polyline
    pitch_m: float
    """Distance from one pixel to the next on the strip, or strips."""
    arcs_m: list[float] = field(default_factory=list[float])
    """Arc lengths, increasing."""
    at: list[int] = field(default_factory=list[int])
    """Index of each in the frame."""


Place = tuple[ShownLine, float]
"""A line and an arc length on it."""


class SeenPixels:
    """All pixels of a room, numbered in the order of a frame (strips in the map's order)."""

    def __init__(self, room: Environment) -> None:
        """Arrange the strips of `room`. Strips that cannot be drawn, or exceed the limit, are not visible."""
        self.strips: list[tuple[str, int]] = []
        """Ids and numbers of pixels, in the map's order."""
        self.lines: dict[Key, ShownLine] = {}
        self.count = 0
        places: list[Array] = []
        pitches: list[Array] = []
        for strip, line in drawable(room.strips):
            if self.count + strip.pixels > MAX_PIXELS:
                break
            places.append(self._add(strip, line))
            pitches.append(np.full(strip.pixels, line.length_m / strip.pixels))
        points = np.concatenate(places) if places else np.empty((0, 3))
        self._pitches_m: Array = np.concatenate(pitches) if pitches else np.empty(0)
        budget = MAX_PAIRS
        for belt, line in drawable(room.belts):
            budget -= len(points) * len(line.tangents)
            if budget >= 0 and len(points):
                self._lay_beside(belt, line, points)
        self._by_strip = _by_pixel(self.count, [line for line in self.lines.values() if line.kind == "strip"])
        by_belt = _by_pixel(self.count, [line for line in self.lines.values() if line.kind == "belt"])
        self._by_belt = [belts or strips for belts, strips in zip(by_belt, self._by_strip, strict=True)]

    def places(self, pixel: int, kind: Kind) -> Sequence[Place]:
        """Return the places that `pixel` shows, on belts or on strips only."""
        return (self._by_belt if kind == "belt" else self._by_strip)[pixel]

    def _add(self, strip: Strip, line: Polyline) -> Array:
        offset, self.count = self.count, self.count + strip.pixels
        self.strips.append((strip.id, strip.pixels))
        pitch_m = line.length_m / strip.pixels
        arcs = (np.arange(strip.pixels, dtype=np.float64) + 0.5) * pitch_m
        wire = range(strip.pixels) if strip.direction == 1 else range(strip.pixels - 1, -1, -1)
        self.lines["strip", strip.id] = ShownLine(
            "strip", strip.id, line, pitch_m, arcs.tolist(), [offset + index for index in wire]
        )
        points = line.points_at(arcs)
        return points if strip.direction == 1 else points[::-1]

    def _lay_beside(self, belt: Belt, line: Polyline, points: Array) -> None:
        """Find the pixels beside a belt, each with the nearest arc length of its centre line."""
        reach_m = belt.width_m / 2.0 + BESIDE_BELT_M
        low, high = line.vertices_m.min(axis=0) - reach_m, line.vertices_m.max(axis=0) + reach_m
        near = np.flatnonzero(np.all((points >= low) & (points <= high), axis=1))
        arcs, gaps = line.nearest_to(points[near])
        there = np.flatnonzero((gaps <= reach_m) & ~line.is_beyond_ends(points[near], arcs))
        order = there[np.argsort(arcs[there], kind="stable")]
        if not len(order):
            return
        at = [int(pixel) for pixel in near[order]]
        pitch_m = float(self._pitches_m[at].max())
        self.lines["belt", belt.id] = ShownLine("belt", belt.id, line, pitch_m, arcs[order].tolist(), at)


def drawable(things: Sequence[T]) -> Iterator[tuple[T, Polyline]]:
    """Yield `things` with their lines, except those without length, such as a single point."""
    for thing in things:
        with contextlib.suppress(ValueError):
            yield thing, Polyline(thing.line_m)


def _by_pixel(count: int, lines: Sequence[ShownLine]) -> list[list[Place]]:
    places: list[list[Place]] = [[] for _ in range(count)]
    for line in lines:
        for arc_m, pixel in zip(line.arcs_m, line.at, strict=True):
            places[pixel].append((line, arc_m))
    return places
