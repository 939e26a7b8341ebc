"""A simulated device on a simulated arm: a slow sweep, white noise, drifting yaw."""

import math

import numpy as np

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.runtime.clock import Clock, ticks
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.arm_frame import from_roll_pitch_yaw
from pointit.services.imu_bridge.config import SimulatedConfig
from pointit.services.imu_bridge.reading import Deliver, Reading


class SimulatedDevice:
    """Readings of a sensor on a sweeping arm, reproducible by the seed."""

    def __init__(self, config: SimulatedConfig, sensor_from_arm: Quaternion = rotation.IDENTITY) -> None:
        """Mount the sensor as `sensor_from_arm`, with the configured error."""
        self._config = config
        roll, pitch, yaw = map(math.radians, config.mounting_error_deg)
        worn = rotation.multiply(sensor_from_arm, from_roll_pitch_yaw(roll, pitch, yaw))
        self._arm_from_sensor = rotation.inverse(worn)
        self._noise_rad = math.radians(config.noise_deg)
        self._random = np.random.default_rng(config.seed)

    def arm(self, time_s: float) -> Quaternion:
        """Return the true orientation of the arm, world_from_arm, `time_s` after the start."""
        config = self._config
        azimuth_deg = config.azimuth_amplitude_deg * math.sin(math.tau * time_s / config.azimuth_period_s)
        elevation_deg = config.elevation_deg + config.elevation_amplitude_deg * math.sin(
            math.tau * time_s / config.elevation_period_s
        )
        return rotation.from_azimuth_elevation(math.radians(azimuth_deg), math.radians(elevation_deg))

    def read(self, time_s: float) -> Quaternion:
        """Return the reading, world_from_sensor, with drift and noise."""
        drift = rotation.from_yaw(math.radians(self._config.yaw_drift_degps) * time_s)
        sensor = rotation.multiply(rotation.multiply(drift, self.arm(time_s)), self._arm_from_sensor)
        if self._noise_rad:
            x, y, z = (float(value) for value in self._random.normal(0.0, self._noise_rad / 2.0, 3))
            sensor = rotation.multiply(sensor, (x, y, z, 1.0))
        return rotation.normalized(sensor)


class SimulatedSource:
    """Reads a simulated device at its rate."""

    def __init__(self, config: SimulatedConfig, sensor_from_arm: Quaternion, clock: Clock) -> None:
        self._device = SimulatedDevice(config, sensor_from_arm)
        self._rate_hz = config.rate_hz
        self._clock = clock

    async def run(self, deliver: Deliver) -> None:
        """Deliver a reading each tick until cancelled."""
        start_ns = self._clock.now_ns()
        async for now_ns in ticks(self._clock, self._rate_hz):
            deliver(Reading(now_ns, self._device.read((now_ns - start_ns) / NS_PER_S)))
