"""What opaque things hide."""

import math
from collections.abc import Sequence

from pointit.geometry import vector
from pointit.geometry.closest import Hit
from pointit.geometry.solid_cast import SolidCaster
from pointit.geometry.solids import Solid
from pointit.geometry.vector import Vec3

SLACK_M = 0.05
"""What is mounted on an opaque thing may be as deep in it, as maps are drawn, and is seen."""


class Occluders:
    """The opaque things of a room.

    They hide only when the ray itself meets one of them. Then a place further along the ray is hidden if
    the straight way to it from the eyes goes through one: what stands out beside it is seen. A thing that
    the eyes are in, by a coarse map or pose, hides nothing.
    """

    def __init__(self, solids: Sequence[Solid]) -> None:
        """Take the things; there may be none."""
        self._caster = SolidCaster(solids) if solids else None

    def first(self, origin_m: Vec3, direction: Vec3) -> float:
        """Return how far the ray goes before it meets one, m, or infinity."""
        return math.inf if self._caster is None else self._caster.first_hit_m(origin_m, direction)

    def reach(self, first_m: float) -> float:
        """Return how far along the ray a place may be and not be hidden."""
        return first_m + SLACK_M

    def hides(self, hit: Hit, origin_m: Vec3, direction: Vec3, first_m: float) -> bool:
        """Return whether the place of `hit` is hidden to a ray that meets an opaque thing at `first_m`."""
        reach = vector.subtract(hit.point_m, origin_m)
        if self._caster is None or vector.dot(direction, reach) <= self.reach(first_m):
            return False
        return self._caster.first_hit_m(origin_m, reach) < hit.range_m - SLACK_M
