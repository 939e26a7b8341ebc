"""First intersection of a ray with many solids, or their closest point."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.closest import Hit, Measure, make_hit
from pointit.geometry.solids import MAX_EYES, Solid
from pointit.geometry.vector import Vec3

Array = NDArray[np.float64]

FEW = 6
"""Number of solids up to which plain Python on each ball is faster than arrays."""
SLACK_RAD = 1e-6
"""Margin of bounds by balls, rad (m by metres)."""
ROUNDING = 1e-14
"""Margin of cosines."""
SAME = 1e-9
"""Difference below which misses are equal. The nearer solid wins then."""


class SolidCaster:
    """Static solids. Targets are numbered as given."""

    def __init__(self, solids: Sequence[Solid], *, measure: Measure = "angle") -> None:
        """Create from the solids, and the quantity to minimize.

        Raises:
            ValueError: If there are no solids.
        """
        if not solids:
            raise ValueError("a solid caster needs at least one solid")
        self.measure: Measure = measure
        self._solids = list(solids)
        self._centres = np.array([solid.bounding_sphere[0] for solid in solids]).T.copy()
        """3 x n."""
        self._radii = np.array([solid.bounding_sphere[1] for solid in solids])
        self._cones = lru_cache(MAX_EYES)(self._cones_from)

    def cast(
        self, origin_m: Vec3, direction: Vec3, tolerance: float = math.inf, reach_m: float = math.inf
    ) -> Hit | None:
        """Return the first intersection of the ray, or else the closest point within `tolerance`.

        Args:
            origin_m: origin of the ray.
            direction: direction of the ray, normalized here.
            tolerance: rad, or m.
            reach_m: points further along the ray are ignored.
        """
        direction = vector.normalized(direction)
        near = sorted(self._near(origin_m, direction, tolerance))
        met = [
            (ahead, i)
            for bound, i in near
            if bound <= SLACK_RAD and (ahead := self._solids[i].intersect(origin_m, direction)) is not None
        ]
        first, index = min(met, default=(math.inf, -1))
        if index >= 0 and first <= reach_m:  # all misses are larger
            return self._hit(index, first, origin_m, direction)
        behind = {i for _, i in met}
        passed = [each for each in near if each[1] not in behind]
        return self._closest(passed, origin_m, direction, tolerance, reach_m)

    def first_hit_m(self, origin_m: Vec3, direction: Vec3) -> float:
        """Return the distance along the ray to the first intersection, or infinity.

        Solids that contain the ray's origin are ignored.
        """
        direction = vector.normalized(direction)
        ahead = math.inf
        for _, i in self._near(origin_m, direction, 0.0):
            solid = self._solids[i]
            met = solid.intersect(origin_m, direction)
            if met is not None and met < ahead and not solid.contains(origin_m):
                ahead = met
        return ahead

    def _hit(self, index: int, ahead: float, origin_m: Vec3, direction: Vec3) -> Hit:
        point = vector.add(origin_m, vector.scale(direction, ahead))
        return Hit(index, 0.0, point, 0.0, 0.0, ahead, self._solids[index].uv_at(point))

    def _closest(
        self, near: list[tuple[float, int]], origin_m: Vec3, direction: Vec3, tolerance: float, reach_m: float
    ) -> Hit | None:
        best: Hit | None = None
        min_angle = tolerance
        for bound, i in near:
            if bound > min_angle + SLACK_RAD:
                break
            point = self._solids[i].closest_approach(origin_m, direction, self.measure)
            if point is None or vector.dot(direction, vector.subtract(point, origin_m)) > reach_m:
                continue
            hit = make_hit(i, 0.0, point, origin_m, direction)
            miss = hit.miss_rad if self.measure == "angle" else hit.miss_m
            if miss <= min_angle and (best is None or miss < min_angle - SAME or hit.range_m < best.range_m):
                best, min_angle = hit, miss
        return None if best is None else best._replace(uv_m=self._solids[best.target].uv_at(best.point_m))

    def _near(self, origin_m: Vec3, direction: Vec3, tolerance: float) -> list[tuple[float, int]]:
        """Return least miss and number of each solid whose ball comes within `tolerance` of the ray."""
        if len(self._solids) <= FEW:
            bounds = [(self._bound(i, origin_m, direction), i) for i in range(len(self._solids))]
            return [each for each in bounds if each[0] <= tolerance + SLACK_RAD]
        if self.measure == "angle":
            sights, balls, min_angle = self._cones(origin_m, tolerance)
            cosines = np.array(direction) @ sights
            near = (cosines >= min_angle).nonzero()[0]
            misses = np.arccos(np.minimum(cosines[near], 1.0)) - balls[near]
        else:
            c = self._centres - np.array(origin_m)[:, None]
            ahead = np.maximum(np.array(direction) @ c, 0.0)
            square = np.einsum("ij,ij->j", c, c)
            misses = np.sqrt(np.maximum(square - ahead * ahead, 0.0)) - self._radii
            near = (misses <= tolerance + SLACK_RAD).nonzero()[0]
            misses = misses[near]
        return list(zip(misses.tolist(), near.tolist(), strict=True))

    def _cones_from(self, origin_m: Vec3, tolerance: float) -> tuple[Array, Array, Array]:
        """Return unit vectors to the centres (3 x n), angles of the balls, and least cosines of rays near."""
        c = self._centres - np.array(origin_m)[:, None]
        distances = np.maximum(np.sqrt(np.einsum("ij,ij->j", c, c)), 1e-12)
        balls = np.where(
            distances <= self._radii, np.inf, np.arcsin(np.minimum(self._radii / distances, 1.0))
        )
        min_angle = np.cos(np.minimum(balls + (tolerance + SLACK_RAD), math.pi)) - ROUNDING
        return c / distances, balls, min_angle

    def _bound(self, index: int, origin_m: Vec3, direction: Vec3) -> float:
        """Return the miss of the solid's ball, negative if the ray meets it or begins inside."""
        centre, radius = self._solids[index].bounding_sphere
        reach = vector.subtract(centre, origin_m)
        distance = vector.norm(reach)
        if distance <= radius:
            return -math.inf
        if self.measure == "angle":
            return vector.angle_between(direction, reach) - math.asin(radius / distance)
        ahead = max(vector.dot(direction, reach), 0.0)
        return math.sqrt(max(distance * distance - ahead * ahead, 0.0)) - radius
