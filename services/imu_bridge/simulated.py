"""A simulated device on a simulated arm: a slow sweep, white noise, drifting yaw."""

import math

import numpy as np
from pydantic import Field

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion, from_roll_pitch_yaw
from pointit.runtime.clock import Clock, ticks
from pointit.runtime.config.config import Config
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.sources import Deliver, ImuSource, Reading


class SimulatedConfig(Config):
    """An arm that sweeps slowly from side to side, up and down."""

    rate_hz: float = Field(default=50.0, gt=0, le=1000, description="samples per second")
    azimuth_amplitude_deg: float = Field(default=40.0, ge=0, le=180, description="sweep to either side, °")
    azimuth_period_s: float = Field(default=8.0, gt=0, description="period of the sweep from side to side, s")
    elevation_deg: float = Field(default=-10.0, ge=-90, le=90, description="mean elevation of the arm, °")
    elevation_amplitude_deg: float = Field(default=10.0, ge=0, le=90, description="sweep up and down, °")
    elevation_period_s: float = Field(default=5.0, gt=0, description="period of the sweep up and down, s")
    noise_deg: float = Field(
        default=0.0, ge=0, le=45, description="white noise about each axis, standard deviation, °"
    )
    yaw_drift_degps: float = Field(default=0.0, ge=-90, le=90, description="drift of the yaw, °/s")
    mounting_error_deg: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0),
        description="error of the mounting, as if worn carelessly: roll, "
        "pitch, yaw of the arm in the configured arm frame, °",
    )
    seed: int = Field(default=0, ge=0, description="seed of the noise")


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


SIMULATED = ImuSource(
    summary="a simulated sensor on an arm that sweeps to and fro, to test the path of a device",
    config=SimulatedConfig,
    make=lambda config, around: SimulatedSource(config, around.sensor_from_arm, around.clock),
)
