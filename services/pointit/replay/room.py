"""The recorded map as a map file, for a replay on a machine that does not have the site's."""

import math
import re
from pathlib import Path
from typing import Any

from pointit.maps.edit.yaml_writer import dump_yaml
from pointit.maps.file import shipped_maps
from pointit.maps.model import OBJECT
from pointit.replay.levels import ReplayError
from pointit.schemas import Environment, Thing

MAX_NAME = 64
"""Characters of a name that are used, at most."""
_UNSAFE = re.compile(r"[^\w. ()+,=@-]")


def write_room(room: Environment, folder: Path) -> Path | None:
    """Write `room` as a map file of its name into `folder` and return the path.

    Characters of the name that could lead out of `folder` are replaced. Return None if `room` has point
    clouds, whose points are not in the message.
    """
    if room.clouds:
        return None
    path = folder / f"{_UNSAFE.sub('_', room.name)[:MAX_NAME] or 'map'}.yaml"
    path.write_text(dump_yaml(_sections(room)), encoding="utf-8")
    return path


def check_map(name: str) -> None:
    """Check the map in the recorded parameters of pui, which is used if `write_room` can write none.

    Raises:
        ReplayError: It is neither shipped nor a file in the current folder or below: a recording may come
            from anybody, and must not have other files opened.
    """
    if name not in shipped_maps() and not _is_file_here(name):
        raise ReplayError(
            f"the recording refers to the map {name[:MAX_NAME]!r}, which is neither shipped nor a file in "
            "the current folder: replay it in the folder of the map"
        )


def _is_file_here(name: str) -> bool:
    try:
        path = Path(name).resolve()
        return path.is_relative_to(Path.cwd()) and path.is_file()
    except (OSError, ValueError):  # too long, or a zero in it
        return False


def _sections(room: Environment) -> dict[str, Any]:
    sections: dict[str, Any] = {
        "lamps": {lamp.id: {"position": list(lamp.position_m)} for lamp in room.lamps},
        "strips": {
            each.id: {"line": _line(each.line_m), "pixels": each.pixels, "direction": each.direction}
            for each in room.strips
        },
        "belts": {each.id: {"centerline": _line(each.line_m), "width": each.width_m} for each in room.belts},
        "links": [
            {
                "from": link.source,
                "to": link.target,
                "from_position": link.source_position_m,
                "to_position": link.target_position_m,
            }
            for link in room.links
        ],
        "bays": {bay.id: bay.belt for bay in room.bays},
        "frames": {
            each.id: {"position": list(each.position_m), "orientation": list(each.orientation_xyzw)}
            for each in room.frames
        },
        "boxes": {
            each.id: {
                "center": list(each.center_m),
                "size": list(each.size_m),
                "yaw_deg": math.degrees(each.yaw_rad),
            }
            for each in room.boxes
        },
        "planes": {
            each.id: {"center": list(each.center_m), "normal": list(each.normal)}
            | ({} if each.size_m is None else {"size": list(each.size_m)})
            for each in room.planes
        },
        "cylinders": {
            each.id: {"center": list(each.center_m), "radius": each.radius_m, "height": each.height_m}
            for each in room.cylinders
        },
        "spheres": {
            each.id: {"center": list(each.center_m), "radius": each.radius_m} for each in room.spheres
        },
        "fences": {
            each.id: {"kind": each.kind, "outline": [list(corner) for corner in each.outline_m]}
            | ({} if each.low_m is None else {"low": each.low_m})
            | ({} if each.high_m is None else {"high": each.high_m})
            for each in room.fences
        },
        "things": {each.id: _thing(each) for each in room.things},
    }
    for link in sections["links"]:
        if link["from_position"] is None:
            del link["from_position"]
    return {name: entries for name, entries in sections.items() if entries}


def _thing(thing: Thing) -> dict[str, object]:
    entry: dict[str, object] = {"mode": thing.mode, "press": thing.press}
    if thing.is_tracked:
        entry["at"] = OBJECT
    else:
        entry |= {"center": list(thing.center_m), "size": list(thing.size_m)}
        entry["yaw_deg"] = math.degrees(thing.yaw_rad)
    if thing.strip:
        entry["light"] = {"strip": thing.strip, "from": thing.part_m[0], "to": thing.part_m[1]}
    elif thing.lamp:
        entry["light"] = thing.lamp
    if thing.dwell_s is not None:
        entry["dwell_s"] = thing.dwell_s
    return entry | ({"label": thing.label} if thing.label else {})


def _line(line: tuple[tuple[float, float, float], ...]) -> list[list[float]]:
    return [list(vertex) for vertex in line]
