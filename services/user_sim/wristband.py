"""The IMU on a simulated person's wrist, with typical errors."""

import math

import numpy as np

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, ImuSample
from pointit.services.user_sim.config import WristbandConfig

BOOT_SPAN_S = 3600.0
"""Maximum time since the band was switched on, at the start, s."""


class Wristband:
    """Measures the arm's orientation in {H} with typical errors."""

    def __init__(self, yaw_rad: float, config: WristbandConfig, rng: np.random.Generator) -> None:
        """Switch on. `yaw_rad` is the azimuth in {W} at which this IMU reads yaw 0."""
        self._config = config
        self._rng = rng
        self._yaw_rad = yaw_rad
        drawn_radps = math.radians(config.yaw_rate_bias_sd_degps) * float(rng.standard_normal())
        given = config.yaw_drift_degpmin
        self._rate_radps = drawn_radps if given is None else math.radians(given) / 60.0
        self._boot_s = float(rng.uniform(0.0, BOOT_SPAN_S))
        self._at_ns: int | None = None
        self._running_s = 0.0
        self._clock_rate = 1.0 + config.clock_skew_ppm * 1e-6
        self._silent = False
        self._seq = 0
        self.drift_rad = 0.0
        """Drift of the yaw since the start, rad."""

    def sample(self, now_ns: int, world_from_arm: Quaternion) -> ImuSample | None:
        """Return the sample at `now_ns`, or None if the radio loses it."""
        passed_s = 0.0 if self._at_ns is None else (now_ns - self._at_ns) / NS_PER_S
        self._at_ns = now_ns
        self._running_s += passed_s * self._clock_rate
        self._drift(passed_s)
        half_rad = 0.5 * math.radians(self._config.noise_sd_deg)
        x, y, z = self._rng.standard_normal(3).tolist()
        self._seq += 1  # lost samples count, so that subscribers see the gap
        if self._is_silent(passed_s):
            return None
        noise = (half_rad * x, half_rad * y, half_rad * z, 1.0)
        measured = rotation.multiply(
            rotation.from_yaw(self.drift_rad - self._yaw_rad),
            rotation.multiply(world_from_arm, noise),
        )
        device_time_s = self._boot_s + self._running_s
        return ImuSample(
            stamp_ns=now_ns,
            seq=self._seq,
            orientation_xyzw=rotation.normalized(measured),
            device_time_ns=round(device_time_s * NS_PER_S),
        )

    def _drift(self, passed_s: float) -> None:
        walk_radps = math.radians(self._config.yaw_rate_walk_sd_degps)
        self._rate_radps += walk_radps * math.sqrt(passed_s) * float(self._rng.standard_normal())
        self.drift_rad += self._rate_radps * passed_s

    def _is_silent(self, passed_s: float) -> bool:
        """Return True if the radio is silent: two states with exponential durations (Gilbert)."""
        share = self._config.dropout_share
        if share <= 0.0:
            return False
        burst_s = self._config.dropout_burst_s
        stay_s = burst_s if self._silent else burst_s * (1.0 - share) / share
        if self._rng.random() < 1.0 - math.exp(-passed_s / stay_s):
            self._silent = not self._silent
        return self._silent
