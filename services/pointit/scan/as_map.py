"""Scans as the text of map files."""

import json
import math
from collections.abc import Mapping, Sequence

from pointit.geometry.vector import Vec3
from pointit.scan.by_pointing import PointedAt, box_of, screen_of
from pointit.scan.result import Scan


def map_text(scan: Scan, *, only_identified: bool = True) -> str:
    """Return the text of a map file: each strip and lamp with its sigma and its note."""
    lamps = [each for each in scan.lamps.values() if each.identified or not only_identified]
    strips = [each for each in scan.strips.values() if each.identified or not only_identified]
    scale = "the known length" if scan.scale_from == "length" else "the pitch of the strips"
    level = "gravity" if scan.level_from == "gravity" else "the strips, most of which are level or upright"
    lines = [
        f"# A room scanned from {sum(camera is not None for camera in scan.cameras)} photographs.",
        f"# Lengths: within {100 * scan.scale_sigma:.1f} %, from {scale}.",
        f"# Level: within {math.degrees(scan.level_sigma_rad):.1f} degrees, from {level}.",
    ]
    lines += ["lamps:"] if lamps else []
    for lamp in lamps:
        position = list(_rounded(lamp.position_m))
        lines.append(
            f"  {json.dumps(lamp.name)}: {{position: {position}}}  {_note(lamp.sigma_m, lamp.reason)}"
        )
    lines += ["strips:"] if strips else []
    for strip in strips:
        lines += [
            f"  {json.dumps(strip.name)}:  {_note(strip.sigma_m, strip.reason)}",
            f"    line: {[list(_rounded(point)) for point in strip.line_m]}",
            f"    pixels: {strip.count}",
        ]
    return "\n".join([*lines, ""])


def _note(sigma_m: float, reason: str) -> str:
    return f"# within {1000 * sigma_m:.0f} mm (1 sigma){'; ' + reason if reason else ''}"


def _rounded(point: Vec3) -> Vec3:
    x, y, z = (round(value, 3) + 0.0 for value in point)
    return (x, y, z)


def pointed_text(things: Mapping[str, Sequence[PointedAt]], kind: str) -> str:
    """Return the section of a map for things of a kind (lamp, box, screen or table): corners by name.

    Raises:
        RefusedError: If the corners of a box, screen or table span none.
    """
    lines = [{"lamp": "lamps:", "box": "boxes:"}.get(kind, "planes:")]
    for name, own in things.items():
        corners = [each.position_m for each in own]
        reason = next((each.reason for each in own if each.reason), "")
        if kind == "lamp":
            entry: dict[str, object] = {"position": list(_rounded(corners[0]))}
        else:
            entry = (box_of if kind == "box" else screen_of)(corners).model_dump(mode="json")
        fields = ", ".join(f"{key}: {json.dumps(value)}" for key, value in entry.items() if value is not None)
        note = _note(max(each.sigma_m for each in own), reason)
        lines.append(f"  {json.dumps(name)}: {{{fields}}}  {note}")
    return "\n".join([*lines, ""])
