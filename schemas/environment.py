"""The room: lamps, LED strips, belts, and what moves on them."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from pointit.schemas.base import (
    FARTHEST,
    Along,
    Count,
    Extent,
    Id,
    KeyName,
    KeyNameOrEmpty,
    Many,
    Message,
    Name,
    Ns,
    QuaternionXyzw,
    Real,
    Rgb,
    SchemaModel,
    UnitVec3,
    Vec3,
)
from pointit.schemas.pointing import SurfaceKind

Line = Annotated[Many[Vec3], Field(min_length=2)]
"""A polyline, vertices in {W}, metres."""
Size = Annotated[float, Field(gt=0, le=FARTHEST)]

ThingMode = Literal["claim", "button", "switch"]
"""Effect of selecting an object. `claim`: it is the person's, until they deselect it. `button`: something
happens each time, for anybody. `switch`: it is on until anybody switches it off."""

DwellS = Annotated[
    float | None, Field(gt=0, le=10, description="time on it that selects it, s; the method's if empty")
]

BESIDE_BELT_M = 0.1
"""Strip pixels up to this distance beside a belt's edge show objects on the belt."""
KIND_COLORS: dict[str, Rgb] = {
    "red": (255, 30, 0),
    "green": (0, 158, 80),
    "blue": (0, 80, 220),
    "yellow": (240, 200, 20),
    "orange": (230, 120, 0),
    "purple": (190, 80, 170),
}
"""Colours of the kinds of objects, on strips and in viewers, unless configured otherwise.

Near Okabe and Ito's colours, distinguishable by colour-blind people. More saturated, as LEDs wash out.
"""

OTHER_COLOR: Rgb = (200, 200, 200)
"""Colour of any other kind."""


class Lamp(SchemaModel):
    """A single light at a known place; target of localizations."""

    id: Name
    position_m: Vec3


class Strip(SchemaModel):
    """An LED strip along a polyline."""

    id: Id
    line_m: Line
    pixels: Annotated[int, Field(gt=0, le=4096)]
    direction: Annotated[Literal[1, -1], Field(description="-1: pixel 0 sits at the line's last vertex")] = 1


class Belt(SchemaModel):
    """A conveyor belt along its centre line."""

    id: Id
    line_m: Line
    width_m: Annotated[float, Field(gt=0, le=FARTHEST)] = 0.5


class BeltLink(SchemaModel):
    """One belt hands its objects over to another; where several leave at one place, a diverter chooses."""

    source: Id
    target: Id
    source_position_m: Annotated[
        Along | None, Field(description="arc length on `source` where they leave it; None for its end")
    ] = None
    target_position_m: Annotated[Along, Field(description="arc length on `target` where they enter it")] = 0.0


class Bay(SchemaModel):
    """The end of a belt, where objects leave the conveyor."""

    id: Name
    belt: Id


class Box(SchemaModel):
    """A box that stands upright."""

    id: Name
    center_m: Vec3
    size_m: Annotated[tuple[Size, Size, Size], Field(description="along its own x, y and z")]
    yaw_rad: Annotated[Real, Field(description="of its x axis in {W}")] = 0.0


class Plane(SchemaModel):
    """A flat thing that is seen from both sides: a floor, a wall, a table, a screen.

    Its v axis is the one in the plane that rises most (y where the plane is level), u is v x normal.
    """

    id: Name
    center_m: Vec3
    normal: UnitVec3
    size_m: Annotated[tuple[Size, Size] | None, Field(description="along u and v; None if unbounded")] = None


class Cylinder(SchemaModel):
    """An upright cylinder: a column, a tank."""

    id: Name
    center_m: Annotated[Vec3, Field(description="of its foot")]
    radius_m: Size
    height_m: Size


class Sphere(SchemaModel):
    """A ball."""

    id: Name
    center_m: Vec3
    radius_m: Size


class Cloud(SchemaModel):
    """A point cloud, read from a file by the process that casts rays. The points are not in the message."""

    id: Name
    points: Count
    low_m: Annotated[Vec3, Field(description="least x, y, z")]
    high_m: Annotated[Vec3, Field(description="greatest x, y, z")]


class Fence(SchemaModel):
    """An upright volume for robots: each stays inside every `keep_in`, and outside every `keep_out`."""

    id: Name
    kind: Literal["keep_in", "keep_out"]
    outline_m: Annotated[
        Many[tuple[Real, Real]],
        Field(min_length=3, description="x, y of its corners in {W}, in either order; it closes itself"),
    ]
    low_m: Annotated[Real | None, Field(description="least height in {W}, None if unbounded")] = None
    high_m: Annotated[Real | None, Field(description="greatest height in {W}, None if unbounded")] = None


class Thing(Box):
    """A place in the room that reacts when somebody points at it: a box, with a light if it has one.

    `pui` lists all things of the map as tracked objects of the tracker `things`, by which they are selected.
    """

    label: Annotated[Id, Field(description="its name in messages to people; if empty, the id")] = ""
    mode: ThingMode = "button"
    press: Annotated[bool, Field(description="pointing at it is not enough: the person presses, too")] = False
    dwell_s: DwellS = None
    lamp: Annotated[Id, Field(description="single light that shows its state, or empty")] = ""
    strip: Annotated[Id, Field(description="strip a part of which shows its state, or empty")] = ""
    part_m: Annotated[tuple[Along, Along], Field(description="arc lengths of that part, from and to")] = (
        0.0,
        0.0,
    )
    is_tracked: Annotated[bool, Field(description="the tracked object of this id, wherever that is")] = False
    home_assistant: Annotated[
        str, Field(max_length=2000, description="entity there, or JSON: entity, action, data")
    ] = ""

    @property
    def object_fields(self) -> dict[str, Any]:
        """Fields of `TrackedObject` that the thing sets in its tracked object."""
        own = self.model_dump(include={"mode", "press", "dwell_s"})
        kind = self.label or self.id
        is_lit = bool(self.lamp or self.strip)
        return own | {"kind": kind, "lit": is_lit}


class Frame(SchemaModel):
    """The coordinates of a tracker, or of a robot: where their origin is in {W}, and their rotation."""

    id: Name
    position_m: Annotated[Vec3, Field(description="of its origin in {W}")]
    orientation_xyzw: Annotated[
        QuaternionXyzw, Field(description="rotates vectors of the frame into {W}")
    ] = (0.0, 0.0, 0.0, 1.0)


class PacedPlace(SchemaModel):
    """A place on the floor from which things of the map were pointed at."""

    id: Id
    position_m: Annotated[tuple[Real, Real], Field(description="{W}")]


class Environment(Message):
    """The map of the room in {W}; the ROS toolkit's `belts`, `leds`, `strips`, `links`, and more."""

    version: ClassVar[int] = 7

    max_bytes: ClassVar[int] = 1024 * 1024
    """Room for 10 000 strips."""

    name: Id
    lamps: Many[Lamp] = ()
    strips: Many[Strip] = ()
    belts: Many[Belt] = ()
    links: Many[BeltLink] = ()
    bays: Many[Bay] = ()
    boxes: Many[Box] = ()
    planes: Many[Plane] = ()
    cylinders: Many[Cylinder] = ()
    spheres: Many[Sphere] = ()
    clouds: Many[Cloud] = ()
    fences: Many[Fence] = ()
    frames: Many[Frame] = ()
    things: Many[Thing] = ()
    paced_from: Annotated[
        Many[PacedPlace],
        Field(
            description="places of a map without measured lengths: directions from them, and from between "
            "two, are known better than positions; empty if it was measured"
        ),
    ] = ()

    @property
    def fixed_things(self) -> tuple[Thing, ...]:
        """Things that have a place in the room: all but tracked objects."""
        return tuple(thing for thing in self.things if not thing.is_tracked)


class TrackedObject(SchemaModel):
    """An object with a known position: a package, a segment, a robot."""

    id: Id
    kind: Id
    position_m: Annotated[Vec3, Field(description="its centre at the message's stamp, {W}")]
    velocity_mps: Annotated[Vec3, Field(description="{W}")] = (0.0, 0.0, 0.0)
    length_m: Annotated[Extent, Field(description="extent along its surface, or diameter")] = 0.0
    surface: SurfaceKind = "none"
    surface_id: Id = ""
    surface_position_m: Annotated[Along, Field(description="arc length of its centre on the surface")] = 0.0
    surface_speed_mps: Annotated[Real, Field(description="along the surface, signed")] = 0.0
    bay: Annotated[Id, Field(description="its destination; empty if undecided or none")] = ""
    bay_until_ns: Annotated[
        Ns | None,
        Field(
            description="until then, at the present speeds, (de)selecting it changes its bay; 0: it is too "
            "late; None if no limit is known"
        ),
    ] = None
    yaw_rad: Annotated[Real | None, Field(description="azimuth of its front, if it has one")] = None
    position_sigma_m: Annotated[
        Extent | None, Field(description="1 sigma of the position along the worst direction, if known")
    ] = None
    size_m: Annotated[
        tuple[Size, Size, Size] | None,
        Field(description="of its upright box, turned by `yaw_rad`; only its length counts if empty"),
    ] = None
    mode: ThingMode = "claim"
    press: Annotated[bool, Field(description="selected by pressing while pointing at it only")] = False
    dwell_s: DwellS = None
    lit: Annotated[bool, Field(description="a light shows people that they point at it")] = False


class TrackedObjects(Message):
    """All tracked objects of one tracker at one time. An object that is no longer listed has left."""

    version: ClassVar[int] = 5

    max_bytes: ClassVar[int] = 640 * 1024
    """Room for 2000 objects with all fields."""

    objects: Many[TrackedObject] = ()
    latency_sigma_s: Annotated[
        Extent | None,
        Field(description="1 sigma of the time from `stamp_ns` to that of the positions; None if unknown"),
    ] = None


class BeltSpeed(SchemaModel):
    """The speed of one belt."""

    id: Id
    speed_mps: Real


class BayCount(SchemaModel):
    """Counts of the objects that came out at a bay."""

    bay: Annotated[Id, Field(description="empty: at the end of a belt without a bay")]
    kind: Id
    count: Count
    selected: Annotated[Count, Field(description="number of selected ones among them")] = 0


class Departure(SchemaModel):
    """An object that came out at a bay."""

    object_id: Id
    stamp_ns: Ns
    bay: Annotated[Id, Field(description="empty for a belt's end")] = ""
    user: Annotated[KeyNameOrEmpty, Field(description="person for whom it was sent there, or empty")] = ""


class ConveyorState(Message):
    """The state of the conveyor."""

    version: ClassVar[int] = 4

    speed_mps: Annotated[Real, Field(description="0: it stands still; negative: backwards")]
    fed: Annotated[int, Field(ge=0, description="objects put on the conveyor so far")] = 0
    left: Annotated[int, Field(ge=0, description="objects that reached the end of their lane")] = 0
    belts: Annotated[Many[BeltSpeed], Field(description="those with a speed of their own")] = ()
    bays: Many[BayCount] = ()
    refused: Annotated[Count, Field(description="selections that came past the point of no return")] = 0
    step: Annotated[Id, Field(description="of a feeding schedule, or empty; `end`: nothing more is fed")] = ""
    feeding: Annotated[bool, Field(description="false while the feeders are stopped")] = True
    departures: Annotated[
        Many[Departure], Field(description="the latest objects that left and were selected, oldest first")
    ] = ()


class LampColor(Message):
    """The colour of a single lamp. Black is off."""

    color: Rgb


class LampLease(SchemaModel):
    """One person's place in the queue for lamps."""

    user: KeyName
    since_ns: Annotated[Ns, Field(description="`since_ns` of their localization, which is their place")]
    lamps: Many[KeyName]
    ahead: Annotated[
        Many[KeyName],
        Field(description="people who come first; if empty, the lamps are theirs until they end"),
    ] = ()


class LampLeases(Message):
    """People who use lamps to localize or wait for them, in order. led-driver decides."""

    max_bytes: ClassVar[int] = 1024 * 1024
    """Room for 64 people who wait for the 500 lamps of a large room."""

    leases: Many[LampLease] = ()


class StripFrame(SchemaModel):
    """The pixels of one strip."""

    id: Id
    rgb: Annotated[bytes, Field(description="3 bytes a pixel, red green blue, pixel 0 first")]


class StripsFrame(Message):
    """The pixels of every strip; `stamp_ns`: when the newest cursor new in it was captured, else its own."""

    version: ClassVar[int] = 2
    max_bytes: ClassVar[int] = 1024 * 1024
    """Room for 64 strips of 4096 pixels, all that one expander drives."""

    strips: Many[StripFrame]
    light_s: Annotated[
        Extent,
        Field(
            description="from this message to the light of the slowest controller that changes, as measured "
            "at the last change, wall time"
        ),
    ] = 0.0
