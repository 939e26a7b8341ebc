"""Where the person points: the ray, the pose it starts from, the cursor, the object under it."""

from typing import Annotated, Literal

from pydantic import Field

from pointit.schemas.base import (
    FARTHEST,
    Along,
    Distance,
    Extent,
    Fraction,
    Message,
    Ns,
    Real,
    UnitVec3,
    Vec3,
)

_Cov = Annotated[float, Field(ge=-(FARTHEST**2), le=FARTHEST**2)]

SurfaceKind = Literal["none", "strip", "belt", "lamp", "points"]
"""What a cursor can be on; `none` when the ray passes everything by."""


class PointingRay(Message):
    """The pointing ray in {H}: from the eyes through the fingertip (paper, §II-A)."""

    origin_m: Vec3
    direction: UnitVec3


class UserPose(Message):
    """{H} in {W}: where the person stands and how their IMU's yaw origin lies in the room."""

    position_m: Vec3
    yaw_rad: Annotated[Real, Field(description="azimuth of {H}'s x axis in {W}")]
    covariance: Annotated[
        tuple[_Cov, _Cov, _Cov, _Cov, _Cov, _Cov, _Cov, _Cov, _Cov],
        Field(description="of (x, y, yaw), row by row, m², m·rad, rad²"),
    ] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    method: Literal["fixed", "static_targets", "moving_target", "external"] = "fixed"
    elevation_bias_rad: Annotated[Real, Field(description="found with the pose; for diagnosis")] = 0.0
    residual_rad: Annotated[Extent, Field(description="rms angle between rays and targets")] = 0.0
    samples: Annotated[int, Field(ge=0)] = 0


class Localization(Message):
    """Progress of one localization, as the person and a dashboard should see it."""

    phase: Literal["idle", "sampling", "solved", "refused", "cancelled"]
    target_id: Annotated[str, Field(description="lamp or robot to point at now; empty when none")] = ""
    target_index: Annotated[int, Field(ge=0)] = 0
    target_count: Annotated[int, Field(ge=0)] = 0
    samples: Annotated[int, Field(ge=0, description="rays gathered so far")] = 0
    since_ns: Annotated[Ns, Field(description="when this localization began; 0: none has")] = 0
    progress: Fraction = 0.0
    residual_rad: Extent | None = None
    reason: Annotated[str, Field(description="why it was refused and what to do")] = ""


class Cursor(Message):
    """Where the pointing ray meets the environment, in {W}."""

    surface: SurfaceKind = "none"
    surface_id: str = ""
    point_m: Annotated[Vec3 | None, Field(description="on the surface, {W}")] = None
    position_m: Annotated[Along, Field(description="arc length along a strip or belt from its start")] = 0.0
    miss_m: Annotated[Distance, Field(description="from the ray to the point")] = 0.0
    miss_rad: Annotated[Extent, Field(description="angle at the eyes between ray and point")] = 0.0
    range_m: Annotated[Distance, Field(description="from the eyes to the point")] = 0.0


class Hover(Message):
    """The object under the person's cursor and how far its selection has come."""

    object_id: Annotated[str, Field(description="empty when none")] = ""
    progress: Fraction = 0.0


class Interaction(Message):
    """Where the person is in the interaction's life cycle (paper, §II-D), and what they should do next."""

    state: Literal["idle", "localizing", "pointing"]
    next_step: Annotated[str, Field(description="one sentence for the person")] = ""
    reason: Annotated[str, Field(description="why the state was entered")] = ""


class Feedback(Message):
    """A cue for the person's senses."""

    cue: Literal["started", "stopped", "target", "localized", "refused", "selected", "deselected"]
    text: str = ""
