"""The point of a cloud that a ray passes closest, exactly, in a million points within a fraction of a ms.

The cloud is halved again and again across its longest side, down to leaves of some tens of points; sixty-four
neighbouring leaves make a node, sixty-four of these the next. Each lies in a ball around one of its own
points. A ray looks at one level at a time, on arrays: the best of the balls' centres is a point that is
really there, so whatever lies wholly outside that cone (or tube) is out, and only what is left is opened.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.closest import TINY, Hit, make_hit
from pointit.geometry.vector import Vec3

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

CloudMeasure = Literal["angle", "metres", "samples"]
"""What is made smallest: the angle at the ray's origin, the distance to the ray, or the paper's distance to
the nearest of points set along the ray at equal steps (§III-C)."""

LEAF_POINTS = 64
"""A leaf has at most this many points."""
FAN_HALVINGS = 6
"""A node has two to the power of this children."""
TOP_HALVINGS = 9
"""The topmost node may have two to the power of this."""
MANY = 8
"""When more leaves than this are left, the most promising is opened first: it may rule others out."""
SLACK_M = 1e-6
"""Balls are this much larger than they need be, so that rounding never loses a point."""


class _Level(NamedTuple):
    """Children of the nodes above: where they are, and the balls around them."""

    places: Array
    """nodes x 3 x fan."""
    radii: Array
    """nodes x fan; 0 for points."""


class _Ray(NamedTuple):
    origin: Array
    """3 x 1."""
    direction: Array
    reach_m: float


class CloudTree:
    """Points that do not move, laid out for casting rays at them."""

    def __init__(
        self,
        points: Array | Sequence[Vec3],
        *,
        measure: CloudMeasure = "angle",
        step_m: float = 0.05,
        length_m: float = 20.0,
    ) -> None:
        """Lay out `points`, n x 3.

        Args:
            points: {W}, m.
            measure: what is to be smallest.
            step_m: of `samples`: spacing of the ray's points.
            length_m: of `samples`: where the last of them is; a point there too when it is no multiple.

        Raises:
            ValueError: there are no points, or one is not finite.
        """
        places = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        if not len(places):
            raise ValueError("a cloud needs at least one point")
        if not np.isfinite(places).all():
            raise ValueError("a cloud's coordinates are finite")
        self.measure: CloudMeasure = measure
        self._samples = max(1, math.ceil(length_m / step_m))
        self._step_m = length_m / self._samples
        self._length_m = length_m
        self._order, halvings = _halved(places)
        self._levels = _levels(places[self._order], halvings)

    def cast(
        self, origin_m: Vec3, direction: Vec3, tolerance: float = math.inf, reach_m: float = math.inf
    ) -> Hit | None:
        """Return the point that the ray passes closest, its index as target, or none beyond `tolerance`.

        Args:
            origin_m: of the ray.
            direction: of the ray; normed here.
            tolerance: rad for `angle`, m otherwise.
            reach_m: points further along the ray are left out.

        Returns:
            The hit, with its misses to the ray itself. Choosing resolves 2e-8 rad, or 1e-7 m.
        """
        direction = vector.normalized(direction)
        ray = _Ray(np.array(origin_m)[:, None], np.array(direction), reach_m)
        kept: Indices = np.zeros(1, dtype=np.intp)
        bound = tolerance
        for level in self._levels[:-1]:
            rows, columns, bound = self._look(level, kept, ray, bound)
            if not len(rows):
                return None
            kept = kept[rows] * level.radii.shape[1] + columns
        index, cost = self._best(kept, ray)
        if index < 0 or cost > tolerance:
            return None
        leaf, column = divmod(index, self._levels[-1].radii.shape[1])
        x, y, z = self._levels[-1].places[leaf, :, column].tolist()
        return make_hit(int(self._order[index]), 0.0, (x, y, z), origin_m, direction)

    def _look(self, level: _Level, kept: Indices, ray: _Ray, bound: float) -> tuple[Indices, Indices, float]:
        """Return which children of `kept` may hold the closest point, and what it misses by at most."""
        places, radii = level.places.take(kept, axis=0), level.radii.take(kept, axis=0)
        along, square = _seen(places, ray)
        costs = self._costs(along, square, ray)
        best = int(costs.argmin())
        bound = min(bound, float(costs.ravel()[best]))
        rows, columns = self._open(along, square, radii, ray, bound)
        if level is self._levels[-2] and len(rows) > MANY:
            # costs of the centres alone bound loosely: the points of the best leaf do it tightly
            row, column = divmod(best, costs.shape[1])
            _, cost = self._best(kept[[row]] * costs.shape[1] + column, ray)
            bound = min(bound, cost)
            rows, columns = self._open(along, square, radii, ray, bound)
        return rows, columns, bound

    def _best(self, leaves: Indices, ray: _Ray) -> tuple[int, float]:
        """Return the index in the order of leaves of their closest point and what it misses by, or -1."""
        points = self._levels[-1].places.take(leaves, axis=0)
        costs = self._costs(*_seen(points, ray), ray)
        best = int(costs.argmin())
        row, column = divmod(best, costs.shape[1])
        cost = float(costs[row, column])
        return (-1 if math.isinf(cost) else int(leaves[row]) * costs.shape[1] + column), cost

    def _costs(self, along: Array, square: Array, ray: _Ray) -> Array:
        """Return what places miss by, rad or m; infinite beyond the reach."""
        if self.measure == "angle":
            cosines = along / np.sqrt(np.maximum(square, TINY))
            costs = np.arccos(np.minimum(np.maximum(cosines, -1.0), 1.0))
        else:
            ahead = np.maximum(along, 0.0)
            if self.measure == "samples":
                ahead = np.minimum(np.rint(ahead / self._step_m), self._samples) * self._step_m
            costs = np.sqrt(np.maximum(square - ahead * (2.0 * along - ahead), 0.0))
        if ray.reach_m < math.inf:
            costs[along > ray.reach_m] = math.inf
        return costs

    def _open(
        self, along: Array, square: Array, radii: Array, ray: _Ray, bound: float
    ) -> tuple[Indices, Indices]:
        """Return the rows and columns of the balls that come within `bound` of the ray."""
        if self.measure == "angle":
            cone = min(bound, math.pi)
            across = np.sqrt(np.maximum(square - along * along, 0.0))
            # the centre's distance to the cone, where that is in front; smaller, never larger, elsewhere
            near = across * math.cos(cone) - along * math.sin(cone) <= radii
        else:
            end_m = self._length_m if self.measure == "samples" else math.inf
            ahead = np.minimum(np.maximum(along, 0.0), end_m)
            across = np.sqrt(np.maximum(square - ahead * (2.0 * along - ahead), 0.0))
            near = across - radii <= bound
        if ray.reach_m < math.inf:
            near &= along - radii <= ray.reach_m
        rows, columns = near.nonzero()
        return rows, columns


def _seen(places: Array, ray: _Ray) -> tuple[Array, Array]:
    """Return how far along the ray `places` (k x 3 x f) are, and their squared distance from its origin."""
    reaches = places - ray.origin
    return ray.direction @ reaches, np.einsum("ijk,ijk->ik", reaches, reaches)


def _halved(points: Array) -> tuple[Indices, int]:
    """Return indices of the points leaf by leaf, all of one size, and how often they were halved."""
    count = len(points)
    halvings = max(0, math.ceil(math.log2(count / LEAF_POINTS)))
    size = math.ceil(count / 2**halvings)
    order: Indices = np.arange(size * 2**halvings, dtype=np.intp)
    order[count:] = count - 1  # the last repeated: it is itself again
    for halving in range(halvings):
        nodes = order.reshape(2**halving, -1)
        places = points[nodes]
        longest = np.ptp(places, axis=1).argmax(axis=1)
        keys = np.take_along_axis(places, longest[:, None, None], axis=2)[:, :, 0]
        parts = np.argpartition(keys, nodes.shape[1] // 2, axis=1)
        order = np.take_along_axis(nodes, parts, axis=1).ravel()
    return order, halvings


def _levels(points: Array, halvings: int) -> list[_Level]:
    """Return the levels from the topmost down to the points, which lie leaf by leaf."""
    leaves = points.reshape(2**halvings, -1, 3)
    levels = [_Level(np.ascontiguousarray(leaves.transpose(0, 2, 1)), np.zeros(leaves.shape[:2]))]
    while True:
        nodes = points.reshape(2**halvings, -1, 3)
        middles = (nodes.min(axis=1) + nodes.max(axis=1)) / 2.0
        own = np.linalg.norm(nodes - middles[:, None], axis=2).argmin(axis=1)
        centres = nodes[np.arange(len(nodes)), own]
        radii = np.linalg.norm(nodes - centres[:, None], axis=2).max(axis=1) + SLACK_M
        is_top = halvings <= TOP_HALVINGS
        halvings = 0 if is_top else halvings - FAN_HALVINGS
        places = np.ascontiguousarray(centres.reshape(2**halvings, -1, 3).transpose(0, 2, 1))
        levels.append(_Level(places, radii.reshape(2**halvings, -1)))
        if is_top:
            return levels[::-1]
