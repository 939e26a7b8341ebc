"""Parameters of imu-bridge."""

from typing import Literal

from pydantic import Field, field_validator

from pointit.geometry.rotation import Quaternion
from pointit.runtime.config.plugins import PluginConfig, PluginGroup
from pointit.services.imu_bridge.arm_frame import MOUNTINGS
from pointit.services.imu_bridge.sources import SOURCES, ImuSource

MountingName = Literal[
    "plus_x", "minus_x", "plus_y", "minus_y", "metamotion", "myo", "watch_left", "watch_right", "phone"
]


class ImuBridgeConfig(PluginConfig):
    """Source of the orientation, and mounting of the sensor on the arm."""

    source: str = Field(
        default="simulated",
        description="kind of device: simulated, replay, serial, page (only samples of a page, which every "
        "source accepts), or that of an installed package; `pointit plugin list` shows them",
    )
    mounting: MountingName = Field(
        default="plus_x",
        description="mounting of the sensor on the arm while none was measured: its axis towards the "
        "finger (plus_x, minus_x, plus_y, minus_y; its z is up with the palm down), or a device: metamotion, "
        "myo, watch_left or watch_right (face out, on that wrist), phone (screen up, its top towards the "
        "finger); a measurement of `pointit person calibrate mounting` with the same source and mounting "
        "is stored and overrides it",
    )
    latency_sigma_s: float | None = Field(
        default=None,
        ge=0,
        le=10,
        description="1 sigma of the error of the samples' times, if it is known, by which following a robot "
        "is judged, s",
    )
    silence_s: float = Field(
        default=3.0,
        gt=0,
        le=3600,
        description="time without a reading after which a connected device is reported as silent, s",
    )
    yaw_origin_deg: float = Field(default=0.0, description="the device's yaw that counts as 0, °")

    @classmethod
    def plugins(cls) -> PluginGroup[ImuSource]:
        """Return the installed sources."""
        return SOURCES

    @property
    def configured_mounting(self) -> Quaternion:
        """Return sensor_from_arm as configured, without a measurement."""
        return MOUNTINGS[self.mounting]

    @field_validator("source")
    @classmethod
    def _installed(cls, source: str) -> str:
        SOURCES.check_name(source)
        return source
