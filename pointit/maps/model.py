"""Content of a map file: the sections of the ROS toolkit with additions. {W}, metres, z up."""

import json
import math
import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, NamedTuple, Self, cast, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from pointit.geometry.floor_area import Polygon, Vec2
from pointit.geometry.polyline import SAME_M, Polyline
from pointit.geometry.rotation import Quaternion, from_yaw
from pointit.geometry.rotation import normalized as normalized_quaternion
from pointit.geometry.vector import Vec3, norm, normalized
from pointit.maps.units import LENGTHS_M, UP_AXES, size_of_unit
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.config.yaml_file import FLAGS, WrittenInt, written_text
from pointit.schemas import FARTHEST
from pointit.schemas.environment import ThingMode
from pointit.schemas.printable import is_printable

MAX_PIXELS = 4096
MIN_AREA_M2 = 1e-4
MAX_LABEL = 64
MAX_ORIGIN = 1e9
"""Largest coordinate of a survey, in any unit."""
HOME_ENTITY = re.compile(r"[a-z0-9_]+\.[a-z0-9_]+")
MAX_HOME_ACTION = 2000
HOME_DOMAINS = re.compile(
    "automation|button|climate|cover|fan|group|humidifier|input_boolean|input_button|light|lock|media_player|"
    "remote|scene|script|siren|switch|vacuum|valve|water_heater"
)
"""Kinds of entities of Home Assistant that are switched or run. Others need an action."""
OBJECT = "object"
"""Place of a thing that is the tracked object of its name."""

_TEXT = BeforeValidator(written_text)


def _as(convert: Callable[[Any], Any], wanted: str) -> Callable[[object], Any]:
    """Return a function that converts a value, or raises `WANTED, not VALUE` if `convert` fails."""

    def check(value: object) -> Any:
        try:
            return convert(value)
        except (KeyError, TypeError, ValueError):
            raise ValueError(f"{wanted}, not {format_value(value)}") from None

    return check


def _if(is_valid: Callable[[Any], bool], wanted: str) -> BeforeValidator:
    """Return a validator that raises `write WANTED, not VALUE` unless `is_valid` of the value."""

    def check(value: object) -> object:
        if not is_valid(value):
            raise ValueError
        return value

    return BeforeValidator(_as(check, f"write {wanted}"))


def _number(value: object) -> float:
    if isinstance(value, str):  # YAML 1.1 reads 1e-3 as text
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError  # noqa: TRY004 - pydantic's
    if not abs(value) <= FARTHEST:
        raise ValueError
    return float(value)


def _above_zero(value: object) -> float:
    number = _number(value)
    if number <= 0:
        raise ValueError
    return number


def _several(count: int, convert: Callable[[Any], float] = _number) -> Callable[[Any], tuple[float, ...]]:
    """Return a function that converts a list of `count` numbers."""

    def converted(value: Any) -> tuple[float, ...]:
        numbers = tuple(map(convert, value))
        if len(numbers) != count:
            raise ValueError
        return numbers

    return converted


def _coordinate(value: Any) -> float:
    """Return a coordinate of a survey."""
    number = float(value)
    if not abs(number) <= MAX_ORIGIN:
        raise ValueError
    return number


def _sizes(count: int) -> BeforeValidator:
    wanted = f"write {count} sizes in metres, all above 0"
    return BeforeValidator(_as(_several(count, _above_zero), wanted))


def _finite(unit: str) -> BeforeValidator:
    return BeforeValidator(_as(_number, f"write a number of {unit}"))


_point = _as(_several(3), f"a point is three numbers [x, y, z] in metres, up to {FARTHEST:g}")


def _corner_tuple(value: Any) -> tuple[tuple[float, ...], ...]:
    return tuple(map(_several(2), value))


_corners = _as(_corner_tuple, "an outline is a list of corners [x, y] in metres")


def _line(value: object) -> tuple[Vec3, ...]:
    if not isinstance(value, list):
        raise ValueError(f"a line is a list of points [x, y, z], not {format_value(value)}")  # noqa: TRY004 - pydantic's
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


def _outline(value: object) -> tuple[Vec2, ...]:
    corners = _corners(value)
    if len(corners) < 3:
        raise ValueError(f"an outline needs at least three corners [x, y], not {len(corners)}")
    outline = Polygon(corners)
    crossing = outline.crossing()
    if crossing is not None:
        first, second = crossing
        raise ValueError(
            f"the outline crosses itself: the edges from corner {first} and corner {second} meet; "
            "list the corners in order around the area"
        )
    if outline.area_m2 < MIN_AREA_M2:
        raise ValueError("the outline has no area inside; give its corners in metres")
    return corners


def _normal(value: object) -> Vec3:
    normal = _point(value)
    if norm(normal) < SAME_M:
        raise ValueError(f"a normal points away from the plane, {format_value(value)} has no direction")
    return normalized(normal)


def _text(value: object) -> str:
    name = written_text(value)
    if not isinstance(name, str):
        raise TypeError
    return name


def _is_home_entity(value: object) -> bool:
    return isinstance(value, str) and HOME_ENTITY.fullmatch(value) is not None


def _is_home_action(fields: Mapping[str, Any]) -> bool:
    if fields.keys() - {"entity", "action", "data"} or not isinstance(fields.get("data", {}), dict):
        return False
    return _is_home_entity(fields.get("entity")) and _is_home_entity(fields.get("action"))


def _home_action(value: Any) -> str:
    """Return an entity of Home Assistant, or its entity, action and data as JSON."""
    if isinstance(value, dict):
        is_valid = _is_home_action(cast("dict[str, Any]", value))
    else:
        is_valid = _is_home_entity(value)
    if not is_valid:
        raise ValueError(
            "write an entity of Home Assistant, such as light.desk, or {entity: light.desk, action: "
            f"light.turn_on, data: {{brightness_pct: 40}}}}, not {format_value(cast('object', value))}"
        )
    if isinstance(value, dict):
        text = json.dumps(value, allow_nan=False)
    else:
        # Without an action, the kind of the entity must tell what to do
        text = str(value)
        domain = text.partition(".")[0]
        if not HOME_DOMAINS.fullmatch(domain):
            raise ValueError(
                f"{text} is neither switched nor run; write {{entity: {text}, action: DOMAIN.ACTION}}, "
                f"or an entity of {join_names(HOME_DOMAINS.pattern.split('|'))}"
            )
    if len(text) > MAX_HOME_ACTION:
        raise ValueError(f"{len(text)} characters, limit {MAX_HOME_ACTION}; make it a script there")
    return text


class LinePart(NamedTuple):
    """A part of a strip or belt, arc lengths from its first point."""

    line: str
    start: float
    end: float


def _part(kind: str, name: str, is_name: Callable[[object], bool]) -> BeforeValidator:
    """Return a validator of a part of a line of `kind`, or what `name` describes, if `is_name`."""

    def convert(value: Any) -> str | LinePart:
        if not isinstance(value, dict) and is_name(value):
            return _text(value)
        part = cast("dict[str, object]", value)
        if len(part) != 3:
            raise ValueError
        return LinePart(_text(part[kind]), _number(part["from"]), _number(part["to"]))

    wanted = f"write {name}, or a part of a {kind} as {{{kind}: NAME, from: METRES, to: METRES}}"
    return BeforeValidator(_as(convert, wanted))


_Point = Annotated[Vec3, BeforeValidator(_point)]
_Line = Annotated[tuple[Vec3, ...], BeforeValidator(_line)]
_Metres = Annotated[float, BeforeValidator(_as(_above_zero, "write a number of metres above 0"))]
_Along = Annotated[float, _finite("metres along the belt")]
_Degrees = Annotated[float, _finite("degrees")]
_Height = Annotated[float, _finite("metres above the floor")]
_Name = Annotated[str, BeforeValidator(_as(_text, "write the name of a belt"))]
_ROTATION = BeforeValidator(
    _as(
        lambda value: normalized_quaternion(cast("Quaternion", _several(4)(value))),
        "a rotation is a quaternion [x, y, z, w] that is not zero",
    )
)
_UNIT = BeforeValidator(
    _as(
        lambda value: size_of_unit(str(value), LENGTHS_M),
        f"write one of {join_names(LENGTHS_M)}, or a number of metres",
    )
)
_ORIGIN = BeforeValidator(_as(_several(3, _coordinate), "write a point of the file, [x, y, z] in its unit"))
_KIND = _if(
    lambda value: value in ("keep_in", "keep_out"),
    "keep_in (robots stay inside) or keep_out (they stay outside)",
)
_FILE = _if(
    lambda value: isinstance(value, str) and value != "" and "\0" not in value,
    "the path of a .ply or .xyz file, relative to the map",
)
_COLUMNS = _if(
    lambda value: (
        isinstance(value, dict)
        and cast("dict[object, object]", value).keys() == {"x", "y", "z"}
        and {type(each) for each in cast("dict[object, object]", value).values()} <= {int, WrittenInt, str}
    ),
    "the columns of x, y and z by their names, or numbers from 1, such as {x: easting, y: 2, z: 3}",
)
_UP = _if(lambda value: value in UP_AXES, f"the axis that points up, one of {', '.join(UP_AXES)}")
_PIXELS = _if(
    lambda value: type(value) in (int, WrittenInt) and 0 < value <= MAX_PIXELS,
    f"a whole number of pixels from 1 to {MAX_PIXELS}",
)
_OFFSET = _if(
    lambda value: value is None or (type(value) in (int, WrittenInt) and 0 <= value < 2**18),
    "the number of the strip's first pixel on the wire, from 0",
)
_DIRECTION = _if(
    lambda value: not isinstance(value, bool) and value in (1, -1),
    "1, or -1 where pixel 0 sits at the line's last point",
)
_MODE = _if(lambda value: value in get_args(ThingMode), "claim, button or switch")
_LIGHT = _part("strip", "the name of a lamp", lambda _: True)
_AT = _part("belt", "object, for the tracked object of that name", lambda value: value == OBJECT)
_FLAG = _if(lambda value: isinstance(value, bool | str) and str(value).lower() in FLAGS, "true or false")
_DWELL = _if(
    lambda value: isinstance(value, int | float) and not isinstance(value, bool) and 0.1 <= value <= 10,
    "a number of seconds from 0.1 to 10",
)
_LABEL = _if(
    lambda value: isinstance(value, str) and 0 < len(value) <= MAX_LABEL and is_printable(value),
    f"a name of at most {MAX_LABEL} letters for people, on one line and without control characters",
)


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class LampEntry(_Entry):
    """A lamp."""

    position: _Point


class StripEntry(_Entry):
    """A strip. The `length` that the toolkit's files repeat is ignored in favour of the line's."""

    line: _Line
    pixels: Annotated[int, _PIXELS]
    direction: Annotated[Literal[1, -1], _DIRECTION] = 1
    length: _Metres | None = None
    offset: Annotated[int | None, _OFFSET] = None


class BeltEntry(_Entry):
    """A belt. `length` as for strips."""

    centerline: _Line
    width: _Metres
    length: _Metres | None = None


class LinkEntry(_Entry):
    """Objects move from one belt to another. Without positions, from its end to the other's start."""

    source: Annotated[_Name, Field(alias="from")]
    target: Annotated[_Name, Field(alias="to")]
    from_position: _Along | None = None
    to_position: _Along = 0.0


class FrameEntry(_Entry):
    """Coordinates of a tracker: turned by `yaw_deg` about z, or by `orientation`, plus `position`."""

    position: _Point = (0.0, 0.0, 0.0)
    yaw_deg: _Degrees | None = None
    orientation: Annotated[Quaternion, _ROTATION] | None = None

    @model_validator(mode="after")
    def _is_turned_once(self) -> Self:
        if self.yaw_deg is not None and self.orientation is not None:
            raise ValueError("has both yaw_deg and orientation; keep one of them")
        return self

    @property
    def orientation_xyzw(self) -> Quaternion:
        """Return the rotation of its vectors into {W}."""
        return self.orientation or from_yaw(math.radians(self.yaw_deg or 0.0))


class BoxEntry(_Entry):
    """An upright box. `size` along its own x, y, z."""

    center: _Point
    size: Annotated[Vec3, _sizes(3)]
    yaw_deg: _Degrees = 0.0

    @property
    def yaw_rad(self) -> float:
        """Return the azimuth of its x axis."""
        return math.radians(self.yaw_deg)


class PlaneEntry(_Entry):
    """A wall or a table. Without `size` it is unbounded."""

    center: _Point
    normal: Annotated[Vec3, BeforeValidator(_normal)]
    size: Annotated[tuple[float, float], _sizes(2)] | None = None


class CylinderEntry(_Entry):
    """An upright cylinder. `center` is that of its foot."""

    center: _Point
    radius: _Metres
    height: _Metres


class SphereEntry(_Entry):
    """A sphere."""

    center: _Point
    radius: _Metres


class CloudEntry(_Entry):
    """Points of a file: less `origin`, times `unit`, `up` to z, rotated by `yaw_deg`, plus `position`."""

    file: Annotated[str, _FILE]
    columns: Annotated[dict[str, str | int], _COLUMNS] = {"x": "x", "y": "y", "z": "z"}
    unit: Annotated[float, _UNIT] = 1.0
    up: Annotated[str, _UP] = "z"
    origin: Annotated[Vec3, _ORIGIN] = (0.0, 0.0, 0.0)
    yaw_deg: _Degrees = 0.0
    position: _Point = (0.0, 0.0, 0.0)


class ThingEntry(_Entry):
    """Something that reacts when people point at it. Without `center` and `at` it is where its light is."""

    center: _Point | None = None
    size: Annotated[Vec3, _sizes(3)] | None = None
    yaw_deg: _Degrees = 0.0
    light: Annotated[str | LinePart, _LIGHT] | None = None
    mode: Annotated[ThingMode, _MODE] = "button"
    press: Annotated[bool, _FLAG] = False
    dwell_s: Annotated[float, _DWELL] | None = None
    label: Annotated[str, _LABEL, _TEXT] = ""
    at: Annotated[str | LinePart, _AT] | None = None
    home_assistant: Annotated[str, BeforeValidator(_home_action)] = ""

    @property
    def yaw_rad(self) -> float:
        """Return the azimuth of its x axis."""
        return math.radians(self.yaw_deg)

    @model_validator(mode="after")
    def _is_somewhere(self) -> Self:
        has_box = self.center is not None or self.size is not None
        if self.at is not None and (has_box or self.yaw_deg):
            raise ValueError("has at, which says where it is; remove its center, size and yaw_deg")
        if self.at == OBJECT and isinstance(self.light, LinePart):
            raise ValueError("is a tracked object, which has a lamp as its light or none; change light")

        # A thing of Home Assistant needs no place: it may get one later
        has_place = self.center is not None or self.at is not None
        has_effect = self.light is not None or bool(self.home_assistant)
        if not has_place and not has_effect:
            raise ValueError("is nowhere; give its center and size, or a light")
        if self.center is not None and self.size is None:
            raise ValueError("has no size; add it, three sizes in metres")
        return self


class FenceEntry(_Entry):
    """A volume for robots, upright over `outline`; without `low` or `high` it has no end there."""

    kind: Annotated[Literal["keep_in", "keep_out"], _KIND]
    outline: Annotated[tuple[Vec2, ...], BeforeValidator(_outline)]
    low: _Height | None = None
    high: _Height | None = None

    @model_validator(mode="after")
    def _has_height(self) -> Self:
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low is {self.low:g} m and high {self.high:g} m; low must be below high")
        return self


class PlaceEntry(_Entry):
    """A place on the floor from which lamps of the map were pointed at; see `scan/paced.py`."""

    position: Vec2


class MapFile(_Entry):
    """The whole file. {W}, metres, z up."""

    lamps: dict[_Name, LampEntry] = {}
    strips: dict[_Name, StripEntry] = {}
    belts: dict[_Name, BeltEntry] = {}
    links: tuple[LinkEntry, ...] = ()
    bays: dict[_Name, _Name] = {}
    frames: dict[_Name, FrameEntry] = {}
    boxes: dict[_Name, BoxEntry] = {}
    planes: dict[_Name, PlaneEntry] = {}
    cylinders: dict[_Name, CylinderEntry] = {}
    spheres: dict[_Name, SphereEntry] = {}
    clouds: dict[_Name, CloudEntry] = {}
    fences: dict[_Name, FenceEntry] = {}
    things: dict[_Name, ThingEntry] = {}
    paced_from: dict[_Name, PlaceEntry] = {}


ENTRIES: dict[str, type[BaseModel]] = {
    section: entry
    for section, field in MapFile.model_fields.items()
    for entry in get_args(field.annotation)
    if isinstance(entry, type) and issubclass(entry, BaseModel)
}
"""Models of the entries of each section. `bays` are plain names."""
