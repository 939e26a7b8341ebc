"""Motion of a hovering quadrotor about its set-point, by draught and control noise."""

import math

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.services.robot.drivers.sim.motion_limits import STEP_S

WANDER_SD_M: Vec3 = (0.015, 0.015, 0.008)
"""Standard deviation per axis, m: that of a small quadrotor under motion capture."""
WANDER_S = 1.0
"""Correlation time, s."""
WANDER_LIMIT = 2.5
"""Limit per axis, in standard deviations."""


class HoverWander:
    """A first-order Gauss-Markov process per axis, clamped."""

    def __init__(self, rng: np.random.Generator) -> None:
        """Start at zero."""
        self._rng = rng
        self._keep = math.exp(-STEP_S / WANDER_S)
        self._kick = math.sqrt(1.0 - self._keep**2)
        self._at: Vec3 = (0.0, 0.0, 0.0)

    def step(self) -> Vec3:
        """Advance by `STEP_S`. Return the offset from the set-point, m."""
        x, y, z = self._rng.standard_normal(3).tolist()
        keep, kick = self._keep, self._kick
        old_x, old_y, old_z = self._at
        self._at = (keep * old_x + kick * x, keep * old_y + kick * y, keep * old_z + kick * z)
        offset_x, offset_y, offset_z = (
            sd_m * min(max(value, -WANDER_LIMIT), WANDER_LIMIT)
            for sd_m, value in zip(WANDER_SD_M, self._at, strict=True)
        )
        return (offset_x, offset_y, offset_z)
