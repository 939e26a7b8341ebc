"""The nearest point of a cloud to a ray, by a tree.

The cloud is halved repeatedly across its longest side, down to leaves of some tens of points. 64 neighbouring
leaves form a node, 64 of these the next. Each lies in a ball around one of its own points. A ray is tested
against one level at a time, on arrays. The best of the balls' centres is a real point, so all balls wholly
outside that cone are excluded, and only the rest is opened.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array, Indices
from pointit.geometry.polyline import TINY, Hit, make_hit
from pointit.geometry.vector import Vec3

LEAF_POINTS = 64
"""Maximum number of points of a leaf."""
FAN_HALVINGS = 6
"""Binary logarithm of the number of children of a node."""
TOP_HALVINGS = 9
"""Maximum of the same for the topmost node."""
MANY = 8
"""Number of remaining leaves above which the best is opened first, as it may exclude others."""
SLACK_M = 1e-6
"""Margin of the balls' radii, so that rounding never loses a point."""


class _Level(NamedTuple):
    """Children of the nodes above: positions, and the balls around them."""

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
    """Static points, arranged for casting rays at them."""

    def __init__(self, points: Array | Sequence[Vec3]) -> None:
        """Arrange `points`, n x 3, {W}, m.

        Raises:
            ValueError: If there are no points, or one is not finite.
        """
        places = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        if not len(places):
            raise ValueError("a cloud needs at least one point")
        if not np.isfinite(places).all():
            raise ValueError("a cloud's coordinates are finite")
        self._order, halvings = _halved(places)
        self._levels = _levels(places[self._order], halvings)

    def cast(
        self, origin_m: Vec3, direction: Vec3, tolerance: float = math.inf, reach_m: float = math.inf
    ) -> Hit | None:
        """Return the closest point to the ray, with its index as target, or None beyond `tolerance`.

        Args:
            origin_m: origin of the ray.
            direction: direction of the ray, normalized here.
            tolerance: rad.
            reach_m: points further along the ray are ignored.

        Returns:
            The hit, with its misses to the ray itself. The resolution is 2e-8 rad.
        """
        direction = vector.normalized(direction)
        ray = _Ray(np.array(origin_m)[:, None], np.array(direction), reach_m)

        # From the top down: the nodes whose balls come within the best miss so far
        remaining: Indices = np.zeros(1, dtype=np.intp)
        bound = tolerance
        for level in self._levels[:-1]:
            rows, columns, bound = self._search_level(level, remaining, ray, bound)
            if not len(rows):
                return None
            fan = level.radii.shape[1]
            remaining = remaining[rows] * fan + columns

        # The closest point of the leaves that remain
        index, cost = self._best(remaining, ray)
        if index < 0 or cost > tolerance:
            return None
        leaves = self._levels[-1]
        leaf, column = divmod(index, leaves.radii.shape[1])
        x, y, z = leaves.places[leaf, :, column].tolist()
        return make_hit(int(self._order[index]), 0.0, (x, y, z), origin_m, direction)

    def _search_level(
        self, level: _Level, remaining: Indices, ray: _Ray, bound: float
    ) -> tuple[Indices, Indices, float]:
        """Return the children of `remaining` that may hold the closest point, and a bound of its miss."""
        places = level.places.take(remaining, axis=0)
        radii = level.radii.take(remaining, axis=0)
        along, square = _seen(places, ray)
        costs = self._costs(along, square, ray)
        best = int(costs.argmin())
        bound = min(bound, float(costs.ravel()[best]))
        rows, columns = self._open(along, square, radii, ray, bound)

        # Costs of the centres are a loose bound, the points of the best leaf a tight one
        if level is self._levels[-2] and len(rows) > MANY:
            fan = costs.shape[1]
            row, column = divmod(best, fan)
            best_leaf = remaining[[row]] * fan + column
            _, cost = self._best(best_leaf, ray)
            bound = min(bound, cost)
            rows, columns = self._open(along, square, radii, ray, bound)
        return rows, columns, bound

    def _best(self, leaves: Indices, ray: _Ray) -> tuple[int, float]:
        """Return the index (in leaf order) of the closest point of `leaves` and its miss, or -1."""
        points = self._levels[-1].places.take(leaves, axis=0)
        costs = self._costs(*_seen(points, ray), ray)
        leaf_points = costs.shape[1]
        row, column = divmod(int(costs.argmin()), leaf_points)
        cost = float(costs[row, column])
        if math.isinf(cost):
            return -1, cost
        return int(leaves[row]) * leaf_points + column, cost

    def _costs(self, along: Array, square: Array, ray: _Ray) -> Array:
        """Return the misses of points, rad, infinite beyond the reach."""
        cosines = along / np.sqrt(np.maximum(square, TINY))
        costs = np.arccos(np.minimum(np.maximum(cosines, -1.0), 1.0))
        if ray.reach_m < math.inf:
            costs[along > ray.reach_m] = math.inf
        return costs

    def _open(
        self, along: Array, square: Array, radii: Array, ray: _Ray, bound: float
    ) -> tuple[Indices, Indices]:
        """Return the rows and columns of the balls that come within `bound` of the ray."""
        cone = min(bound, math.pi)
        across = np.sqrt(np.maximum(square - along * along, 0.0))
        # the centre's distance to the cone if that is in front, otherwise a smaller value
        to_cone = across * math.cos(cone) - along * math.sin(cone)
        is_near = to_cone <= radii
        if ray.reach_m < math.inf:
            is_near &= along - radii <= ray.reach_m
        rows, columns = is_near.nonzero()
        return rows, columns


class CloudCaster:
    """Clouds, numbered as given, in one tree."""

    def __init__(self, clouds: Sequence[Array]) -> None:
        self._tree = CloudTree(np.concatenate(clouds))
        self._ends = np.cumsum([len(cloud) for cloud in clouds])

    def cast(
        self, origin_m: Vec3, direction: Vec3, tolerance: float = math.inf, reach_m: float = math.inf
    ) -> Hit | None:
        """Return the closest point to the ray with the index of its cloud as target; see `CloudTree.cast`."""
        hit = self._tree.cast(origin_m, direction, tolerance, reach_m)
        if hit is None:
            return None
        return hit._replace(target=int(np.searchsorted(self._ends, hit.target, side="right")))


def _seen(places: Array, ray: _Ray) -> tuple[Array, Array]:
    """Return the distances of `places` (k x 3 x f) along the ray, and squared from its origin."""
    reaches = places - ray.origin
    return ray.direction @ reaches, np.einsum("ijk,ijk->ik", reaches, reaches)


def _halved(points: Array) -> tuple[Indices, int]:
    """Return the indices of the points by leaf, all of one size, and the number of halvings."""
    count = len(points)
    halvings = max(0, math.ceil(math.log2(count / LEAF_POINTS)))
    size = math.ceil(count / 2**halvings)
    order: Indices = np.arange(size * 2**halvings, dtype=np.intp)
    order[count:] = count - 1  # the last point is repeated
    for halving in range(halvings):
        nodes = order.reshape(2**halving, -1)
        places = points[nodes]
        longest_axis = np.ptp(places, axis=1).argmax(axis=1)
        coordinates = np.take_along_axis(places, longest_axis[:, None, None], axis=2)[:, :, 0]
        halves = np.argpartition(coordinates, nodes.shape[1] // 2, axis=1)
        order = np.take_along_axis(nodes, halves, axis=1).ravel()
    return order, halvings


def _levels(points: Array, halvings: int) -> list[_Level]:
    """Return the levels from the topmost down to the points, which are in leaf order."""
    leaves = points.reshape(2**halvings, -1, 3)
    leaf_places = np.ascontiguousarray(leaves.transpose(0, 2, 1))
    levels = [_Level(leaf_places, np.zeros(leaves.shape[:2]))]
    while True:
        # Balls of the nodes, each around its own point that is nearest to the middle of its box
        nodes = points.reshape(2**halvings, -1, 3)
        middles = (nodes.min(axis=1) + nodes.max(axis=1)) / 2.0
        from_middles = np.linalg.norm(nodes - middles[:, None], axis=2)
        central = from_middles.argmin(axis=1)
        centres = nodes[np.arange(len(nodes)), central]
        from_centres = np.linalg.norm(nodes - centres[:, None], axis=2)
        radii = from_centres.max(axis=1) + SLACK_M

        # They are the children of the level above
        is_top = halvings <= TOP_HALVINGS
        halvings = 0 if is_top else halvings - FAN_HALVINGS
        grouped_centres = centres.reshape(2**halvings, -1, 3)
        places = np.ascontiguousarray(grouped_centres.transpose(0, 2, 1))
        levels.append(_Level(places, radii.reshape(2**halvings, -1)))
        if is_top:
            return levels[::-1]
