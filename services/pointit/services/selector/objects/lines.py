"""All strips and belts of a map in one table, so that one look-up moves all objects along their lines."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class LineTable:
    """Concatenated polylines, each addressed by its number and arc length.

    Lines are extended straight beyond their ends.
    """

    def __init__(self, lines: Mapping[tuple[str, str], Polyline]) -> None:
        """Create a table of `lines`, by surface and id."""
        self._lines = dict(lines)
        self._numbers = {key: number for number, key in enumerate(lines)}
        starts: list[float] = []
        arcs: list[Array] = [np.zeros(0)]
        vertices: list[Array] = [np.zeros((0, 3))]
        tangents: list[Array] = [np.zeros((0, 3))]
        start = 0.0
        for line in lines.values():
            starts.append(start)
            arcs.append(start + line.starts_m)
            vertices.append(line.vertices_m)
            tangents.append(np.vstack([line.tangents, line.tangents[-1:]]))
            start += line.length_m + 1.0
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
        return self._vertices[segments] + beyond_m[:, None] * tangents, tangents

    def around(self, which: Indices, positions_m: Array) -> tuple[Array, Array, Array, Array]:
        """Return points, tangents, and the straight distances before and after, m (infinite at ends)."""
        points_m, tangents = self.at(which, positions_m)
        segments, beyond_m = self._segments(which, positions_m)
        arcs = self._arcs
        ends = self._starts[which] + self._lengths_m[which]
        is_first = arcs[segments] <= self._starts[which] + 1e-9
        following = arcs[np.minimum(segments + 1, len(arcs) - 1)]
        is_last = following >= ends - 1e-9
        before_m = np.where(is_first, math.inf, beyond_m)
        after_m = np.where(is_last, math.inf, following - arcs[segments] - beyond_m)
        return points_m, tangents, before_m, after_m

    def _segments(self, which: Indices, positions_m: Array) -> tuple[Indices, Array]:
        """Return the table's row of each position, and the distance of the position behind that vertex, m."""
        starts = self._starts[which]
        within_m = np.minimum(np.maximum(positions_m, 0.0), self._lengths_m[which])
        segments = self._arcs.searchsorted(starts + within_m, side="right") - 1
        return segments, starts + positions_m - self._arcs[segments]
