"""Distances of pieces of a network to points and to each other, in closed form."""

import numpy as np

from pointit.services.conveyor_sim.network.network import Array, NetworkEdge

TINY = 1e-12


class Path:
    """The vertices of a piece, as arrays."""

    def __init__(self, piece: NetworkEdge) -> None:
        line = piece.line
        end_m = piece.start_m + piece.length_m
        between = (line.starts_m > piece.start_m) & (line.starts_m < end_m)
        along_m = np.r_[piece.start_m, line.starts_m[between], end_m]
        self.offsets_m: Array = along_m - piece.start_m
        """k, increasing."""
        self.points: Array = line.points_at(along_m)
        """k x 3."""
        self.steps: Array = np.diff(self.points, axis=0)
        """(k - 1) x 3."""
        self.squares: Array = np.maximum(np.einsum("ij,ij->i", self.steps, self.steps), TINY)
        """k - 1: squared lengths of the steps."""

    def distance_m(self, point: Array) -> float:
        """Return the distance to `point`."""
        reach = point - self.points[:-1]
        share = np.clip(np.einsum("ij,ij->i", reach, self.steps) / self.squares, 0.0, 1.0)
        return float(np.linalg.norm(reach - share[:, None] * self.steps, axis=1).min())

    def within(self, centre: Array, radius_m: float) -> tuple[float, float] | None:
        """Return the offsets between which it lies within `radius_m` of `centre`, or None."""
        reach = self.points[:-1] - centre
        along = np.einsum("ij,ij->i", reach, self.steps)
        over = np.einsum("ij,ij->i", reach, reach) - radius_m**2
        under_root = along**2 - self.squares * over
        meets = under_root > 0.0
        root = np.sqrt(np.where(meets, under_root, 0.0))
        begin = np.clip((-along - root) / self.squares, 0.0, 1.0)
        end = np.clip((-along + root) / self.squares, 0.0, 1.0)
        inside = np.flatnonzero(meets & (end > begin))
        if not len(inside):
            return None
        first, last = inside[0], inside[-1]
        lengths_m = np.diff(self.offsets_m)
        return (
            float(self.offsets_m[first] + begin[first] * lengths_m[first]),
            float(self.offsets_m[last] + end[last] * lengths_m[last]),
        )

    def crossing(self, other: "Path") -> tuple[float, Array]:
        """Return the distance of this path, which has one step, to `other`, and its own nearest point.

        Closest points of two segments: clamp the closest of one line to its segment, then the other's to it.
        """
        start, step, square = self.points[0], self.steps[0], self.squares[0]
        reach = start - other.points[:-1]
        c = reach @ step
        f = np.einsum("ij,ij->i", reach, other.steps)
        b = other.steps @ step
        denominator = np.maximum(square * other.squares - b**2, TINY)
        s = np.clip((b * f - c * other.squares) / denominator, 0.0, 1.0)
        t = np.clip((b * s + f) / other.squares, 0.0, 1.0)
        s = np.clip((b * t - c) / square, 0.0, 1.0)
        mine = start + s[:, None] * step
        apart_m = np.linalg.norm(mine - other.points[:-1] - t[:, None] * other.steps, axis=1)
        nearest = int(np.argmin(apart_m))
        return float(apart_m[nearest]), mine[nearest]
