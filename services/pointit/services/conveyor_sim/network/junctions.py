"""Junctions: where ways join, part, cross or turn sharply, which packages of different ways pass in turn."""

import math
from collections.abc import Sequence

import numpy as np

from pointit.geometry.polyline import Polyline
from pointit.services.conveyor_sim.network.piece import Array, Piece

APART = math.cos(math.radians(10.0))
"""Cosine of the angle above which ways that leave one place diverge there."""
CROSSING_M = 0.05
"""Lines that pass each other closer than this cross."""
SAMPLE_M = 1e-3
"""Distance between the points of a bridge at which crossings are looked for."""
SHARP = math.cos(math.radians(30.0))
"""Cosine of the turn above which packages that follow each other would come closer than along their way."""
MAX_WIDENING = 3.0
"""Largest factor by which junctions of ways at a narrow angle are extended."""
BENT = 1.05
"""Additional factor, since the angle may change along the way."""
PAST_M = 1e-3

Extent = dict[int, tuple[float, float]]
"""Start and end by section; below 0 and beyond the section's length where it continues there."""


class Junctions:
    """Finds the junctions of sections that are not cut yet."""

    def __init__(self, sections: Sequence[Piece]) -> None:
        self._sections = sections
        self._lines = [Polyline([s.point(0.0), *map(tuple, _between(s)), s.point(s.to_m)]) for s in sections]

    def extents(self, longest_m: float) -> list[Extent]:
        """Return disjoint extents such that waiting packages up to `longest_m` do not touch passing ones."""
        found = self._common_starts()
        for centre in self._centres():
            extent = self._within(centre, longest_m)
            narrowness = self._narrowness(centre, extent)
            if narrowness > 1.0:
                extent = self._within(centre, min(MAX_WIDENING, BENT * narrowness) * longest_m)
            found.append(extent)
        return _merged(found)

    def _common_starts(self) -> list[Extent]:
        """Return the common first parts of sections that begin at one place in one direction."""
        found: list[Extent] = []
        for section in self._sections:
            ways = [self._sections[index] for index in section.successors]
            for i, a in enumerate(ways):
                for b in ways[:i]:
                    if float(a.direction(0.0) @ b.direction(0.0)) > APART:
                        end_m = min(a.to_m, b.to_m)
                        found.append({way.index: (-1.0, end_m + (end_m == way.to_m)) for way in (a, b)})
        return found

    def _centres(self) -> list[Array]:
        centres: list[Array] = []
        for section in self._sections:
            ahead = [self._sections[index].direction(0.0) for index in section.successors]
            along = section.direction(section.to_m)
            parts = any(float(a @ b) < APART for a in ahead for b in ahead)
            turns = any(float(along @ a) < SHARP for a in ahead)
            is_merge = any(len(self._sections[index].predecessors) > 1 for index in section.successors)
            if parts or turns or is_merge:
                centres.append(self._lines[section.index].vertices_m[-1])
        for section in self._sections:
            if section.target:
                centres += self._crossings(section)
        distinct: list[Array] = []
        for centre in centres:
            if all(float(np.linalg.norm(centre - other)) > CROSSING_M for other in distinct):
                distinct.append(centre)
        return distinct

    def _crossings(self, bridge: Piece) -> list[Array]:
        near = {bridge.index, *bridge.successors, *bridge.predecessors}
        near |= {index for before in bridge.predecessors for index in self._sections[before].successors}
        near |= {index for after in bridge.successors for index in self._sections[after].predecessors}
        line = self._lines[bridge.index]
        points = line.points_at(np.linspace(0.0, line.length_m, math.ceil(line.length_m / SAMPLE_M) + 1))
        found: list[Array] = []
        for section in self._sections:
            if section.index not in near:
                _, apart_m = self._lines[section.index].nearest_to(points)
                nearest = int(np.argmin(apart_m))
                if apart_m[nearest] < CROSSING_M:
                    found.append(points[nearest])
        return found

    def _within(self, centre: Array, radius_m: float) -> Extent:
        """Return the parts of sections within `radius_m` of `centre`, along connected sections."""
        extent: Extent = {}
        waiting = [
            index
            for index, line in enumerate(self._lines)
            if line.nearest_to(centre[None, :])[1][0] < CROSSING_M
        ]
        while waiting:
            index = waiting.pop()
            inside = None if index in extent else _span_within(self._lines[index], centre, radius_m)
            if inside is None:
                continue
            start_m, end_m = inside
            section = self._sections[index]
            if start_m <= PAST_M:
                start_m = -1.0
                waiting += section.predecessors
            if end_m >= section.to_m - PAST_M:
                end_m = section.to_m + 1.0
                waiting += section.successors
            extent[index] = (start_m, end_m)
        return extent

    def _narrowness(self, centre: Array, extent: Extent) -> float:
        """Return 1 over the sine of the smallest angle between ways from `centre`; 1 from 90° on."""
        edges: list[Array] = []
        for index, span_m in extent.items():
            section = self._sections[index]
            for edge_m in span_m:
                if 0.0 <= edge_m <= section.to_m:
                    edge = np.asarray(section.point(edge_m)) - centre
                    if all(float(np.linalg.norm(edge - other)) > CROSSING_M for other in edges):
                        edges.append(edge)  # else it is the same way, of two links
        rays = [edge / max(float(np.linalg.norm(edge)), PAST_M) for edge in edges]
        nearest = max((float(a @ b) for i, a in enumerate(rays) for b in rays[:i]), default=0.0)
        return 1.0 if nearest <= 0.0 else 1.0 / math.sqrt(max(1.0 - nearest**2, 1e-6))


def _between(section: Piece) -> Array:
    starts_m = section.line.starts_m - section.start_m
    return section.line.vertices_m[(starts_m > 0.0) & (starts_m < section.to_m)]


def _span_within(line: Polyline, centre: Array, radius_m: float) -> tuple[float, float] | None:
    """Return the first and the last arc length of `line` within `radius_m` of `centre`, or None."""
    reach = centre - line.vertices_m[:-1]
    foot_m = np.einsum("ij,ij->i", reach, line.tangents)
    squared = radius_m**2 - np.einsum("ij,ij->i", reach, reach) + foot_m**2
    half_m = np.sqrt(np.maximum(squared, 0.0))
    begin_m = line.starts_m[:-1] + np.clip(foot_m - half_m, 0.0, np.diff(line.starts_m))
    end_m = line.starts_m[:-1] + np.clip(foot_m + half_m, 0.0, np.diff(line.starts_m))
    inside = np.flatnonzero((squared > 0.0) & (end_m > begin_m))
    return (float(begin_m[inside[0]]), float(end_m[inside[-1]])) if len(inside) else None


def _merged(found: list[Extent]) -> list[Extent]:
    """Return disjoint extents: those that overlap on a section are merged."""
    merged: list[Extent] = []
    for extent in found:
        new = dict(extent)
        while True:
            touching = next((other for other in merged if _touch(other, new)), None)
            if touching is None:
                break
            merged.remove(touching)
            for section, (start_m, end_m) in touching.items():
                before = new.get(section, (start_m, end_m))
                new[section] = (min(start_m, before[0]), max(end_m, before[1]))
        merged.append(new)
    return merged


def _touch(a: Extent, b: Extent) -> bool:
    return any(
        a[section][0] < b[section][1] + PAST_M and b[section][0] < a[section][1] + PAST_M
        for section in a.keys() & b.keys()
    )
