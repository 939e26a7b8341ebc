"""Scans as maps: the model of a map file, and its text."""

import json
import math
from collections.abc import Sequence

from pointit.geometry.vector import Vec3
from pointit.maps.model import MapFile
from pointit.scan.by_pointing import Survey, box_of, screen_of
from pointit.scan.result import Scan


def to_map_file(scan: Scan, *, only_identified: bool = True) -> MapFile:
    """Return the map of `scan`: its strips and lamps, positions to the millimetre."""
    return MapFile.model_validate(
        {
            "lamps": {
                name: {"position": _rounded(lamp.position_m)}
                for name, lamp in scan.lamps.items()
                if lamp.identified or not only_identified
            },
            "strips": {
                name: {"line": [_rounded(point) for point in strip.line_m], "pixels": strip.count}
                for name, strip in scan.strips.items()
                if strip.identified or not only_identified
            },
        }
    )


def map_text(scan: Scan, *, only_identified: bool = True) -> str:
    """Return the text of a map file: each strip and lamp with its sigma and what is to be known of it."""
    file = to_map_file(scan, only_identified=only_identified)
    scale = "the known length" if scan.scale_from == "length" else "the pitch of the strips"
    level = "gravity" if scan.level_from == "gravity" else "the strips, most of which are level or upright"
    lines = [
        f"# A room scanned from {sum(camera is not None for camera in scan.cameras)} photographs.",
        f"# Lengths: within {100 * scan.scale_sigma:.1f} %, from {scale}.",
        f"# Level: within {math.degrees(scan.level_sigma_rad):.1f} degrees, from {level}.",
    ]
    if file.lamps:
        lines.append("lamps:")
        for name, lamp in file.lamps.items():
            note = _note(scan.lamps[name].sigma_m, scan.lamps[name].reason)
            lines.append(f"  {json.dumps(name)}: {{position: {list(lamp.position)}}}  {note}")
    if file.strips:
        lines.append("strips:")
        for name, strip in file.strips.items():
            note = _note(scan.strips[name].sigma_m, scan.strips[name].reason)
            lines += [
                f"  {json.dumps(name)}:  {note}",
                f"    line: {[list(point) for point in strip.line]}",
                f"    pixels: {strip.pixels}",
            ]
    return "\n".join([*lines, ""])


def _note(sigma_m: float, reason: str) -> str:
    return f"# within {1000 * sigma_m:.0f} mm (1 sigma){'; ' + reason if reason else ''}"


def _rounded(point: Vec3) -> Vec3:
    x, y, z = (round(value, 3) + 0.0 for value in point)
    return (x, y, z)


def pointed_text(survey: Survey, names: Sequence[str], kind: str) -> str:
    """Return the text of a map of things that were pointed at; `kind`: lamp, box, screen or table.

    Raises:
        RefusedError: If the corners of a box, screen or table span none.
    """
    section = {"lamp": "lamps", "box": "boxes"}.get(kind, "planes")
    lines = ["# Positions found by pointing.", f"{section}:"]
    for name in names:
        own = {
            target: each
            for target, each in survey.targets.items()
            if target == name or target.rpartition(".")[0] == name
        }
        corners = [each.position_m for each in own.values()]
        sigma_m = max(each.sigma_m for each in own.values())
        reason = next((each.reason for each in own.values() if each.reason), "")
        if kind == "lamp":
            entry: dict[str, object] = {"position": list(_rounded(corners[0]))}
        elif kind == "box":
            entry = box_of(corners).model_dump(mode="json")
        else:
            entry = screen_of(corners).model_dump(mode="json")
        fields = ", ".join(f"{key}: {json.dumps(value)}" for key, value in entry.items() if value is not None)
        lines.append(f"  {json.dumps(name)}: {{{fields}}}  {_note(sigma_m, reason)}")
    return "\n".join([*lines, ""])
