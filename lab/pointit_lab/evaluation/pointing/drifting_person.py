"""People with a drifting IMU who point at a known lamp once a minute and rest before it (pointing.md §7)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.filter import Fix

Array = NDArray[np.float64]

STEP_S = 1.0
"""Time step of the simulated drift."""


@dataclass(frozen=True, kw_only=True)
class DriftPersonModel:
    """Parameters of people and IMUs; angles in rad."""

    rate_sigma_radps: float = math.radians(0.25)
    rate_walk_radps: float = math.radians(0.002)
    """Standard deviation of the rate's random walk after one second."""
    turned_rad: float = 0.0
    """Angle by which the IMU is turned on the arm, at `turned_at_s`."""
    turned_at_s: float = 90.0
    azimuth_sigma_rad: float = math.radians(2.0)
    """Standard deviation of the azimuth error of one hold."""
    elevation_sigma_rad: float = math.radians(1.0)
    bent_arm_share: float = 0.05
    """Share of pointings with an additional error of `bent_arm_rad`."""
    bent_arm_rad: tuple[float, float] = (math.radians(5.0), math.radians(10.0))
    hold_yaw_sigma_rad: float = math.radians(0.25)
    hold_pitch_sigma_rad: float = math.radians(0.16)
    correlation_s: float = 0.3
    noise_rad: float = math.radians(0.03)
    eye_m: float = 1.64
    place_sigma_m: float = 0.15
    """Standard deviation of the localized position at the start."""
    start_sigma_rad: float = math.radians(2.0)
    rest_s: float = 8.0
    """Time for which the arm hangs before each anchor."""
    rest_hz: float = 25.0


class DriftingPerson:
    """One person with one IMU; deterministic for a seed."""

    def __init__(self, seed: int, ways: DriftPersonModel, length_s: float) -> None:
        """Draw the person's pose and the IMU's drift for `length_s`."""
        self._rng = np.random.default_rng(seed)
        self._ways = ways
        rng = self._rng
        steps = math.ceil(length_s / STEP_S) + 1
        walk = rng.normal(0.0, ways.rate_walk_radps * math.sqrt(STEP_S), steps)
        rates = rng.normal(0.0, ways.rate_sigma_radps) + np.cumsum(walk)
        self._times = np.arange(steps + 1) * STEP_S
        self._drifts = np.append(0.0, np.cumsum(rates) * STEP_S)
        self._yaw_rad = float(rng.uniform(-math.pi, math.pi))
        self.x_m, self.y_m = (float(v) for v in rng.uniform(-2.0, 2.0, 2))

    def yaw_rad(self, at_s: float) -> float:
        """Return the true yaw of {H} in {W}."""
        turned_rad = self._ways.turned_rad if at_s > self._ways.turned_at_s else 0.0
        return self._yaw_rad - float(np.interp(at_s, self._times, self._drifts)) + turned_rad

    def fix(self) -> Fix:
        """Return the localization at 0 s."""
        ways = self._ways
        sigmas = np.array([ways.place_sigma_m, ways.place_sigma_m, ways.start_sigma_rad])
        x, y, yaw = np.array([self.x_m, self.y_m, self.yaw_rad(0.0)]) + sigmas * self._rng.standard_normal(3)
        return Fix(x_m=x, y_m=y, yaw_rad=yaw, covariance=np.diag(sigmas**2), stamp_ns=0)

    def pointing(self, at_s: float, beside_rad: float = 0.0) -> tuple[Vec3, Vec3]:
        """Return a lamp ({W}) around the person, and the ray ({H}) that points at it.

        Args:
            at_s: time of the pointing.
            beside_rad: additional error to the left.
        """
        ways, rng = self._ways, self._rng
        around, away, high = rng.uniform(-math.pi, math.pi), rng.uniform(1.5, 4.0), rng.uniform(0.0, 1.2)
        target = (self.x_m + away * math.cos(around), self.y_m + away * math.sin(around), high)
        azimuth = around + rng.normal(0.0, ways.azimuth_sigma_rad) + beside_rad
        if rng.random() < ways.bent_arm_share:
            azimuth += rng.uniform(*ways.bent_arm_rad) * (1.0 if rng.random() < 0.5 else -1.0)
        elevation = math.atan2(high - ways.eye_m, away) + rng.normal(0.0, ways.elevation_sigma_rad)
        return target, vector.direction(azimuth - self.yaw_rad(at_s), elevation)

    def rest(self, from_s: float) -> list[tuple[rotation.Quaternion, int]]:
        """Return the IMU's samples from `from_s` on, while the arm hangs down: orientation and time in ns."""
        ways = self._ways
        times = from_s + np.arange(round(ways.rest_s * ways.rest_hz)) / ways.rest_hz
        yaw = self._wander(len(times), ways.hold_yaw_sigma_rad)
        pitch = self._wander(len(times), ways.hold_pitch_sigma_rad)
        noise = self._rng.normal(0.0, ways.noise_rad, (2, len(times)))
        facing = float(self._rng.uniform(-math.pi, math.pi)) - self._yaw_rad
        drifts = np.interp(times, self._times, self._drifts)
        return [
            (
                rotation.from_azimuth_elevation(float(facing + drift + y), float(p) - 1.4),
                round(float(t) * NS_PER_S),
            )
            for t, drift, y, p in zip(times, drifts, yaw + noise[0], pitch + noise[1], strict=True)
        ]

    def _wander(self, count: int, sigma_rad: float) -> Array:
        """Return a random walk with the correlation of people who hold still (Ornstein and Uhlenbeck)."""
        stays = math.exp(-1.0 / (self._ways.rest_hz * self._ways.correlation_s))
        kicks = self._rng.normal(0.0, sigma_rad * math.sqrt(1.0 - stays**2), count)
        kicks[0] = self._rng.normal(0.0, sigma_rad)
        out = np.empty(count)
        value = 0.0
        for i in range(count):
            value = stays * value + float(kicks[i])
            out[i] = value
        return out
