"""Requests to services, and their replies."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, WithJsonSchema

from pointit.schemas.base import (
    Fraction,
    Id,
    Many,
    Name,
    Ns,
    QuaternionXyzw,
    Query,
    Real,
    Reply,
    Rgb,
    SchemaModel,
    Vec3,
)
from pointit.schemas.person import MAX_WORDS, Deictic, PointingOffset, Referent
from pointit.schemas.pointing import Covariance, RememberedBias, StepChoice
from pointit.schemas.selection import ActStatus, FailureCode, SelectionEvent


class AddPackage(Query):
    """Put one object on a lane of the conveyor."""

    version: ClassVar[int] = 2

    kind: Annotated[str, Field(min_length=1, max_length=64)]
    lane: Annotated[Id, Field(description="strip or belt id; empty for the first lane")] = ""
    length_m: Annotated[float, Field(gt=0, le=5)] = 0.3
    position: Annotated[
        Fraction | None,
        Field(description="share of the lane's length from its start; None for the feed point"),
    ] = None


class AddPackageReply(Reply):
    """The object's id."""

    object_id: Id


class SetSpeed(Query):
    """Set the conveyor's speed; 0 stops it, negative runs it backwards."""

    version: ClassVar[int] = 2

    speed_mps: Annotated[float, Field(ge=-5, le=5)]
    belts: Annotated[Many[Id], Field(description="ids of belts, or empty for all")] = ()


class SetFeeding(Query):
    """Start or stop the feeders. Belts run on, and packages can be added, either way."""

    feeding: Annotated[
        bool, Field(description="false: they rest until it is true again, whatever a schedule's step says")
    ]


class ResetConveyor(Query):
    """Remove all objects and start the feeders again."""


class StartLocalization(Query):
    """Begin to localize a person."""

    method: Annotated[
        Literal["static_targets", "moving_target"] | None, Field(description="None for the configured one")
    ] = None


class CancelLocalization(Query):
    """Stop localizing and keep the last pose."""

    version: ClassVar[int] = 2

    forget_bias: Annotated[
        bool,
        Field(description="forget the elevation bias that earlier localizations told, as of another person"),
    ] = False


class SetPose(Query):
    """Set the pose of the person."""

    version: ClassVar[int] = 3

    position_m: Vec3
    yaw_rad: Real = 0.0
    method: Annotated[
        Literal["fixed", "static_targets", "moving_target"],
        Field(description="how it was found; with a covariance it is tracked as the IMU drifts"),
    ] = "fixed"
    covariance: Annotated[Covariance | None, Field(description="of a pose that is not exact")] = None
    elevation_bias_rad: Annotated[Real, Field(description="found with it, see UserPose")] = 0.0
    remembered_bias: Annotated[
        RememberedBias | None, Field(description="of the localizer before; the remembered one stays if empty")
    ] = None


class SetHeading(Query):
    """The person points in a known direction right now: set the yaw of their pose by it."""

    azimuth_rad: Annotated[Real, Field(description="of that direction in {W}, such as towards a wall")]


class PointAnchor(Query):
    """Ask the person to point at one lamp without a cursor, to correct their pose."""

    lamp: Annotated[Id, Field(description="its id, or empty for the most informative one")] = ""


class SetOffset(Query):
    """Keep a person's pointing offset."""

    offset: Annotated[PointingOffset | None, Field(description="None removes it")] = None


class SetMounting(Query):
    """Set the mounting of the sensor on the arm."""

    sensor_from_arm_xyzw: Annotated[
        QuaternionXyzw | None, Field(description="rotates arm vectors into the sensor; None if as configured")
    ] = None
    is_relative: Annotated[
        bool, Field(description="it counts from the mounting in use, so rotates into the arm frame of today")
    ] = False


class SetMountingReply(Reply):
    """The mounting in use now."""

    sensor_from_arm_xyzw: QuaternionXyzw


class ClearSelection(Query):
    """Deselect everything a person has selected."""


class UndoSelection(Query):
    """Undo the last selection or deselection of a person."""


class ReleaseObject(Query):
    """Deselect one object of any person: for a supervisor, or to take it over."""

    object_id: Annotated[Id, Field(min_length=1), WithJsonSchema({"type": "string", "minLength": 1})]
    take_over: Annotated[bool, Field(description="select it at once for the requesting person")] = False


class SetThing(Query):
    """Fire a thing, or switch it, without pointing at it: for who tries it, or knows its true state."""

    version: ClassVar[int] = 2

    thing: Annotated[Id, Field(min_length=1), WithJsonSchema({"type": "string", "minLength": 1})]
    on: Annotated[bool | None, Field(description="state of a switch; None toggles, or fires a button")] = None
    is_restored: Annotated[bool, Field(description="state before a restart: nothing reacts")] = False


class BeginAct(Query):
    """Ask whether a carrier may begin an act: it may have been given up while the carrier was cut off."""

    object_id: Id
    event_ns: Annotated[Ns, Field(description="stamp of the event of the act")]


class SetWorkspace(Query):
    """Choose a surface about a person on which their cursor moves, instead of the things of the map."""

    kind: Annotated[
        Literal["none", "horizontal", "facing", "cylinder", "sphere"],
        Field(
            description="none: the map; horizontal plane; vertical plane that faces the person; upright "
            "cylinder about the person; sphere about their eyes"
        ),
    ]
    anchor: Annotated[Literal["pointer", "object", "point"], Field(description="point on the plane")] = (
        "pointer"
    )
    object_id: Id = ""
    point_m: Vec3 | None = None


class SetMethod(Query):
    """Choose how dwelling on an object selects it, and for how long. Without values it only reads them."""

    version: ClassVar[int] = 2

    method: Annotated[Literal["hold", "fraction", "gauge"] | None, Field(description="None to keep it")] = (
        None
    )
    dwell_s: Annotated[
        float | None,
        Field(gt=0, le=10, description="time on an object that selects it; None for the method's default"),
    ] = None
    name: Annotated[Name | None, Field(description="any installed method, instead of `method`")] = None


class SetMethodReply(Reply):
    """The method in use now."""

    version: ClassVar[int] = 2

    method: Annotated[
        Literal["hold", "fraction", "gauge"],
        Field(description="the method, or gauge (by angle) or hold (by metres) for that of another package"),
    ]
    dwell_s: Annotated[float, Field(gt=0, le=10)]
    name: Annotated[str, Field(max_length=64, description="the method; empty from version 1")] = ""
    installed: Annotated[Many[Name], Field(description="all installed methods")] = ()


class ReadHistory(Query):
    """Read the last selection events that the selector published, from its journal."""

    last: Annotated[int, Field(ge=1, le=200, description="so many at most")] = 200
    since_ns: Annotated[Ns, Field(description="nothing before, Unix ns")] = 0


class ReadHistoryReply(Reply):
    """The published events, as far as there is room. The oldest are left out."""

    version: ClassVar[int] = 4

    max_bytes: ClassVar[int] = 256 * 1024

    events: Annotated[
        Many[SelectionEvent],
        Field(description="the latest last; number, stamp, object and event are those of the message then"),
    ] = ()


class SetTolerance(Query):
    """Choose how far a ray may pass its target. Without values it only reads the tolerance."""

    tolerance_rad: Annotated[
        float | None, Field(gt=0, lt=1.57, description="angle at the eyes; None to keep it")
    ] = None


class SetToleranceReply(Reply):
    """The tolerance in use now."""

    tolerance_rad: Annotated[float | None, Field(gt=0, lt=1.57, description="angle at the eyes")] = None


class UseMap(Query):
    """Use another map, or the same file again after it has changed. Without a path only tell which it is."""

    path: Annotated[
        str, Field(max_length=4096, description="shipped map, or path on pui's machine; empty to keep it")
    ] = ""


class UseMapReply(Reply):
    """The map in use now."""

    path: Annotated[str, Field(max_length=4096, description="shipped map, or absolute path on pui's machine")]


class StopRobot(Query):
    """Stop a robot: nobody steers it any more until somebody takes it again. Not a safety function."""

    reason: Annotated[str, Field(max_length=200, description="why, in a few words, for who steers it")] = ""


class Say(Query):
    """Tell a person something, by a cue with a text."""

    version: ClassVar[int] = 4

    text: Annotated[str, Field(min_length=1, max_length=200)]
    stays: Annotated[
        bool, Field(description="no cue: it is their next step while they point, until another one")
    ] = False
    service: Annotated[
        Id, Field(description="instance that advises: what stays ends with its presence. Empty: a program")
    ] = ""
    is_over: Annotated[bool, Field(description="no cue: `text`, which stays, does not stay any longer")] = (
        False
    )
    guides: Annotated[
        bool,
        Field(
            description="with `stays`: a set-up leads the person, so that it is their next step also while "
            "they rest, and before that of any other service"
        ),
    ] = False
    choices: Annotated[
        Many[StepChoice], Field(description="with `guides`: that the person has at this step")
    ] = ()


class FindReferents(Query):
    """Find what a person meant by a word, from where they pointed before, at and after it.

    Answered at once, from the rays that are there: ask a moment after the word.
    """

    at_ns: Annotated[Ns | None, Field(description="middle of the word; None for now")] = None
    within_s: Annotated[
        float, Field(gt=0, le=3, description="rays count up to so long before and after the word, s")
    ] = 1.0
    word: Annotated[Deictic, Field(description="the word; empty for any")] = ""
    others_ns: Annotated[
        tuple[Ns, ...],
        Field(max_length=MAX_WORDS, description="middles of the other deictic words of the sentence"),
    ] = ()


class Referents(Reply):
    """Candidates for a word of a person. `message`: problem of the rays, or empty."""

    candidates: Annotated[tuple[Referent, ...], Field(description="the most probable first")] = ()
    none: Annotated[Fraction, Field(description="probability of none of these")] = 1.0
    rays: Annotated[int, Field(ge=0, description="number of rays that count")] = 0


class SendRobot(Query):
    """Send a robot to a place, in the name of the person, with the checks of a place pointed at."""

    position_m: Annotated[Vec3, Field(description="on the person's floor, {W}")]
    robot: Annotated[Id, Field(description="empty: the one they have, or any if robots are not taken")] = ""


class RunScenario(Query):
    """Replace the running scenario by another one, on the same site."""

    scenario: Annotated[str, Field(min_length=1, max_length=64, description="one of the deployment's")]
    users: Annotated[int | None, Field(ge=0, le=64, description="number of people, or None to keep it")] = (
        None
    )
    localizes: Annotated[
        bool | None, Field(description="locate people by pointing at lamps; None to keep the setting")
    ] = None


class SetBrightness(Query):
    """Dim all strips, or some."""

    version: ClassVar[int] = 2

    brightness: Fraction
    strips: Annotated[Many[Id], Field(description="ids of strips, or empty for all")] = ()


class LitPixels(SchemaModel):
    """Pixels of one strip in one colour."""

    id: Annotated[Id, Field(description="of the strip")]
    pixels: Many[Annotated[int, Field(ge=0, lt=4096, description="numbers on the strip")]]
    color: Rgb


class ShowPixels(Query):
    """Show these pixels on the strips, undimmed, and nothing else, for a while."""

    max_bytes: ClassVar[int] = 256 * 1024

    lit: Annotated[Many[LitPixels], Field(description="all other pixels are dark")] = ()
    for_s: Annotated[
        float, Field(ge=0, le=60, description="until they show cursors and objects again, s; 0: from now on")
    ] = 5.0


class SetLamp(Query):
    """Show a colour on a lamp that nobody needs to localize, until it is given back."""

    color: Annotated[Rgb | None, Field(description="None gives the lamp back")] = None


class SetYawOrigin(Query):
    """Turn a person's IMU so that it reads `yaw_rad` now."""

    yaw_rad: Real = 0.0


class Done(Reply):
    """It was done, or the acts of a selection were begun."""

    version: ClassVar[int] = 2

    status: Annotated[
        ActStatus | None,
        Field(
            description="of requests to the selector: state of the acts, of the least one; None without acts"
        ),
    ] = None


class BeginActReply(Reply):
    """Answer to a carrier that wants to begin an act, valid for as long as the question could have taken."""

    code: Annotated[FailureCode, Field(description="empty: it may begin; else the reason why not")] = ""
