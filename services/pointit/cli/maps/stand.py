"""Origin and heading of a map from a person who stands at the origin and points at ends of its strips."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3, rotate_z, subtract
from pointit.maps.edit.document import edited
from pointit.maps.edit.edits import SetValue
from pointit.maps.file import parse_map_file, to_message
from pointit.runtime.errors import RefusedError
from pointit.schemas import Environment, PointingRay
from pointit.services.localizer.estimation.estimator import Pointings, Refusal, Solution, solve
from pointit.services.localizer.estimation.rays import directions, origins
from pointit.services.localizer.estimation.solution import SolverSettings

FLOOR_SIGMA_M = 1.0
"""Standard deviation of a floor's height that is not known: the person's eye height finds it."""
POINTS = {"lamps": "position", "strips": "line", "boxes": "center", "planes": "center"}
"""Key of the point or points of each section that can be placed."""
OLD_NOTE = re.compile(r"^# (Origin of the scan|Placed): .*\n", re.MULTILINE)


def read(path: Path) -> tuple[bytes, Environment]:
    """Return the content of the map at `path`, and the map.

    Raises:
        ConfigError: If it cannot be read as a map.
        RefusedError: If it has sections that cannot be placed.
    """
    content = path.read_bytes()
    file = parse_map_file(content, path)
    if others := [name for name in file.model_dump(exclude_unset=True) if name not in POINTS]:
        raise RefusedError(f"{path} has {others[0]}: only lamps, strips, boxes and planes are placed so")
    return content, to_message(path, file, {}, 0)


def ends_in(room: Environment, names: Sequence[str]) -> dict[str, Vec3]:
    """Return the place of each of `names`: a lamp, `STRIP:first` or `STRIP:last`, the pixels' order counts.

    Raises:
        RefusedError: If there is no such light.
    """
    places: dict[str, Vec3] = {lamp.id: lamp.position_m for lamp in room.lamps}
    for strip in room.strips:
        line = Polyline(strip.line_m)
        half_m = line.length_m / strip.pixels / 2.0
        ends = [_vec3(end) for end in line.points_at(np.array([half_m, line.length_m - half_m]))]
        places[f"{strip.id}:first"], places[f"{strip.id}:last"] = ends[:: strip.direction]
    for name in names:
        if name not in places:
            raise RefusedError(f"there is no {name!r} in the map; there are {', '.join(places)}")
    return {name: places[name] for name in names}


def poses_of(
    rays: Mapping[str, Sequence[PointingRay]], ends: Mapping[str, Vec3], floor_m: float | None
) -> Solution:
    """Return the pose of a person whose `rays` were pointed at `ends`; its `z_m` is the height of the floor.

    Args:
        rays: rays of each hold, {H}, by name of the end.
        ends: position of each end, {W}.
        floor_m: height of the floor in the map, m. None: found by the person's eye height.

    Raises:
        RefusedError: If the ends do not determine it. One sentence.
    """
    held = [(ray, ends[name]) for name, own in rays.items() for ray in own]
    all_rays = [ray for ray, _ in held]
    pointings = Pointings(
        np.array([ray.stamp_ns * 1e-9 for ray in all_rays]),
        origins(all_rays),
        directions(all_rays),
        np.array([end for _, end in held]),
    )
    settings = SolverSettings() if floor_m is not None else SolverSettings(height_sigma_m=FLOOR_SIGMA_M)
    found = solve(pointings, settings, floor_m=floor_m or 0.0)
    if isinstance(found, Refusal):
        raise RefusedError(found.reason)
    return found


def placed(content: bytes, path: Path, origin_m: Vec3, heading_rad: float, note: str) -> bytes:
    """Return the map with its origin at `origin_m` and x in direction `heading_rad`; comments stay.

    Args:
        content: the map as it is.
        path: its path.
        origin_m: position in it that becomes [0, 0, 0].
        heading_rad: azimuth in it that becomes x.
        note: comment for the first line.
    """

    def turned(vector: Any) -> list[float]:
        x, y, z = vector
        return [round(value, 4) for value in rotate_z((x, y, z), -heading_rad)]

    def there(point: Any) -> list[float]:
        return [round(value, 3) for value in turned(subtract(tuple(point), origin_m))]

    sections: dict[str, dict[str, dict[str, Any]]] = parse_map_file(content, path).model_dump(
        mode="json", by_alias=True, exclude_unset=True
    )
    edits: list[SetValue] = []
    for section, key in POINTS.items():
        for name, entry in sections.get(section, {}).items():
            point = entry[key]
            changes: dict[str, Any] = {key: [*map(there, point)] if section == "strips" else there(point)}
            if section == "planes":
                changes["normal"] = turned(entry["normal"])
            if section == "boxes":
                changes["yaw_deg"] = round(entry.get("yaw_deg", 0.0) - math.degrees(heading_rad), 1)
            edits += [SetValue(section=section, name=name, key=each, value=changes[each]) for each in changes]
    text = OLD_NOTE.sub("", edited(content, edits, path).decode())
    return f"# Placed: {note}\n{text}".encode()


def _vec3(values: Any) -> Vec3:
    x, y, z = values
    return (float(x), float(y), float(z))
