"""The paper's cursor as described (§III-C): points in a k-d tree, the ray as points, the nearest one.

Baseline of ours. Objects of the room and the ray, to 20 m, are points 5 cm apart. The tree is queried for
the neighbour of every point of the ray, and the nearest of all counts if it is within 0.7 m.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import Environment

Array = NDArray[np.float64]

STEP_M = 0.05
REACH_M = 20.0
TOLERANCE_M = 0.7


class PaperCursor:
    """A k-d tree of points."""

    def __init__(self, points: Array, *, bounded: bool = False) -> None:
        """Build the tree; `bounded` also passes it the tolerance, which the paper does not mention."""
        self._points = points
        self._tree = cKDTree(points)
        self._steps = np.arange(0.0, REACH_M + STEP_M / 2, STEP_M)[:, None]
        self._bound_m = TOLERANCE_M if bounded else np.inf

    def meet(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
        """Return the cursor."""
        on_ray = np.array(origin_m) + self._steps * np.array(direction)
        distances, found = self._tree.query(on_ray, distance_upper_bound=self._bound_m)
        best = int(np.argmin(distances))
        if not np.asarray(distances)[best] <= TOLERANCE_M:
            return None
        x, y, z = self._points[int(np.asarray(found)[best])].tolist()
        return (x, y, z)


def discretized(room: Environment) -> Array:
    """Return the lamps, strips and belts of a map as points."""
    points: list[Sequence[Vec3] | Array] = [[lamp.position_m for lamp in room.lamps]] if room.lamps else []
    for line in [strip.line_m for strip in room.strips] + [belt.line_m for belt in room.belts]:
        path = Polyline(line)
        points.append(path.points_at(np.arange(0.0, path.length_m, STEP_M)))
    return np.concatenate([np.asarray(some, dtype=np.float64) for some in points])


def walls(count: int, size_m: Vec3 = (10.0, 8.0, 3.0)) -> Array:
    """Return about `count` points on floor, ceiling and walls of a room, with 5 mm of scanner noise."""
    random = np.random.default_rng(0)
    sides: list[Array] = []
    size = np.array(size_m)
    areas = [size[(axis + 1) % 3] * size[(axis + 2) % 3] for axis in range(3)]
    for axis in range(3):
        for end in (0.0, size_m[axis]):
            side = random.uniform(0.0, 1.0, (round(count * areas[axis] / sum(areas) / 2.0), 3)) * size
            side[:, axis] = end
            sides.append(side)
    points = np.concatenate(sides)
    return np.asarray(points + random.normal(0.0, 0.005, points.shape))
