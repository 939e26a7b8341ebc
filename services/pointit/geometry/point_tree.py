"""The paper's hit test: things as points, the ray as points, nearest neighbours (§III-C).

The result is the paper's, of querying a k-d tree for the nearest neighbour of every point of the ray. The
method differs: the points of a ray are evenly spaced, so the nearest to a given point follows by arithmetic,
and one descent of a tree of the room's points suffices. Kept for comparison with the paper; for lines,
`ray_cast` is exact and faster.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.closest import Hit
from pointit.geometry.cloud_tree import CloudTree
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3

Array = NDArray[np.float64]

STEP_M = 0.05
REACH_M = 20.0


class PointTree:
    """Lines, points and clouds as points. Targets are numbered in the order lines, points, clouds."""

    def __init__(
        self,
        lines: Sequence[Polyline],
        points: Sequence[Vec3] = (),
        clouds: Sequence[Array] = (),
        *,
        step_m: float = STEP_M,
        reach_m: float = REACH_M,
    ) -> None:
        """Put points on every line at most `step_m` apart, including both ends.

        Args:
            lines: targets represented by their points.
            points: targets of one point each.
            clouds: targets, each n x 3.
            step_m: spacing of the points of lines and ray.
            reach_m: distance of the ray's last point.

        Raises:
            ValueError: If there are no targets.
        """
        if not lines and not points and not clouds:
            raise ValueError("a point tree needs at least one line, point or cloud")
        positions = [_spread(line.length_m, step_m) for line in lines]
        places = [line.points_at(at) for line, at in zip(lines, positions, strict=True)]
        counts = [len(at) for at in positions] + [1] * len(points) + [len(cloud) for cloud in clouds]
        if points:
            places.append(np.array(points, dtype=np.float64))
        places += clouds
        self._positions: Array = np.concatenate([np.zeros(0), *positions])
        self._targets = np.repeat(np.arange(len(counts)), counts)
        self._tree = CloudTree(np.concatenate(places), measure="samples", step_m=step_m, length_m=reach_m)

    def cast(
        self, origin_m: Vec3, direction: Vec3, tolerance_m: float = math.inf, reach_m: float = math.inf
    ) -> Hit | None:
        """Return the point nearest to any point of the ray, or None beyond `tolerance_m` from those.

        Points further along the ray than `reach_m` are ignored. The misses of the hit are to the ray
        itself, not to its points.
        """
        hit = self._tree.cast(origin_m, direction, tolerance_m, reach_m)
        if hit is None:
            return None
        index = hit.target
        position_m = float(self._positions[index]) if index < len(self._positions) else 0.0
        return hit._replace(target=int(self._targets[index]), position_m=position_m)


def _spread(length_m: float, step_m: float) -> Array:
    """Return positions from 0 to `length_m`, ends included, at most `step_m` apart."""
    return np.linspace(0.0, length_m, max(1, math.ceil(length_m / step_m)) + 1)
