"""A simulated device on a simulated arm: a slow sweep.

No core: it waits for the times of its samples.
"""

import math

from pydantic import Field

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.runtime.clock import Clock, ticks
from pointit.runtime.config.config import Config
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.sources import Deliver, ImuSource, Reading

AZIMUTH_PERIOD_S = 8.0
"""Period of the sweep from side to side, s."""
ELEVATION_PERIOD_S = 5.0
"""Period of the sweep up and down, s."""


class SimulatedConfig(Config):
    """An arm that sweeps slowly from side to side, up and down."""

    rate_hz: float = Field(default=50.0, gt=0, le=1000, description="samples per second")
    azimuth_amplitude_deg: float = Field(default=40.0, ge=0, le=180, description="sweep to either side, °")
    elevation_deg: float = Field(default=-10.0, ge=-90, le=90, description="mean elevation of the arm, °")
    elevation_amplitude_deg: float = Field(default=10.0, ge=0, le=90, description="sweep up and down, °")


class SimulatedDevice:
    """Readings of a sensor on a sweeping arm."""

    def __init__(self, config: SimulatedConfig, sensor_from_arm: Quaternion = rotation.IDENTITY) -> None:
        """Mount the sensor as `sensor_from_arm`."""
        self._config = config
        self._arm_from_sensor = rotation.inverse(sensor_from_arm)

    def arm(self, time_s: float) -> Quaternion:
        """Return the true orientation of the arm, world_from_arm, `time_s` after the start."""
        config = self._config
        azimuth_deg = config.azimuth_amplitude_deg * math.sin(math.tau * time_s / AZIMUTH_PERIOD_S)
        elevation_deg = config.elevation_deg + config.elevation_amplitude_deg * math.sin(
            math.tau * time_s / ELEVATION_PERIOD_S
        )
        return rotation.from_azimuth_elevation(math.radians(azimuth_deg), math.radians(elevation_deg))

    def read(self, time_s: float) -> Quaternion:
        """Return the reading, world_from_sensor."""
        return rotation.normalized(rotation.multiply(self.arm(time_s), self._arm_from_sensor))


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
