"""Position of the feet, since people do not stand on one spot for minutes."""

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.body.arm import minimum_jerk_to_rest

STEP_S = 1.0
"""Duration of a shift of the weight, or of a small step, s."""


class StandingPosition:
    """Random steps to spots around a position."""

    def __init__(self, place_m: Vec3, sd_m: float, every_s: float, rng: np.random.Generator) -> None:
        """Start at `place_m`; spots lie `sd_m` (1 sigma in x and y) around it, `every_s` apart on average."""
        self._place_m = place_m
        self._sd_m = sd_m
        self._every_s = every_s
        self._rng = rng
        self._from: tuple[float, float] = (0.0, 0.0)
        self._spot: tuple[float, float] = (0.0, 0.0)
        self._began_ns = 0
        self._next_ns: int | None = None

    def at(self, now_ns: int) -> Vec3:
        """Return the position at `now_ns`, {W}."""
        if self._sd_m == 0.0:
            return self._place_m
        if self._next_ns is None:
            self._next_ns = self._after(now_ns)
        elif now_ns >= self._next_ns:
            x, y = self._sd_m * self._rng.standard_normal(2)
            self._from, self._spot = self._spot, (float(x), float(y))
            self._began_ns = now_ns
            self._next_ns = self._after(now_ns)
        elapsed_s = max(0, now_ns - self._began_ns) / NS_PER_S
        left = minimum_jerk_to_rest((1.0, 0.0, 0.0), STEP_S, elapsed_s)[0]
        x, y = (spot + left * (old - spot) for old, spot in zip(self._from, self._spot, strict=True))
        return vector.add(self._place_m, (x, y, 0.0))

    def _after(self, now_ns: int) -> int:
        return now_ns + round((STEP_S + float(self._rng.exponential(self._every_s))) * NS_PER_S)
