"""The wire between the site and a page whose camera maps the room: `POST /scan`, a JSON object each way.

The page leads: it asks for each step of the lights (`ScanLight`, answered when they are sent to the
controllers), and sends image positions of the lights once it has read all steps (`ScanView`). Which colours
tell the lights apart is known to the page alone (`client/src/scan/code.ts`). Pictures never
leave the page. All but `ScanLight` are answered with `ScanState`, refusals with status 409 and a sentence.
"""

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from pointit.bridges.web.wire import WireModel
from pointit.schemas.base import Fraction, Vec3

ImagePosition = Annotated[float, Field(ge=-20_000, le=20_000)]
ImageSize = Annotated[int, Field(ge=16, le=16_384)]

MAX_SIGHTINGS = 2000
"""Limit of the sightings of one view; a body of a post has room for as many."""

MAX_LIGHTS = 4096

LightIndex = Annotated[int, Field(ge=0, lt=MAX_LIGHTS)]


class ScanBegin(WireModel):
    """Begin, or begin again: all views are forgotten."""

    kind: Literal["begin"] = "begin"
    leds_per_m: dict[str, Annotated[float, Field(gt=1, le=1000)]] = Field(
        default_factory=dict[str, float], max_length=256, description="by strip; empty if unknown"
    )
    known_strip: Annotated[str, Field(max_length=64, description="a strip of known length, or empty")] = ""
    known_m: Annotated[float | None, Field(gt=0, le=100, description="from its first to its last pixel")] = (
        None
    )
    has_lamps: Annotated[bool, Field(description="true if the lamps of the map blink, too")] = True


class ScanLight(WireModel):
    """Show the lights in colours for a while, or give them back if there are none."""

    kind: Literal["light"] = "light"
    colors: Annotated[
        tuple[Annotated[int, Field(ge=0, le=2)], ...] | None,
        Field(
            max_length=MAX_LIGHTS,
            description="0 red, 1 green, 2 blue, of each of `ScanState.lights`; empty if all are dark",
        ),
    ] = None
    brightness: Fraction = 1.0


class ScanView(WireModel):
    """A view: lights by their index in `ScanState.lights`, and image positions, pixels right and down."""

    kind: Literal["view"] = "view"
    width: ImageSize
    height: ImageSize
    seen: Annotated[
        tuple[tuple[LightIndex, ImagePosition, ImagePosition], ...], Field(max_length=MAX_SIGHTINGS)
    ]
    gravity: Annotated[
        Vec3 | None, Field(description="unit vector of down; x right, y down, z ahead in the picture")
    ] = None


class ScanUndo(WireModel):
    """Forget the last view."""

    kind: Literal["undo"] = "undo"


class ScanThing(WireModel):
    """A thing by its corners, or none to forget it: each in two views or more, view (from 0) and position.

    A box: three corners of its top, one after the other, and one of its foot. Others: three corners.
    """

    kind: Literal["thing"] = "thing"
    name: Annotated[str, Field(min_length=1, max_length=64)]
    shape: Literal["box", "screen", "table"] = "box"
    corners: Annotated[
        tuple[
            Annotated[
                tuple[tuple[Annotated[int, Field(ge=0, lt=64)], ImagePosition, ImagePosition], ...],
                Field(min_length=2, max_length=8),
            ],
            ...,
        ],
        Field(max_length=4),
    ] = ()


class ScanSave(WireModel):
    """Write the map: x from the first to the last pixel of `origin`, z = 0 at the lowest light."""

    kind: Literal["save"] = "save"
    name: Annotated[str, Field(max_length=64, description="of the file, without a folder")]
    origin: Annotated[str, Field(max_length=64, description="strip, or empty for any")] = ""


class ScanLook(WireModel):
    """Ask for the state."""

    kind: Literal["look"] = "look"


ScanMessage = Annotated[
    ScanBegin | ScanLight | ScanView | ScanUndo | ScanThing | ScanSave | ScanLook, Field(discriminator="kind")
]
SCAN_MESSAGE: TypeAdapter[ScanBegin | ScanLight | ScanView | ScanUndo | ScanThing | ScanSave | ScanLook] = (
    TypeAdapter(ScanMessage)
)


class ScanStrip(WireModel):
    """A strip, its line as far as it is known; or a lamp: one pixel, a line of one point.

    Or a thing that was tapped: no pixels, a line of its corners.
    """

    name: str
    pixels: int
    leds_per_m: Annotated[float | None, Field(description="in the map in use, which may be wrong")] = None
    line_m: Annotated[tuple[Vec3, ...], Field(description="from the first pixel on; empty if unknown")] = ()
    sigma_m: Annotated[float | None, Field(description="of its worse end; empty if unknown")] = None
    seen: Annotated[int, Field(description="number of views that show it")] = 0
    reason: Annotated[str, Field(description="why it is unknown; empty if it is known")] = ""


class ScanState(WireModel):
    """State of the scan."""

    kind: Literal["scan"] = "scan"
    strips: tuple[ScanStrip, ...]
    lights: Annotated[tuple[tuple[str, int], ...], Field(description="strip and pixel of each marked light")]
    cameras_m: Annotated[tuple[Vec3, ...], Field(description="of the views that could be placed")] = ()
    views: Annotated[int, Field(description="taken so far")] = 0
    is_solving: bool = False
    is_complete: Annotated[bool, Field(description="both ends of every strip are known to 1 cm")] = False
    advice: str = ""
    next_m: Annotated[
        Vec3 | None, Field(description="place of the camera for the next view; empty if none is advised")
    ] = None
    problem: str = ""
    is_simulated: bool = False
    file: Annotated[str, Field(description="suggested name of the map")] = ""
    saved: Annotated[str, Field(description="path of the written map as pages show it; empty if none")] = ""


class ScanRoomStrip(WireModel):
    """A strip, or a lamp of one pixel, as a simulated camera sees it."""

    name: str
    places_m: Annotated[tuple[Vec3, ...], Field(description="of its pixels")]


class ScanRoom(WireModel):
    """The room of a simulated camera."""

    strips: tuple[ScanRoomStrip, ...]
    places_m: Annotated[tuple[Vec3, ...], Field(description="places from which the camera looks, in turn")]


MODELS = (ScanBegin, ScanLight, ScanView, ScanUndo, ScanThing, ScanSave, ScanLook, ScanState, ScanRoom)
