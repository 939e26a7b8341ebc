"""The paper's way to meet the room: points in a k-d tree, the ray as points, nearest neighbours (§III-C).

Kept for comparison with the paper and for point clouds; for lines, `ray_cast` is exact and faster.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.closest import Hit, hit_at
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3

Array = NDArray[np.float64]

STEP_M = 0.05
REACH_M = 20.0

STRIDE = 16
"""Every so many points of the ray are asked first; the others only where they could be nearer."""
ROUNDING_M = 1e-9
"""Added to bounds, which the tree takes as exclusive."""


class PointTree:
    """Lines and points as points in a tree; targets are numbered lines first, then points, as given."""

    def __init__(
        self,
        lines: Sequence[Polyline],
        points: Sequence[Vec3] = (),
        *,
        step_m: float = STEP_M,
        reach_m: float = REACH_M,
    ) -> None:
        """Put a point on every line at least every `step_m`, on both ends too.

        Raises:
            ValueError: there is nothing to cast at.
        """
        # Loaded only here: scipy costs a third of a second and 20 MB that exact casting does without.
        from scipy.spatial import cKDTree  # noqa: PLC0415

        if not lines and not points:
            raise ValueError("a point tree needs at least one line or point")
        positions = [_spread(line.length_m, step_m) for line in lines]
        places = [line.points_at(at) for line, at in zip(lines, positions, strict=True)]
        if points:
            positions.append(np.zeros(len(points)))
            places.append(np.array(points, dtype=np.float64))
        counts = [len(at) for at in positions[: len(lines)]] + [1] * len(points)
        self._positions: Array = np.concatenate(positions)
        self._targets = np.repeat(np.arange(len(counts)), counts)
        self._points: Array = np.concatenate(places)
        """n x 3."""
        self._tree = cKDTree(self._points)
        self._steps: Array = _spread(reach_m, step_m)
        self._coarse = np.union1d(np.arange(0, len(self._steps), STRIDE), [len(self._steps) - 1])
        self._stride_m = STRIDE * float(self._steps[1])

    def cast(self, origin_m: Vec3, direction: Vec3, tolerance_m: float = math.inf) -> Hit | None:
        """Return the point nearest to any point of the ray, or none beyond `tolerance_m` from the ray.

        The result is the one of asking for every point of the ray: one that lies between two asked ones
        is at most half a stride from one of them, so it cannot be nearer than that one's answer less this.
        The misses of the hit are to the ray itself, not to its points.
        """
        direction = vector.normalized(direction)
        steps = self._steps[:, None] * np.array(direction) + np.array(origin_m)
        first, _ = self._ask(steps[self._coarse], tolerance_m + self._stride_m / 2.0 + ROUNDING_M)
        bound_m = min(float(first.min()), tolerance_m) + ROUNDING_M
        kept = self._coarse[first <= bound_m + self._stride_m / 2.0]
        around = (kept[:, None] + np.arange(-(STRIDE // 2), STRIDE // 2 + 1)).ravel()
        asked = np.unique(np.minimum(np.maximum(around, 0), len(self._steps) - 1))
        distances, found = self._ask(steps[asked], bound_m)
        if not (distances <= tolerance_m).any():
            return None
        best = int(distances.argmin())
        index = int(found[best])
        x, y, z = self._points[index].tolist()
        target, position = int(self._targets[index]), float(self._positions[index])
        return hit_at(target, position, (x, y, z), origin_m, direction)

    def _ask(self, places: Array, bound_m: float) -> tuple[Array, NDArray[np.intp]]:
        """Return the distance and index of each place's nearest neighbour nearer than `bound_m`, or inf."""
        distances, found = self._tree.query(places, distance_upper_bound=bound_m)
        return np.asarray(distances), np.asarray(found)


def _spread(length_m: float, step_m: float) -> Array:
    """Return positions from 0 to `length_m`, ends included, at most `step_m` apart."""
    return np.linspace(0.0, length_m, max(1, math.ceil(length_m / step_m)) + 1)
