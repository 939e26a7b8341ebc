"""Things of a map file: where they are and what lights them."""

from collections.abc import Iterator, Mapping

import numpy as np

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.maps.model import MapFile, StripPart, ThingEntry
from pointit.runtime.config.similar_names import nearest
from pointit.schemas import Thing

MOST = 1000
"""Limit of things, which are listed in one message several times a second."""
LAMP_M = 0.2
"""Size of a thing that is a lamp, m."""
THINNEST_M = 0.1
"""Least size of a thing that is a part of a strip, m: people point at it as at a box."""
ROUNDED_M = 1e-3
"""Length by which a part may end beyond its strip, since people round, m."""


def broken_things(file: MapFile) -> Iterator[tuple[str, str]]:
    """Yield the things whose light does not exist: place in the file, and problem with remedy."""
    if len(file.things) > MOST:
        yield "things", f"there are {len(file.things)}, limit {MOST}; split the room into several sites"
    for name, entry in file.things.items():
        if problem := _broken(file, entry):
            where, text = problem
            yield f"things.{name}.light{where}", text


def things_of(file: MapFile) -> tuple[Thing, ...]:
    """Return the things of `file`, of which none is broken."""
    return tuple(_thing(file, name, entry) for name, entry in file.things.items())


def _broken(file: MapFile, entry: ThingEntry) -> tuple[str, str] | None:
    light = entry.light
    if light is None:
        return None
    if isinstance(light, str):
        if light in file.strips and light not in file.lamps:
            return "", f"{light} is a strip; write {{strip: {light}, from: METRES, to: METRES}}"
        return None if light in file.lamps else ("", _absent("lamp", light, file.lamps))
    if light.strip not in file.strips:
        return ".strip", _absent("strip", light.strip, file.strips)
    length_m = Polyline(file.strips[light.strip].line).length_m
    if not -ROUNDED_M <= light.start < light.end <= length_m + ROUNDED_M:
        return "", (
            f"goes from {light.start:g} to {light.end:g} m and strip {light.strip} from 0 to "
            f"{length_m:.3g} m; give a part of it, from before to"
        )
    return None


def _absent(kind: str, name: str, there: Mapping[str, object]) -> str:
    return f"there is no {kind} {name!r}; {nearest(name, there) if there else 'add one to the map'}"


def _thing(file: MapFile, name: str, entry: ThingEntry) -> Thing:
    light = entry.light
    center_m, size_m = entry.center, entry.size
    strip, part_m = "", (0.0, 0.0)
    if isinstance(light, StripPart):
        line = Polyline(file.strips[light.strip].line)
        strip, part_m = light.strip, (max(light.start, 0.0), min(light.end, line.length_m))
        if center_m is None:
            center_m, around_m = _around(line, *part_m)
            size_m = size_m or around_m
    elif light is not None and center_m is None:
        center_m = file.lamps[light].position
    size_m = size_m or (LAMP_M, LAMP_M, LAMP_M)
    return Thing(
        id=name,
        label=entry.label,
        center_m=center_m or (0.0, 0.0, 0.0),
        size_m=size_m,
        yaw_rad=entry.yaw_rad,
        mode=entry.mode,
        press=entry.press,
        dwell_s=entry.dwell_s,
        lamp=light if isinstance(light, str) else "",
        strip=strip,
        part_m=part_m,
    )


def _around(line: Polyline, start_m: float, end_m: float) -> tuple[Vec3, Vec3]:
    """Return centre and size of the upright box around a part of a line."""
    inner = line.starts_m[(line.starts_m > start_m) & (line.starts_m < end_m)]
    points = line.points_at(np.r_[start_m, inner, end_m])
    low, high = points.min(axis=0), points.max(axis=0)
    (x, y, z), (a, b, c) = ((low + high) / 2.0).tolist(), np.maximum(high - low, THINNEST_M).tolist()
    return (x, y, z), (a, b, c)
