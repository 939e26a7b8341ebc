"""Parameters of the interaction, and the person's profile."""

import math
from collections.abc import Mapping
from typing import Literal, Self

from pydantic import Field, model_validator

from pointit.runtime.config.config import Config
from pointit.schemas import BodyMeasures
from pointit.schemas.base import Rgb
from pointit.schemas.person import RayModel

DEFAULT_STATURE_M = 1.835
"""Stature of the default measures (pointing.md §1), m."""
SITTING_HEIGHT = 0.520
"""Height from the seat to the crown, as a share of the stature: men 0.5205, women 0.5229 (Gordon et al., 1988
Anthropometric Survey of U.S. Army Personnel, 1989). Sitting down lowers the neck by the rest of the stature,
less the height of the seat."""
SEAT_HEIGHT = 0.247
"""Popliteal height in the same survey: height of a seat on which the feet stand flat, as a share."""
MIN_REACH_M = 0.05
"""Minimum distance of the finger of a straight arm beyond the eyes, m."""


def measures(
    stature_m: float,
    given_m: Mapping[str, float],
    *,
    ray_model: str = "eye_finger",
    seated: bool = False,
    seat_height_m: float | None = None,
) -> BodyMeasures:
    """Return the lengths for `stature_m`. Those in `given_m` replace the scaled ones.

    Raises:
        ValueError: If they contradict each other. The message has the lengths and the remedy.
    """
    # Contradictions between the given values
    if seat_height_m is not None and not seated:
        raise ValueError(
            f"seat_height_m ({seat_height_m}) is given, but the person stands: set seated, or leave it out"
        )
    if seated and "footprint_to_neck_m" in given_m:
        raise ValueError(
            f"body.footprint_to_neck_m ({given_m['footprint_to_neck_m']}) and seated exclude each other: "
            "give that height as it is when sitting and leave seated out, or give stature_m"
        )

    # Scale what is not given. A person who sits is lower, by the legs less the seat.
    factor = stature_m / DEFAULT_STATURE_M
    scaled = {name: factor * value for name, value in BodyMeasures().model_dump().items()}
    if seated:
        seat_m = SEAT_HEIGHT * stature_m if seat_height_m is None else seat_height_m
        scaled["footprint_to_neck_m"] += seat_m - (1.0 - SITTING_HEIGHT) * stature_m

    # A straight arm must reach past the eyes, where this ray begins
    body = BodyMeasures(**{**scaled, **given_m})
    arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m
    to_eyes_m = math.hypot(body.neck_to_shoulder_m, body.neck_to_eyes_m)
    if ray_model == "eye_finger" and arm_m < to_eyes_m + MIN_REACH_M:
        raise ValueError(
            f"an arm of {arm_m:.2f} m does not reach past eyes {to_eyes_m:.2f} m from the shoulder: correct "
            "body.shoulder_to_wrist_m or body.neck_to_eyes_m, or choose another ray_model"
        )
    return body


class BodyConfig(Config):
    """Lengths of the person's body. Empty ones are scaled from the stature."""

    footprint_to_neck_m: float | None = Field(
        default=None, gt=0, lt=3, description="from the floor to the neck, standing, m; by stature if empty"
    )
    neck_to_eyes_m: float | None = Field(
        default=None, ge=0, lt=1, description="from the neck up to the eyes, m; by stature if empty"
    )
    neck_to_shoulder_m: float | None = Field(
        default=None, ge=0, lt=1, description="from the neck sideways to the shoulder, m; 0 if empty"
    )
    shoulder_to_wrist_m: float | None = Field(
        default=None, gt=0, lt=2, description="length of the arm, m; by stature if empty"
    )
    wrist_to_finger_m: float | None = Field(
        default=None, ge=0, lt=1, description="from the wrist to the fingertip, m; by stature if empty"
    )


class ProfileConfig(Config):
    """The person's profile for the system."""

    stature_m: float = Field(
        default=DEFAULT_STATURE_M,
        ge=0.9,
        le=2.5,
        description="height of the person, m; the lengths of the body are scaled from it",
    )
    seated: bool = Field(default=False, description="the person sits upright: neck and eyes are lower")
    seat_height_m: float | None = Field(
        default=None,
        ge=0.1,
        le=1.2,
        description="height of the seat above the floor, m; a chair that fits the person if empty",
    )
    body: BodyConfig = Field(default=BodyConfig(), description="lengths of the person's body")
    hand: Literal["left", "right"] = Field(default="right", description="the hand that points")
    ray_model: RayModel = Field(
        default="eye_finger",
        description="ray from the eyes through the fingertip, from the shoulder along the arm, or "
        "from the elbow of a hanging upper arm along the forearm",
    )
    cursor_color: Rgb = Field(
        default=(255, 255, 255), description="colour of the person's cursor: red, green, blue, 0 to 255"
    )
    cursor_colormap: str = Field(
        default="",
        max_length=32,
        description="colormap of the cursor by its distance, such as viridis; `cursor_color` if empty",
    )
    cursor_width_m: float = Field(default=0.1, gt=0, le=1, description="length of the cursor on a strip, m")
    pattern: Literal["solid", "dashed", "dotted", "striped", "hollow", "tailed"] = Field(
        default="solid", description="pattern of this person's objects, in addition to the colour"
    )

    @model_validator(mode="after")
    def _body_is_one(self) -> Self:
        self.measures()
        return self

    def measures(self) -> BodyMeasures:
        """Return the lengths of the pointing model.

        Raises:
            ValueError: If they contradict each other.
        """
        lengths_m = self.body.model_dump()
        given_m = {name: length_m for name, length_m in lengths_m.items() if length_m is not None}
        return measures(
            self.stature_m,
            given_m,
            ray_model=self.ray_model,
            seated=self.seated,
            seat_height_m=self.seat_height_m,
        )


class SupervisorConfig(Config):
    """Transitions of a person from the button to pointing and back."""

    localize: bool = Field(
        default=False,
        description="localize the person by pointing before they interact; else their pose must be known",
    )
    relocalize_each_time: bool = Field(
        default=False, description="localize at every start, even if the pose is known"
    )
    localization_method: Literal["static_targets", "moving_target"] | None = Field(
        default=None, description="kind of targets for localization; the localizer's default if empty"
    )
    localization_timeout_s: float = Field(
        default=60.0, gt=0, le=3600, description="timeout per target, s, without waiting for a turn"
    )
    imu_timeout_s: float = Field(
        default=3.0, gt=0, le=600, description="silence of the wrist that ends the interaction, s"
    )
    autostart: bool = Field(
        default=False,
        description="start automatically when samples come, until a press: for devices without a button",
    )
    resume_s: float = Field(
        default=30.0,
        ge=0,
        le=3600,
        description="time within which samples resume pointing that a silent wrist or a restarted supervisor "
        "interrupted, s; 0: a press is required",
    )
    press_while_pointing: Literal["ends", "confirms"] = Field(
        default="ends",
        description="effect of a press while pointing: ends it, or confirms a selection in the selector, and "
        "only holding the button ends it",
    )
    profile: ProfileConfig = Field(default=ProfileConfig(), description="the person's profile")
