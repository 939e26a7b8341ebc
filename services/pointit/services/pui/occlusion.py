"""Occlusion by opaque things."""

import math
from collections.abc import Sequence

from pointit.geometry import vector
from pointit.geometry.closest import Hit
from pointit.geometry.solid_cast import SolidCaster
from pointit.geometry.solids import Solid
from pointit.geometry.vector import Vec3

SLACK_M = 0.05
"""Depth in an opaque thing at which mounted things are still visible, the accuracy of maps."""


class Occluders:
    """Opaque things of a room.

    They hide only if the ray itself meets one of them. Then a point further along the ray is hidden if the
    straight line to it from the eyes goes through one: what stands out beside it is visible. A thing that
    contains the eyes, by a coarse map or pose, hides nothing.
    """

    def __init__(self, solids: Sequence[Solid]) -> None:
        """Set the things, possibly none."""
        self._caster = SolidCaster(solids) if solids else None

    def first(self, origin_m: Vec3, direction: Vec3) -> float:
        """Return the distance along the ray to the first one, m, or infinity."""
        return math.inf if self._caster is None else self._caster.first_hit_m(origin_m, direction)

    def reach(self, first_m: float) -> float:
        """Return the distance along the ray up to which points are not hidden, m."""
        return first_m + SLACK_M

    def hides(self, hit: Hit, origin_m: Vec3, direction: Vec3, first_m: float) -> bool:
        """Return True if the point of `hit` is hidden to a ray that meets an opaque thing at `first_m`."""
        reach = vector.subtract(hit.point_m, origin_m)
        if self._caster is None or vector.dot(direction, reach) <= self.reach(first_m):
            return False
        return self._caster.first_hit_m(origin_m, reach) < hit.range_m - SLACK_M
