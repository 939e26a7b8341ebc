"""What stands in a map file: the ROS toolkit's `leds`, `strips`, `belts`, `links`; {W}, metres, z up."""

from typing import Annotated, Literal, cast

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.runtime.complaint import shown
from pointit.schemas import FARTHEST

MAX_PIXELS = 4096


def _number(value: object) -> float:
    if isinstance(value, str):  # YAML 1.1 takes 1e-3 for text
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= FARTHEST:
        raise ValueError
    return float(value)


def _point(value: object) -> Vec3:
    try:
        x, y, z = (_number(number) for number in cast("list[object]", value))
    except (TypeError, ValueError):
        raise ValueError(f"a point is three numbers [x, y, z] in metres, not {shown(value)}") from None
    return (x, y, z)


def _line(value: object) -> tuple[Vec3, ...]:
    if not isinstance(value, list):
        raise ValueError(f"a line is a list of points [x, y, z], not {shown(value)}")  # noqa: TRY004 - pydantic's
    vertices: list[Vec3] = []
    for index, vertex in enumerate(cast("list[object]", value)):
        try:
            vertices.append(_point(vertex))
        except ValueError as error:
            raise ValueError(f"vertex {index}: {error}") from None
    if len(vertices) < 2:
        raise ValueError(f"a line needs at least two points, not {len(vertices)}")
    try:
        Polyline(vertices)
    except ValueError:
        raise ValueError(f"a line needs two different points, all are {list(vertices[0])}") from None
    return tuple(vertices)


def _above_zero(value: object) -> float:
    try:
        number = _number(value)
    except ValueError:
        number = 0.0
    if number <= 0:
        raise ValueError(f"write a number of metres above 0, not {shown(value)}")
    return number


def _pixels(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value <= MAX_PIXELS:
        raise ValueError(f"write a whole number of pixels from 1 to {MAX_PIXELS}, not {shown(value)}")
    return value


def _direction(value: object) -> int:
    if isinstance(value, bool) or value not in (1, -1):
        raise ValueError(f"write 1, or -1 where pixel 0 sits at the line's last point, not {shown(value)}")
    return 1 if value == 1 else -1


_Point = Annotated[Vec3, BeforeValidator(_point)]
_Line = Annotated[tuple[Vec3, ...], BeforeValidator(_line)]
_Metres = Annotated[float, BeforeValidator(_above_zero)]
_Name = Annotated[str, BeforeValidator(str)]


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class LedEntry(_Entry):
    """A lamp."""

    position: _Point


class StripEntry(_Entry):
    """A strip; the `length` that the toolkit's files repeat is taken from the line instead."""

    line: _Line
    pixels: Annotated[int, BeforeValidator(_pixels)]
    direction: Annotated[Literal[1, -1], BeforeValidator(_direction)]
    length: _Metres | None = None


class BeltEntry(_Entry):
    """A belt; `length` as for strips."""

    centerline: _Line
    width: _Metres
    length: _Metres | None = None


class LinkEntry(_Entry):
    """Objects go from the end of one belt to the start of another."""

    source: Annotated[_Name, Field(alias="from")]
    target: Annotated[_Name, Field(alias="to")]


class MapFile(_Entry):
    """The file as a whole; {W}, metres, z up."""

    leds: dict[_Name, LedEntry] = {}
    strips: dict[_Name, StripEntry] = {}
    belts: dict[_Name, BeltEntry] = {}
    links: tuple[LinkEntry, ...] = ()
