"""Parameters of imu-bridge."""

import math
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from pointit.geometry.rotation import Quaternion
from pointit.runtime.config.config import Config
from pointit.services.imu_bridge.arm_frame import MOUNTINGS, from_roll_pitch_yaw

Order = Literal["wxyz", "xyzw"]
Fifth = Literal["auto", "time", "accuracy"]
MountingName = Literal[
    "plus_x", "minus_x", "plus_y", "minus_y", "metamotion", "myo", "watch_left", "watch_right", "phone"
]


class SerialConfig(Config):
    """A device that sends lines of text."""

    port: str = Field(
        default="", description="path or name of the port; /dev/serial/by-id/... survives plugging in again"
    )
    baud: int = Field(default=115200, gt=0, le=4_000_000, description="bits per second")
    order: Order = Field(default="wxyz", description="order of the quaternion's numbers in a line")
    fifth: Fifth = Field(
        default="auto",
        description="meaning of a fifth number: a leading time in µs or a trailing accuracy; "
        "auto: a time if the first number is beyond ±1.1",
    )
    timeout_s: float = Field(
        default=3.0,
        gt=0,
        le=60,
        description="time without a readable line after which a connected device is a warning, s",
    )


class ReplayConfig(Config):
    """A recorded device."""

    recording: str = Field(default="", description="CSV file with columns t (s), qw, qx, qy, qz")
    start_ns: int = Field(
        default=0,
        ge=0,
        le=2**62,
        description="time at which the recording's t is 0, Unix ns; 0: start of the service",
    )
    loop: bool = Field(default=False, description="restart at the end")


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


class ImuBridgeConfig(Config):
    """Source of the orientation, and mounting of the sensor on the arm."""

    source: Literal["simulated", "replay", "serial", "page"] = Field(
        default="simulated",
        description="simulated movement, a recording, a serial device; page: only the samples of a page, "
        "which every source accepts",
    )
    mounting: MountingName = Field(
        default="plus_x",
        description="mounting of the sensor on the arm while none was measured: its axis towards the "
        "finger (plus_x, minus_x, plus_y, minus_y; its z is up with the palm down), or a device: metamotion, "
        "myo, watch_left or watch_right (face out, on that wrist), phone (screen up, its top towards the "
        "finger); a measurement of `pointit calibrate mounting` with the same source and mounting is stored "
        "and overrides it",
    )
    mounting_xyzw: tuple[float, float, float, float] | None = Field(
        default=None,
        description="sensor_from_arm as a quaternion x, y, z, w; overrides `mounting` and, at each start, "
        "the stored measurement",
    )
    mounting_rpy_deg: tuple[float, float, float] | None = Field(
        default=None,
        description="the same as roll, pitch and yaw about the fixed axes x, y, z, in that order, °",
    )
    yaw_origin_deg: float = Field(default=0.0, description="the device's yaw that counts as 0, °")
    serial: SerialConfig = Field(default=SerialConfig(), description="settings of the source `serial`")
    replay: ReplayConfig = Field(default=ReplayConfig(), description="settings of the source `replay`")
    simulated: SimulatedConfig = Field(
        default=SimulatedConfig(), description="settings of the source `simulated`"
    )

    @property
    def explicit_mounting(self) -> Quaternion | None:
        """Return sensor_from_arm if it is configured as a rotation, or None if by name."""
        if self.mounting_rpy_deg is not None:
            roll, pitch, yaw = map(math.radians, self.mounting_rpy_deg)
            return from_roll_pitch_yaw(roll, pitch, yaw)
        return self.mounting_xyzw

    @property
    def configured_mounting(self) -> Quaternion:
        """Return sensor_from_arm as configured, without a measurement."""
        return self.explicit_mounting or MOUNTINGS[self.mounting]

    @field_validator("mounting_xyzw")
    @classmethod
    def _unit(
        cls, value: tuple[float, float, float, float] | None
    ) -> tuple[float, float, float, float] | None:
        if value is not None and abs(math.hypot(*value) - 1.0) > 0.01:
            raise ValueError(f"must have norm 1, has {math.hypot(*value):.4g}")
        return value

    @model_validator(mode="after")
    def _one_rotation(self) -> Self:
        if self.mounting_xyzw is not None and self.mounting_rpy_deg is not None:
            raise ValueError("mounting_xyzw and mounting_rpy_deg exclude each other: give one of them")
        return self
