"""Messages of pointing: the ray, the pose it starts from, the cursor, the object under it."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pointit.schemas.base import (
    FARTHEST,
    MAX_ID,
    Along,
    Distance,
    Extent,
    Fraction,
    Id,
    KeyName,
    KeyNameOrEmpty,
    Many,
    Message,
    Ns,
    Real,
    Rgb,
    SchemaModel,
    UnitVec3,
    Vec3,
)

_Cov = Annotated[float, Field(ge=-(FARTHEST**2), le=FARTHEST**2)]

Covariance = Annotated[
    tuple[_Cov, _Cov, _Cov, _Cov, _Cov, _Cov, _Cov, _Cov, _Cov],
    Field(description="of (x, y, yaw of pointing), row by row, m², m·rad, rad²"),
]
"""Covariance of a pose on the floor."""

SurfaceKind = Literal["none", "strip", "belt", "lamp", "points"]
"""Surface under a cursor. `none` if the ray meets nothing, or a solid."""
Solid = Literal["", "box", "plane", "cylinder", "sphere"]
"""Solid under a cursor, or `""` if the cursor is on none."""

PressEffect = Literal["", "start", "cancel", "stop", "confirm"]

LINES: tuple[SurfaceKind, ...] = ("strip", "belt")
"""Surfaces with an arc length; on all others places are compared in space."""


class PointingRay(Message):
    """The pointing ray in {H}: from the eyes through the fingertip (paper, §II-A)."""

    version: ClassVar[int] = 2

    origin_m: Vec3
    direction: Annotated[UnitVec3, Field(description="filtered, without the person's offset")]
    raw_direction: Annotated[
        UnitVec3 | None, Field(description="of the model alone: neither filtered nor corrected")
    ] = None
    azimuth_correction_rad: Annotated[
        Real, Field(description="the person's offset as it was added to the raw azimuth")
    ] = 0.0
    elevation_correction_rad: Annotated[Real, Field(description="the same of the elevation")] = 0.0
    elevation_sigma_rad: Annotated[
        Extent | None,
        Field(description="1 sigma of the person's remaining elevation error; None if not calibrated"),
    ] = None


class RememberedBias(SchemaModel):
    """Elevation bias of a person with one wearing of the sensor, from their localizations so far.

    The rays lie above their targets by `bias_rad` at the elevation -20 degrees, and by `slope` more per rad.
    """

    localizations: Annotated[int, Field(ge=0, lt=2**31, description="number of those that measured it")]
    origin_height_m: Annotated[Real, Field(description="height of the rays' origin over the feet")]
    bias_rad: Real
    slope: Real
    covariance: Annotated[
        tuple[Real, Real, Real, Real], Field(description="of (bias, slope), row by row, rad², rad, rad, 1")
    ]
    mounting: Annotated[str, Field(max_length=128, description="of the sensor, see ImuSample")] = ""


class UserPose(Message):
    """{H} in {W}: where the person stands and how their IMU's yaw origin lies in the room."""

    version: ClassVar[int] = 3

    position_m: Vec3
    yaw_rad: Annotated[Real, Field(description="azimuth of {H}'s x axis in {W}")]
    covariance: Covariance = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    method: Literal["fixed", "static_targets", "moving_target", "external"] = "fixed"
    elevation_bias_rad: Annotated[
        Real, Field(description="the person's rays lie higher by it: subtract it before casting")
    ] = 0.0
    residual_rad: Annotated[Extent, Field(description="rms angle between rays and targets")] = 0.0
    samples: Annotated[int, Field(ge=0)] = 0
    yaw_rate_radps: Annotated[Real, Field(description="rate of `yaw_rad` due to the IMU's yaw drift")] = 0.0
    yaw_rate_sigma_radps: Annotated[
        Extent | None, Field(description="its 1 sigma, or None if not estimated")
    ] = None
    anchored_ns: Annotated[
        Ns, Field(description="last time at which pointing at a known point determined the pose; 0 if never")
    ] = 0
    z_sigma_m: Annotated[Extent, Field(description="1 sigma of the height; 0: the floor is known")] = 0.0
    remembered_bias: Annotated[
        RememberedBias | None,
        Field(description="elevation bias that the next localization by a robot expects, None if unknown"),
    ] = None


class Candidate(SchemaModel):
    """A thing that may be meant, and how probably."""

    object_id: Id
    probability: Fraction


class Localization(Message):
    """Progress of one localization, for the person and a dashboard; its lamps are lit by led-driver."""

    version: ClassVar[int] = 4

    phase: Literal["idle", "sampling", "solved", "refused", "cancelled"]
    target_id: Annotated[Id, Field(description="lamp or robot to point at now, or empty")] = ""
    target_index: Annotated[int, Field(ge=0)] = 0
    target_count: Annotated[int, Field(ge=0)] = 0
    samples: Annotated[int, Field(ge=0, description="rays gathered so far")] = 0
    since_ns: Annotated[Ns, Field(description="when this localization began; 0: none has")] = 0
    progress: Fraction = 0.0
    residual_rad: Extent | None = None
    reason: Annotated[str, Field(description="reason of a refusal and the remedy")] = ""
    purpose: Annotated[
        Literal["pose", "anchor"],
        Field(description="to find the pose, or to set one right by pointing at one known place"),
    ] = "pose"
    position_sigma_m: Annotated[
        Extent | None, Field(description="1 sigma along the worse direction, so far; None if unknown")
    ] = None
    yaw_sigma_rad: Annotated[Extent | None, Field(description="1 sigma so far, or None if unknown")] = None
    candidates: Annotated[
        Many[Candidate], Field(description="of several robots, which may be meant; the likeliest first")
    ] = ()
    ahead: Annotated[
        Many[KeyName],
        Field(description="people at the lamps or ahead in the queue; the person waits, not sampling"),
    ] = ()
    lamps: Annotated[
        Many[KeyName],
        Field(description="lamps that nobody else can use meanwhile; `target_id` among them is to be lit"),
    ] = ()


class Anchor(Message):
    """One pointing at a known point without a cursor, which shows a person's offset and an IMU's drift.

    `stamp_ns`: the middle of the hold.
    """

    target_id: Annotated[Id, Field(description="lamp or object; empty for a mere direction")] = ""
    target_m: Annotated[Vec3 | None, Field(description="{W}")] = None
    origin_m: Annotated[Vec3, Field(description="of the ray, {H}")]
    raw_direction: Annotated[UnitVec3, Field(description="mean of the raw rays, {H}")]
    direction: Annotated[UnitVec3, Field(description="the same without the person's offset")]
    spread_rad: Annotated[Extent, Field(description="rms of the rays about their mean")] = 0.0
    samples: Annotated[int, Field(ge=0)] = 0
    position_m: Annotated[Vec3, Field(description="of {H} in {W} before this anchor")] = (0.0, 0.0, 0.0)
    yaw_rad: Annotated[Real, Field(description="of {H} in {W} before this anchor")] = 0.0
    azimuth_error_rad: Annotated[
        Real, Field(description="target less ray, in the pose before this anchor; positive: to the left")
    ] = 0.0
    elevation_error_rad: Annotated[Real, Field(description="the same; positive: the target is higher")] = 0.0
    accepted: Annotated[bool, Field(description="whether the pose was set right by it")] = True
    reason: Annotated[str, Field(description="reason of a rejection and the remedy")] = ""


class LampMiss(SchemaModel):
    """Distance at which the ray passes a lamp."""

    id: KeyName
    miss_rad: Extent


class Passed(SchemaModel):
    """The thing nearest to a ray that passes everything by, and how the ray has to turn to meet it."""

    surface: SurfaceKind = "none"
    solid: Solid = ""
    surface_id: Id = ""
    point_m: Annotated[Vec3, Field(description="nearest point of it, {W}")]
    position_m: Annotated[Along, Field(description="arc length of that point along a strip or belt")] = 0.0
    right_rad: Annotated[Real, Field(description="azimuth to turn to the right; negative: to the left")]
    up_rad: Annotated[Real, Field(description="elevation to turn up; negative: down")]
    text: Annotated[
        str, Field(description="the same for the person, once they pointed past for a while; else empty")
    ] = ""


class Cursor(Message):
    """The intersection of the pointing ray with the environment, in {W}."""

    version: ClassVar[int] = 3

    surface: SurfaceKind = "none"
    surface_id: Id = ""
    point_m: Annotated[Vec3 | None, Field(description="on the surface, {W}")] = None
    position_m: Annotated[Along, Field(description="arc length along a strip or belt from its start")] = 0.0
    miss_m: Annotated[Distance, Field(description="from the ray to the point")] = 0.0
    miss_rad: Annotated[Extent, Field(description="angle at the eyes between ray and point")] = 0.0
    range_m: Annotated[Distance, Field(description="from the eyes to the point")] = 0.0
    solid: Annotated[Solid, Field(description="thing with an area it is on; `surface` is none then")] = ""
    uv_m: Annotated[
        tuple[Along, Along] | None, Field(description="place on such a thing, in its own two axes")
    ] = None
    origin_m: Annotated[Vec3 | None, Field(description="where the ray begins, {W}")] = None
    direction: Annotated[UnitVec3 | None, Field(description="of the ray, {W}")] = None
    lamps: Annotated[Many[LampMiss], Field(description="lamps near the ray, where that is asked for")] = ()
    passed: Annotated[
        Passed | None,
        Field(description="nearest thing, where the ray passes everything and the arm does not rest"),
    ] = None


class Hover(Message):
    """The object under the person's cursor and how far its selection has come."""

    version: ClassVar[int] = 3

    object_id: Annotated[Id, Field(description="empty when none")] = ""
    progress: Fraction = 0.0
    action: Annotated[
        Literal["", "select", "deselect", "refuse"], Field(description="effect of dwelling there")
    ] = ""
    taken_by: Annotated[KeyNameOrEmpty, Field(description="other person who has selected or reserved it")] = (
        ""
    )
    is_selected: bool = False
    snapped_m: Annotated[
        Vec3 | None, Field(description="position that attracts the cursor, {W}; the true one is the cursor's")
    ] = None
    snapped_position_m: Annotated[
        Along | None, Field(description="the same along the cursor's surface; None if nothing attracts it")
    ] = None
    miss_rad: Annotated[Extent | None, Field(description="from the ray to the object, 0: on it")] = None
    act_ns: Annotated[
        Ns | None,
        Field(
            description="`asked_ns` of their last act on it since they came, see `Selection.acts`, or None"
        ),
    ] = None


class Announced(Message):
    """The object whose name is spoken to the person, since they point at it or stepped to it.

    The first message has no object: it says that names are spoken to the person.
    """

    object_id: Annotated[Id, Field(description="empty when none")] = ""
    label: Annotated[str, Field(max_length=MAX_ID, description="text to speak; empty when none")] = ""
    began_ns: Annotated[
        Ns, Field(description="when the name began; a later one for the same object: it is spoken again")
    ] = 0


class StepChoice(SchemaModel):
    """A choice that a person has at their next step, besides pointing and pressing."""

    id: KeyName
    label: Annotated[str, Field(min_length=1, max_length=MAX_ID, description="of its button")]


class Interaction(Message):
    """State of the person in the interaction's life cycle (paper, §II-D), and their next step."""

    version: ClassVar[int] = 5

    state: Literal["idle", "localizing", "pointing"]
    next_step: Annotated[str, Field(description="instruction to the person, in one sentence")] = ""
    reason: Annotated[str, Field(description="why the state was entered")] = ""
    ahead: Annotated[
        Many[KeyName],
        Field(description="people to be localized before, in turn; also empty without a request"),
    ] = ()
    is_unsure: Annotated[
        bool,
        Field(
            description="the person's direction has become uncertain: a double press, then pointing at a "
            "lamp once, sets it right"
        ),
    ] = False
    press: Annotated[
        PressEffect,
        Field(description="effect of a press now: begin, cancel localizing, end, select; empty if none"),
    ] = ""
    is_advised: Annotated[
        bool, Field(description="the next step is that of a service which acts on what the person does")
    ] = False
    is_guided: Annotated[
        bool, Field(description="a set-up leads the person: nothing else instructs them meanwhile")
    ] = False
    choices: Annotated[Many[StepChoice], Field(description="of the next step, the usual one first")] = ()


class Goal(Message):
    """A place at which a person pointed in two steps, where a robot is to go, {W}; no safety function.

    `stamp_ns`: of the ray with which it was confirmed. Who receives it judges it: late, or unsure, it is not
    to be followed.
    """

    version: ClassVar[int] = 2

    position_m: Vec3
    yaw_rad: Annotated[Real, Field(description="azimuth from the person to the place: facing on, on arrival")]
    surface_id: Annotated[
        Id, Field(description="level plane of the map it is on, or `workspace/horizontal`; empty if unknown")
    ] = ""
    age_s: Annotated[Extent, Field(description="of that ray when the goal was given")]
    position_sigma_m: Annotated[
        Extent, Field(description="1 sigma along the worse direction, of the person's place and aim")
    ]
    clearance_m: Annotated[
        Extent, Field(description="on the floor from there to the nearest person with a known position")
    ]
    proposed_ns: Annotated[Ns, Field(description="stamp of the ray with which it was proposed")]
    confirmed_by: Annotated[
        Literal["again", "press"], Field(description="by pointing there once more, or by their button")
    ]
    robot: Annotated[KeyNameOrEmpty, Field(description="that is to go there, or empty if any may")] = ""
    via_m: Annotated[Many[Vec3], Field(description="way-points before `position_m`, in order, {W}")] = ()


class Feedback(Message):
    """A cue for the person's senses."""

    version: ClassVar[int] = 4

    cue: Literal["started", "stopped", "target", "localized", "refused", "selected", "deselected"]
    text: str = ""
    chime: Annotated[
        Literal["", "up", "down", "single", "double", "buzz", "tick", "tock"],
        Field(description="sound to play"),
    ] = ""
    haptic_ms: Annotated[
        Many[Annotated[int, Field(gt=0, le=2000)]],
        Field(description="vibration pattern: on, off, on ..., ms; empty for none"),
    ] = ()
    color: Annotated[Rgb | None, Field(description="short flash of the light of a wrist")] = None
    target_id: Annotated[Id, Field(description="target that the person should point at")] = ""
    waits: Annotated[bool, Field(description="there is nothing to do yet but wait for the next cue")] = False
    point_m: Annotated[Vec3 | None, Field(description="position that it refers to, {W}, or None")] = None
    turn_rad: Annotated[
        tuple[Real, Real] | None,
        Field(description="rotation to the target, right and up, if the ray misses everything; else None"),
    ] = None
