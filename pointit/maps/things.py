"""Things of a map: their position and their light, by their own entry, a belt, a strip or a lamp."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.maps.model import LinePart, MapFile, ThingEntry
from pointit.runtime.config.nearest_name import nearest
from pointit.schemas import Thing
from pointit.schemas.environment import BESIDE_BELT_M

HOME_BUTTONS = ("{", "automation.", "button.", "input_button.", "scene.", "script.")
"""Starts of actions of Home Assistant and of entities that are run, not switched on and off."""
MAX_THINGS = 1000
"""Limit of things, which are listed in one message several times a second."""
LAMP_M = 0.2
"""Size of a thing that is a lamp, m."""
THINNEST_M = 0.1
"""Least size of a thing that is a part of a strip, m: people point at it as at a box."""
SAMPLES = 20
"""Number of places of a part of a belt at which strips beside it are searched."""
ROUNDED_M = 1e-3
"""Length by which a part may end beyond its strip, since people round, m."""


def broken_things(file: MapFile) -> Iterator[tuple[str, str]]:
    """Yield the things whose light or belt does not exist: place in the file, and problem with remedy."""
    if len(file.things) > MAX_THINGS:
        yield "things", f"there are {len(file.things)}, limit {MAX_THINGS}; split the room into several sites"
    strips = {name: strip.line for name, strip in file.strips.items()}
    belts = {name: belt.centerline for name, belt in file.belts.items()}
    for name, entry in file.things.items():
        where = f"things.{name}"
        light = entry.light
        if isinstance(light, LinePart):
            yield from _broken_part(f"{where}.light", "strip", light, strips)
        elif light in file.strips and light not in file.lamps:
            yield f"{where}.light", f"{light} is a strip; write {{strip: {light}, from: METRES, to: METRES}}"
        elif light is not None and light not in file.lamps:
            yield f"{where}.light", _missing_name_text("lamp", light, file.lamps)
        if isinstance(entry.at, LinePart):
            yield from _broken_part(f"{where}.at", "belt", entry.at, belts)


def things_of(file: MapFile) -> tuple[Thing, ...]:
    """Return the things of `file`, of which none is broken."""
    return tuple(_thing(file, name, entry) for name, entry in file.things.items())


def _broken_part(
    where: str, kind: str, part: LinePart, lines: Mapping[str, Sequence[Vec3]]
) -> Iterator[tuple[str, str]]:
    """Yield the problem of a part of a line that does not exist, or of which it lies beyond the ends."""
    if part.line not in lines:
        yield f"{where}.{kind}", _missing_name_text(kind, part.line, lines)
        return
    line, (start_m, end_m) = _part_of_thing(part, lines[part.line])
    is_on_line = part.start >= -ROUNDED_M and part.end <= line.length_m + ROUNDED_M
    if not is_on_line or start_m >= end_m:
        length = f"{line.length_m:.3g}"
        span = f"goes from {part.start:g} to {part.end:g} m and {kind} {part.line} from 0 to {length} m"
        yield where, f"{span}; give a part of it, from before to"


def _missing_name_text(kind: str, name: str, names: Mapping[str, object]) -> str:
    advice = nearest(name, names) if names else "add one to the map"
    return f"there is no {kind} {name!r}; {advice}"


def _thing(file: MapFile, name: str, entry: ThingEntry) -> Thing:
    """Return a thing with the place and the light that its entry gives or implies."""
    light = entry.light
    center_m = entry.center
    size_m = entry.size
    yaw_rad = entry.yaw_rad

    # On a belt: around that part of it, lit by the strip beside it
    if isinstance(entry.at, LinePart):
        belt = file.belts[entry.at.line]
        line, (start_m, end_m) = _part_of_thing(entry.at, belt.centerline)
        center_m, size_m, yaw_rad = _around(line, (start_m, end_m), belt.width)
        places_m = line.points_at(np.linspace(start_m, end_m, SAMPLES))
        light = light or _strip_beside(file, places_m, belt.width / 2.0)

    # Without a place of its own it is where its light is
    strip = ""
    part_m = (0.0, 0.0)
    if isinstance(light, LinePart):
        strip = light.line
        line, part_m = _part_of_thing(light, file.strips[strip].line)
        if center_m is None:
            center_m, around_m, _ = _around(line, part_m)
            size_m = size_m or around_m
    elif light is not None and center_m is None:
        center_m = file.lamps[light].position

    # What Home Assistant can switch is a switch, unless the entry says otherwise
    fields = entry.model_dump(include={"label", "mode", "press", "dwell_s", "home_assistant"})
    if entry.home_assistant and "mode" not in entry.model_fields_set:
        fields["mode"] = "button" if entry.home_assistant.startswith(HOME_BUTTONS) else "switch"
    lamp = light if isinstance(light, str) else ""
    is_tracked = isinstance(entry.at, str) or center_m is None  # without a position, nothing tracks it
    return Thing(
        id=name,
        **fields,
        center_m=center_m or (0.0, 0.0, 0.0),
        size_m=size_m or (LAMP_M, LAMP_M, LAMP_M),
        yaw_rad=yaw_rad,
        lamp=lamp,
        strip=strip,
        part_m=part_m,
        is_tracked=is_tracked,
    )


def _part_of_thing(part: LinePart, line: Sequence[Vec3]) -> tuple[Polyline, tuple[float, float]]:
    """Return the whole line, and the arc lengths of the part, which may have been rounded beyond its ends."""
    polyline = Polyline(line)
    return polyline, (max(part.start, 0.0), min(part.end, polyline.length_m))


def _around(line: Polyline, part_m: tuple[float, float], width_m: float = 0.0) -> tuple[Vec3, Vec3, float]:
    """Return centre, size and azimuth of the upright box around a part of a line.

    With a width the box lies along the line; else its azimuth is 0.
    """
    # Ends and vertices of the part
    start_m, end_m = part_m
    is_inner = (line.starts_m > start_m) & (line.starts_m < end_m)
    points = line.points_at(np.r_[start_m, line.starts_m[is_inner], end_m])

    # Their box in axes along the line, which becomes wide and at least `THINNEST_M` thick
    x, y, _ = points[-1] - points[0]
    yaw_rad = math.atan2(y, x) if width_m else 0.0
    c = math.cos(yaw_rad)
    s = math.sin(yaw_rad)
    axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    own_points = points @ axes
    low = own_points.min(axis=0)
    high = own_points.max(axis=0)
    center_x, center_y, center_z = (axes @ (low + high) / 2.0).tolist()
    size = high - low + (0.0, width_m, 0.0)
    size_x, size_y, size_z = np.maximum(size, THINNEST_M).tolist()
    return (center_x, center_y, center_z), (size_x, size_y, size_z), yaw_rad


def _strip_beside(file: MapFile, places_m: NDArray[np.float64], half_m: float) -> LinePart | None:
    """Return the part of a strip beside `places_m` of a belt: of the strip that is beside most of them."""
    best: LinePart | None = None
    max_count = 1
    for name, strip in file.strips.items():
        along_m, distances_m = Polyline(strip.line).nearest_to(places_m)
        beside_m = along_m[distances_m <= half_m + BESIDE_BELT_M]
        if len(beside_m) > max_count and np.ptp(beside_m) > ROUNDED_M:
            best = LinePart(name, float(beside_m.min()), float(beside_m.max()))
            max_count = len(beside_m)
    return best
