"""Parameters of the interaction, and the person's profile."""

from typing import Literal

from pydantic import Field

from pointit.runtime.config import Config
from pointit.schemas import BodyMeasures
from pointit.schemas.base import Rgb

_BODY = BodyMeasures()


class BodyConfig(Config):
    """Lengths of the person's body."""

    footprint_to_neck_m: float = Field(
        default=_BODY.footprint_to_neck_m, gt=0, lt=3, description="from the floor to the neck, m"
    )
    neck_to_eyes_m: float = Field(
        default=_BODY.neck_to_eyes_m, ge=0, lt=1, description="from the neck up to the eyes, m"
    )
    neck_to_shoulder_m: float = Field(
        default=_BODY.neck_to_shoulder_m, ge=0, lt=1, description="from the neck sideways to the shoulder, m"
    )
    shoulder_to_wrist_m: float = Field(
        default=_BODY.shoulder_to_wrist_m, gt=0, lt=2, description="length of the arm, m"
    )
    wrist_to_finger_m: float = Field(
        default=_BODY.wrist_to_finger_m, ge=0, lt=1, description="from the wrist to the fingertip, m"
    )


class ProfileConfig(Config):
    """Who the person is to the system."""

    body: BodyConfig = Field(default=BodyConfig(), description="lengths of the person's body")
    hand: Literal["left", "right"] = Field(default="right", description="the hand that points")
    cursor_color: Rgb = Field(
        default=(255, 255, 255), description="colour of the person's cursor: red, green, blue, 0 to 255"
    )
    cursor_width_m: float = Field(default=0.1, gt=0, le=1, description="length of the cursor on a strip, m")


class SupervisorConfig(Config):
    """How a person gets from the button to pointing, and when they are sent back."""

    localize: bool = Field(
        default=False,
        description="find the person's place by pointing before they interact; otherwise it must be known",
    )
    relocalize_each_time: bool = Field(
        default=False, description="localize at every start, also when the place is known"
    )
    localization_method: Literal["static_targets", "moving_target"] | None = Field(
        default=None, description="what the person points at to be localized; empty: as the localizer has it"
    )
    localization_timeout_s: float = Field(
        default=60.0, gt=0, le=3600, description="localizing for longer ends it, s"
    )
    imu_timeout_s: float = Field(
        default=3.0, gt=0, le=600, description="a wrist that is silent for longer ends the interaction, s"
    )
    autostart: bool = Field(
        default=False,
        description="begin by itself when samples come, until a press stops it: for devices without a button",
    )
    retry_s: float = Field(
        default=5.0, gt=0, le=600, description="autostart: how long to wait after localizing failed, s"
    )
    profile: ProfileConfig = Field(default=ProfileConfig(), description="the person's profile")
