"""Parameters of imu-bridge."""

import math
from typing import Literal

from pydantic import Field, field_validator

from pointit.runtime.config import Config

Order = Literal["wxyz", "xyzw"]
Fifth = Literal["auto", "time", "accuracy"]
MountingName = Literal["plus_x", "minus_x", "metamotion"]


class SerialConfig(Config):
    """A device that sends lines of text."""

    port: str = Field(
        default="", description="path or name of the port; /dev/serial/by-id/... survives plugging in again"
    )
    baud: int = Field(default=115200, gt=0, le=4_000_000, description="bits per second")
    order: Order = Field(default="wxyz", description="order of the quaternion's numbers in a line")
    fifth: Fifth = Field(
        default="auto",
        description="what a fifth number is: a leading time in µs, a trailing accuracy; "
        "auto: a time when the first number is beyond ±1.1",
    )
    timeout_s: float = Field(
        default=3.0, gt=0, le=60, description="connected without a readable line for so long is a warning, s"
    )


class ReplayConfig(Config):
    """A recorded device."""

    recording: str = Field(default="", description="CSV file with columns t (s), qw, qx, qy, qz")
    start_ns: int = Field(
        default=0,
        ge=0,
        le=2**62,
        description="time at which the recording's t is 0, Unix ns; 0: when the service starts",
    )
    loop: bool = Field(default=False, description="begin again at the end")


class SimulatedConfig(Config):
    """An arm that sweeps slowly from side to side, up and down."""

    rate_hz: float = Field(default=50.0, gt=0, le=1000, description="samples per second")
    azimuth_amplitude_deg: float = Field(default=40.0, ge=0, le=180, description="sweep to either side, °")
    azimuth_period_s: float = Field(default=8.0, gt=0, description="of one sweep there and back, s")
    elevation_deg: float = Field(default=-10.0, ge=-90, le=90, description="mean elevation of the arm, °")
    elevation_amplitude_deg: float = Field(default=10.0, ge=0, le=90, description="sweep up and down, °")
    elevation_period_s: float = Field(default=5.0, gt=0, description="of one sweep up and down, s")
    noise_deg: float = Field(
        default=0.0, ge=0, le=45, description="white noise about each axis, standard deviation, °"
    )
    yaw_drift_degps: float = Field(default=0.0, ge=-90, le=90, description="drift of the yaw, °/s")
    seed: int = Field(default=0, ge=0, description="of the noise")


class ImuBridgeConfig(Config):
    """Where the orientation comes from and how the sensor sits on the arm."""

    source: Literal["simulated", "replay", "serial"] = Field(
        default="simulated", description="simulated movement, a recording, or a serial device"
    )
    mounting: MountingName = Field(
        default="plus_x",
        description="the sensor's axis along the arm to the finger: plus_x, minus_x (Myo), "
        "metamotion (sensor turned by -90° about z)",
    )
    mounting_xyzw: tuple[float, float, float, float] | None = Field(
        default=None, description="sensor_from_arm as a quaternion x, y, z, w; in place of `mounting`"
    )
    yaw_origin_deg: float = Field(default=0.0, description="the device's yaw that counts as 0, °")
    serial: SerialConfig = Field(default=SerialConfig(), description="of the source `serial`")
    replay: ReplayConfig = Field(default=ReplayConfig(), description="of the source `replay`")
    simulated: SimulatedConfig = Field(default=SimulatedConfig(), description="of the source `simulated`")

    @field_validator("mounting_xyzw")
    @classmethod
    def _unit(
        cls, value: tuple[float, float, float, float] | None
    ) -> tuple[float, float, float, float] | None:
        if value is not None and abs(math.hypot(*value) - 1.0) > 0.01:
            raise ValueError(f"must have norm 1, has {math.hypot(*value):.4g}")
        return value
