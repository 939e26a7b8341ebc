"""Lines along which objects move, and their links: belts, or strips if there are no belts."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from pointit.geometry.polyline import Polyline
from pointit.maps.model import LinkEntry, MapFile
from pointit.maps.things import broken_things
from pointit.runtime.config.validation_message import join_names

OVERHANG_M = 0.01
"""Distance off its belt up to which a position was rounded, m."""

STRIP_WIDTH_M = 0.5
"""Width of lanes that are strips, m."""


@dataclass(frozen=True)
class Lane:
    """A line along which objects move."""

    name: str
    line: Polyline
    width_m: float


def lanes_of(file: MapFile) -> dict[str, Lane]:
    """Return the lanes of `file` by name."""
    if file.belts:
        return {name: Lane(name, Polyline(belt.centerline), belt.width) for name, belt in file.belts.items()}
    return {name: Lane(name, Polyline(strip.line), STRIP_WIDTH_M) for name, strip in file.strips.items()}


def leaves_at(link: LinkEntry, source: Lane) -> float:
    """Return the arc length on `source` where `link` leaves it."""
    at = source.line.length_m if link.from_position is None else link.from_position
    return min(max(at, 0.0), source.line.length_m)


def enters_at(link: LinkEntry, target: Lane) -> float:
    """Return the arc length on `target` where `link` enters it."""
    return min(max(link.to_position, 0.0), target.line.length_m)


def broken_references(file: MapFile) -> Iterator[tuple[str, str]]:
    """Yield place and message for each link, bay and thing that names what does not exist, or is off it."""
    kind, lanes = ("belt" if file.belts else "strip"), lanes_of(file)
    known = f"use one of {join_names(lanes)}" if lanes else "the map has neither belts nor strips"
    for index, link in enumerate(file.links):
        for end, name, position in (
            ("from", link.source, link.from_position),
            ("to", link.target, link.to_position),
        ):
            if name not in lanes:
                yield f"links.{index}.{end}", f"there is no {kind} {name!r}; {known}"
                continue
            length = lanes[name].line.length_m
            if position is not None and not -OVERHANG_M <= position <= length + OVERHANG_M:
                yield (
                    f"links.{index}.{end}_position",
                    f"{position:g} m is off {kind} {name}; write 0 to {math.floor(length * 1000) / 1000:g}",
                )
    for bay, name in file.bays.items():
        if name not in lanes:
            yield f"bays.{bay}", f"there is no {kind} {name!r}; {known}"
    yield from broken_things(file)
