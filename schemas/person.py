"""Messages of a person's devices, profile and words: IMU samples, button presses, body measures, speech."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pointit.schemas.base import (
    Count,
    Extent,
    Fraction,
    Id,
    Many,
    Message,
    Ns,
    QuaternionXyzw,
    Real,
    Rgb,
    SchemaModel,
    Vec3,
)

ReferentKind = Literal["thing", "robot", "object", "person", "place", "direction"]
"""Kind of a referent: `object` is a tracked one that is no thing of the map."""

Gesture = Literal["press", "double", "hold"]
"""Press of a button, two in quick succession, or a long one."""

RayModel = Literal["eye_finger", "shoulder_arm", "forearm"]
"""Line along which a person points."""

Deictic = Literal["", "this", "that", "here", "there", "these"]
"""Word that refers by pointing, or `""` for any: `these` to all that is swept over."""

Terms = tuple[Real, Real, Real, Real, Real, Real]
"""Coefficients of 1, a, e, a², a·e, e² with a, e of `PointingOffset`; rad."""

WRIST_PATIENCE_S = 1.0
"""A page controls a person's wrist until it has sent no `WristSample` for this long (s, wall clock).

Other sources of that wrist's motion pause meanwhile. All use the same time, or two would move it at once.
"""

MAX_WORDS = 64
"""Limit of words of a message, and of deictic words of a request."""


class ImuSample(Message):
    """Orientation of the arm: rotates vectors of the arm frame (x along the arm to the finger) into {H}.

    {H} is at the person's feet, z up, x forward at IMU yaw 0. The publisher has already removed the mounting
    of the sensor on the arm.
    """

    version: ClassVar[int] = 3

    orientation_xyzw: QuaternionXyzw
    angular_velocity_radps: Annotated[Vec3 | None, Field(description="in the arm frame, rad/s")] = None
    acceleration_mps2: Annotated[Vec3 | None, Field(description="in the arm frame, m/s²")] = None
    device_time_ns: Annotated[Ns | None, Field(description="the device's own clock, ns")] = None
    battery: Annotated[Fraction | None, Field(description="charge left, 0 to 1")] = None
    yaw_epoch: Annotated[
        Count, Field(description="number of resets of the yaw origin: a request, another mounting, a restart")
    ] = 0
    mounting: Annotated[
        str,
        Field(
            max_length=128,
            description="kind of device and how it sits on the arm, such as `ble metamotion`; empty if "
            "unknown. With another one a person's pointing has other systematic errors",
        ),
    ] = ""
    latency_sigma_s: Annotated[
        Extent | None, Field(description="1 sigma of the error of stamp_ns, s; None if unknown")
    ] = None


class WristSample(Message):
    """Orientation of a person's hand as a page reports it: of the arm that a mouse moves, or of a phone.

    Sent at least five times a second while the page controls the person's wrist, moving or not.
    """

    version: ClassVar[int] = 2

    orientation_xyzw: Annotated[
        QuaternionXyzw, Field(description="rotates vectors of the device into a frame whose z is up")
    ]
    device: Annotated[
        Literal["arm", "phone"],
        Field(
            description="arm: x along the arm to the finger, the frame is {H}; phone: x to the right of its "
            "screen, y to its top, the frame's yaw is its own"
        ),
    ] = "arm"
    session: Annotated[
        Count, Field(description="another number: the device may have another yaw origin than before")
    ] = 0
    device_time_ns: Annotated[Ns | None, Field(description="the device's own clock, ns")] = None
    battery: Annotated[Fraction | None, Field(description="charge left, 0 to 1")] = None
    source: Annotated[Id, Field(description="headset, which measures the arm; a mouse or ROS if empty")] = ""


class ButtonEvent(Message):
    """The person pressed their button; presses move the interaction on."""

    gesture: Gesture = "press"
    source: Annotated[Id, Field(description="device, page, headset, keyboard, joypad, simulated")] = "device"


class Step(Message):
    """The person moved from the announced object to another, or to the nearest: by crown, swipe or key."""

    version: ClassVar[int] = 2

    by: Annotated[
        Literal[-1, 1], Field(description="1: to the right, or to the row below; -1: to the left, or above")
    ]
    to: Annotated[
        Literal["beside", "row", "here"],
        Field(
            description="beside: the next object of its row; row: the nearest one of the next row; here: it "
            "stays, and its place in the row is spoken after its name"
        ),
    ] = "beside"
    source: Annotated[Id, Field(description="device, page, headset, keyboard, simulated")] = "device"


class BodyMeasures(SchemaModel):
    """Lengths of the pointing model, metres; defaults as in the ROS 2 toolkit (eyes at 1.64 m)."""

    footprint_to_neck_m: Annotated[float, Field(gt=0, lt=3)] = 1.43
    neck_to_eyes_m: Annotated[float, Field(ge=0, lt=1)] = 0.21
    neck_to_shoulder_m: Annotated[float, Field(ge=0, lt=1)] = 0.0
    shoulder_to_wrist_m: Annotated[float, Field(gt=0, lt=2)] = 0.55
    wrist_to_finger_m: Annotated[float, Field(ge=0, lt=1)] = 0.18


class PointingOffset(SchemaModel):
    """A person's systematic error, fitted from pointing at known targets without a cursor (pointing.md §3).

    What is added to the model's ray: azimuth and elevation are polynomials in a, the ray's azimuth in {W}
    less `reference_rad`, and e, its elevation, both taken before the correction.
    """

    rung: Annotated[
        Literal["pitch", "polynomial"], Field(description="pitch: only the constant of the elevation")
    ]
    azimuth: Terms = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    elevation: Terms = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    reference_rad: Annotated[Real, Field(description="azimuth in {W} in the midst of the anchors")] = 0.0
    azimuth_range_rad: Annotated[
        tuple[Real, Real], Field(description="least and greatest a of the anchors; held there beyond them")
    ] = (0.0, 0.0)
    elevation_range_rad: Annotated[tuple[Real, Real], Field(description="the same of e")] = (0.0, 0.0)
    sigma_rad: Annotated[Extent, Field(description="1 sigma of the elevation that is left, rad")] = 0.0
    anchors: Annotated[int, Field(ge=0, description="pointings it was fitted from")] = 0
    fitted_ns: Annotated[Ns, Field(description="when, Unix ns")] = 0


class UserProfile(Message):
    """Profile of the person: body measures, handedness, colour of the cursor."""

    version: ClassVar[int] = 3

    body: BodyMeasures = BodyMeasures()
    hand: Literal["left", "right"] = "right"
    cursor_color: Rgb = (255, 255, 255)
    cursor_width_m: Annotated[float, Field(gt=0, le=1, description="length lit on a strip")] = 0.1
    ray_model: Annotated[
        RayModel,
        Field(description="from the eyes through the fingertip, from the shoulder or from the elbow"),
    ] = "eye_finger"
    offset: Annotated[PointingOffset | None, Field(description="None if not calibrated")] = None
    cursor_colormap: Annotated[
        str, Field(max_length=32, description="of the cursor by distance, such as viridis, or empty")
    ] = ""
    pattern: Annotated[
        Literal["solid", "dashed", "dotted", "striped", "hollow", "tailed"],
        Field(description="mark of this person's things, besides the colour"),
    ] = "solid"


class Word(SchemaModel):
    """One spoken word."""

    text: Annotated[str, Field(min_length=1, max_length=64)]
    start_ns: Annotated[Ns, Field(description="its onset, Unix ns of the site's time")]
    end_ns: Ns
    confidence: Annotated[Fraction | None, Field(description="of the recogniser; None if unknown")] = None


class Speech(Message):
    """Words of one utterance of a person. `stamp_ns`: end of the last word, or the time of an empty one."""

    words: Annotated[tuple[Word, ...], Field(max_length=MAX_WORDS)] = ()
    is_final: Annotated[
        bool, Field(description="false: the recogniser may still change them; nothing is done yet")
    ] = True
    recogniser: Annotated[Id, Field(description="name of what recognised them")] = ""


class Referent(SchemaModel):
    """Something that a word may refer to."""

    kind: ReferentKind
    name: Annotated[Id, Field(description="of the thing, robot, object or person; of a place its surface")]
    probability: Fraction
    place_m: Annotated[Vec3 | None, Field(description="where it is, {W}; None of a direction")] = None


class Understood(Message):
    """Meaning of an utterance, and the result. `stamp_ns`: that of the speech."""

    text: Annotated[str, Field(max_length=4096, description="the words")]
    command: Annotated[Id, Field(description="verb of the command, or empty if it is none")] = ""
    referents: Annotated[Many[Referent], Field(description="of its words, in their order")] = ()
    result: Literal["done", "asked", "refused", "ignored"]
    message: Annotated[str, Field(description="result, in one sentence for a person")] = ""
