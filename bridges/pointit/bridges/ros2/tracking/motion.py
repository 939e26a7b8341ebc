"""Velocities of objects whose messages tell positions only; pure."""

import math
from collections.abc import Container
from typing import NamedTuple

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import FARTHEST, NS_PER_S

SMOOTHING_S = 0.2
"""Time constant of the velocity."""
LONGEST_S = 0.5
"""Positions further apart tell no velocity."""
STILL: Vec3 = (0.0, 0.0, 0.0)


class _Last(NamedTuple):
    stamp_ns: int
    position_m: Vec3
    velocity_mps: Vec3


class Motion:
    """Smoothed differences of the positions of each object."""

    def __init__(self) -> None:
        self._last: dict[str, _Last] = {}

    def velocity_mps(self, name: str, position_m: Vec3, stamp_ns: int) -> Vec3:
        """Return the velocity of an object that is at `position_m` now; 0 if it was not seen just before."""
        last = self._last.get(name)
        passed_s = 0.0 if last is None else (stamp_ns - last.stamp_ns) / NS_PER_S
        velocity_mps = STILL
        if last is not None and 0.0 < passed_s <= LONGEST_S:
            newest_mps = vector.scale(vector.subtract(position_m, last.position_m), 1.0 / passed_s)
            share = 1.0 - math.exp(-passed_s / SMOOTHING_S)
            difference = vector.subtract(newest_mps, last.velocity_mps)
            velocity_mps = vector.add(last.velocity_mps, vector.scale(difference, share))
            if not all(abs(each) <= FARTHEST for each in velocity_mps):
                velocity_mps = STILL  # it was carried, or another took its name
        self._last[name] = _Last(stamp_ns, position_m, velocity_mps)
        return velocity_mps

    def keep(self, names: Container[str]) -> None:
        """Forget all other objects."""
        self._last = {name: last for name, last in self._last.items() if name in names}
