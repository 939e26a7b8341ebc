"""Angles of lamps near a ray, for lamps that answer by colour (paper, scenario 1)."""

from collections.abc import Sequence

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import Lamp, LampMiss


class NearbyLamps:
    """Lamps within an angle of the ray."""

    def __init__(self, lamps: Sequence[Lamp], within_rad: float) -> None:
        """Set the lamps, and the maximum angle."""
        self._lamps = [(lamp.id, lamp.position_m) for lamp in lamps]
        self._within_rad = within_rad

    def near(self, origin_m: Vec3, direction: Vec3) -> tuple[LampMiss, ...]:
        """Return the lamps near the ray, the nearest first."""
        misses = [
            (vector.angle_between(direction, vector.subtract(place, origin_m)), name)
            for name, place in self._lamps
        ]
        return tuple(
            LampMiss(id=name, miss_rad=miss) for miss, name in sorted(misses) if miss <= self._within_rad
        )
