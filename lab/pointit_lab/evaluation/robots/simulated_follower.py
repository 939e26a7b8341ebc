"""Simulated people who point at a robot that stands, flies or drives (pointing.md §7)."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Course = Callable[[Array], Array]
"""Positions (n x 3, {W}, m) of a robot at times (n, s)."""

RATE_HZ = 50.0

REACH_S = 0.7
"""Time of the reach to the robot."""

HANGING_RAD = -1.2
"""Elevation of an arm that rests."""

CORRELATION_S = 0.4
"""Correlation time of the error of an arm that follows."""


@dataclass(frozen=True, kw_only=True)
class SimulatedFollower:
    """One person's place and errors."""

    x_m: float
    y_m: float
    yaw_rad: float
    """Azimuth of {H} in {W}."""
    eyes_m: float
    aim_rad: float
    """Constant error of this pointing, to the left."""
    bias_rad: float
    """The same, upwards."""
    lag_s: float
    """Time by which the arm is behind the robot."""
    wander_rad: float
    """Standard deviation, per axis, of the error that changes."""
    elevation_slope: float = 0.0
    """Elevation of the rays above the robot's, per angle of the robot over the horizon."""
    azimuth_slope: float = 0.0
    """The same sideways, per angle from the middle of the course."""

    @classmethod
    def drawn(cls, rng: np.random.Generator, *, reach_m: float = 1.0) -> "SimulatedFollower":
        """Return a person within `reach_m` of the origin (per axis), who faces anywhere."""
        x_m, y_m = rng.uniform(-reach_m, reach_m, 2)
        return cls(
            x_m=float(x_m),
            y_m=float(y_m),
            yaw_rad=float(rng.uniform(-math.pi, math.pi)),
            eyes_m=1.64,
            aim_rad=math.radians(float(rng.normal(0.0, 5.0))),
            bias_rad=math.radians(float(rng.normal(-2.8, 2.8))),
            lag_s=float(rng.uniform(0.1, 0.25)),
            wander_rad=math.radians(float(rng.uniform(1.0, 3.0))),
        )

    def directions(self, course: Course, times_s: Array, rng: np.random.Generator) -> Array:
        """Return the rays (n x 3, unit, {H}) at the robot of `course` at `times_s`, which rise evenly.

        The first `REACH_S` are the reach from a resting arm. Rays start at (0, 0, `eyes_m`).
        """
        away = course(times_s - self.lag_s) - (self.x_m, self.y_m, self.eyes_m)
        azimuths = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
        azimuths += self.azimuth_slope * (azimuths - azimuths.mean()) + self.aim_rad
        elevations = np.arctan2(away[:, 2], np.hypot(away[:, 0], away[:, 1]))
        elevations += self.elevation_slope * elevations + self.bias_rad
        share = np.clip((times_s - times_s[0]) / REACH_S, 0.0, 1.0)
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # minimum jerk
        azimuths += (1.0 - share) * rng.uniform(-math.pi, math.pi)
        elevations = HANGING_RAD + share * (elevations - HANGING_RAD)
        wander = self._wander(times_s, rng)
        azimuths += wander[:, 0] / np.cos(elevations) - self.yaw_rad
        elevations += wander[:, 1]
        flat = np.cos(elevations)
        return np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(elevations)], axis=1)

    def _wander(self, times_s: Array, rng: np.random.Generator) -> Array:
        """Return errors (n x 2, rad) of an arm that follows: a first-order autoregression."""
        white = rng.standard_normal((len(times_s), 2))
        correlation = math.exp(-float(times_s[1] - times_s[0]) / CORRELATION_S) if len(times_s) > 1 else 0.0
        out = np.empty_like(white)
        out[0] = white[0]
        for row in range(1, len(white)):
            out[row] = correlation * out[row - 1] + math.sqrt(1.0 - correlation * correlation) * white[row]
        return np.asarray(self.wander_rad * out, dtype=np.float64)
