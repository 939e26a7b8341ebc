"""The room: lamps, LED strips, belts, and what moves on them."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pointit.schemas.base import FARTHEST, Along, Extent, Many, Message, Name, Part, Real, Rgb, Vec3
from pointit.schemas.pointing import SurfaceKind

Line = Annotated[Many[Vec3], Field(min_length=2)]
"""A polyline, vertices in {W}, metres."""


class Lamp(Part):
    """A single light at a known place; target of localizations."""

    id: Name
    position_m: Vec3


class Strip(Part):
    """An LED strip along a polyline."""

    id: str
    line_m: Line
    pixels: Annotated[int, Field(gt=0, le=4096)]
    direction: Annotated[Literal[1, -1], Field(description="-1: pixel 0 sits at the line's last vertex")] = 1


class Belt(Part):
    """A conveyor belt along its centre line."""

    id: str
    line_m: Line
    width_m: Annotated[float, Field(gt=0, le=FARTHEST)] = 0.5


class BeltLink(Part):
    """One belt hands its objects over to the next."""

    source: str
    target: str


class Environment(Message):
    """The map of the room in {W}; the ROS toolkit's `belts`, `leds`, `strips`, `links`."""

    max_bytes: ClassVar[int] = 1024 * 1024
    """Room for 10 000 strips."""

    name: str
    lamps: Many[Lamp] = ()
    strips: Many[Strip] = ()
    belts: Many[Belt] = ()
    links: Many[BeltLink] = ()


class TrackedObject(Part):
    """A thing whose place is known: a package, a segment, a robot."""

    id: str
    kind: str
    position_m: Annotated[Vec3, Field(description="its centre at the message's stamp, {W}")]
    velocity_mps: Annotated[Vec3, Field(description="{W}")] = (0.0, 0.0, 0.0)
    length_m: Annotated[Extent, Field(description="extent along its surface, or diameter")] = 0.0
    surface: SurfaceKind = "none"
    surface_id: str = ""
    surface_position_m: Annotated[Along, Field(description="arc length of its centre on the surface")] = 0.0
    surface_speed_mps: Annotated[Real, Field(description="along the surface, signed")] = 0.0


class TrackedObjects(Message):
    """All tracked objects of one tracker at one time; an object that is no longer listed has left."""

    max_bytes: ClassVar[int] = 512 * 1024
    """Room for 2000 objects with all fields."""

    objects: Many[TrackedObject] = ()


class ConveyorState(Message):
    """What the conveyor does."""

    speed_mps: Annotated[Real, Field(description="0: it stands still; negative: backwards")]
    fed: Annotated[int, Field(ge=0, description="objects put on the conveyor so far")] = 0
    left: Annotated[int, Field(ge=0, description="objects that reached the end of their lane")] = 0


class LampColor(Message):
    """What a single lamp shows; black is off."""

    color: Rgb


class StripFrame(Part):
    """The pixels of one strip."""

    id: str
    rgb: Annotated[bytes, Field(description="3 bytes a pixel, red green blue, pixel 0 first")]


class StripsFrame(Message):
    """The pixels of every strip; `stamp_ns`: when the newest cursor new in it was captured, else its own."""

    max_bytes: ClassVar[int] = 1024 * 1024
    """Room for 64 strips of 4096 pixels, all that one expander drives."""

    strips: Many[StripFrame]
