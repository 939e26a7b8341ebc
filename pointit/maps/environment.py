"""A map file as its message: lines along which objects move, and the alignment of trackers."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.maps.model import LinkEntry, MapFile, broken_things, things_of
from pointit.runtime.config.validation_message import join_names
from pointit.schemas import Environment
from pointit.schemas.environment import (
    Bay,
    Belt,
    BeltLink,
    Box,
    Cloud,
    Cylinder,
    Fence,
    Frame,
    Lamp,
    PacedPlace,
    Plane,
    Sphere,
    Strip,
)

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
    kind = "belt" if file.belts else "strip"
    lanes = lanes_of(file)
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


def environment(
    file: MapFile, clouds: Mapping[str, NDArray[np.float64]], *, name: str, stamp_ns: int
) -> Environment:
    """Return the message of `file`, whose links, bays and things are valid; `clouds` are in {W}, n x 3."""
    return Environment(
        stamp_ns=stamp_ns,
        name=name,
        lamps=tuple(Lamp(id=key, position_m=lamp.position) for key, lamp in file.lamps.items()),
        strips=tuple(
            Strip(id=key, line_m=strip.line, pixels=strip.pixels, direction=strip.direction)
            for key, strip in file.strips.items()
        ),
        belts=tuple(
            Belt(id=key, line_m=belt.centerline, width_m=belt.width) for key, belt in file.belts.items()
        ),
        links=_links(file),
        bays=tuple(Bay(id=key, belt=belt) for key, belt in file.bays.items()),
        frames=tuple(
            Frame(id=key, position_m=each.position, orientation_xyzw=each.orientation_xyzw)
            for key, each in file.frames.items()
        ),
        boxes=tuple(
            Box(id=key, center_m=box.center, size_m=box.size, yaw_rad=box.yaw_rad)
            for key, box in file.boxes.items()
        ),
        planes=tuple(
            Plane(id=key, center_m=plane.center, normal=plane.normal, size_m=plane.size)
            for key, plane in file.planes.items()
        ),
        cylinders=tuple(
            Cylinder(id=key, center_m=each.center, radius_m=each.radius, height_m=each.height)
            for key, each in file.cylinders.items()
        ),
        spheres=tuple(
            Sphere(id=key, center_m=each.center, radius_m=each.radius) for key, each in file.spheres.items()
        ),
        clouds=tuple(
            Cloud(
                id=key,
                points=len(points),
                low_m=_vector(points.min(axis=0)),
                high_m=_vector(points.max(axis=0)),
            )
            for key, points in clouds.items()
        ),
        fences=tuple(
            Fence(id=key, kind=each.kind, outline_m=each.outline, low_m=each.low, high_m=each.high)
            for key, each in file.fences.items()
        ),
        things=things_of(file),
        paced_from=tuple(
            PacedPlace(id=key, position_m=place.position) for key, place in file.paced_from.items()
        ),
    )


def _links(file: MapFile) -> tuple[BeltLink, ...]:
    """Return the links, with positions that were rounded beyond an end clamped to it."""
    lanes = lanes_of(file)
    return tuple(
        BeltLink(
            source=link.source,
            target=link.target,
            source_position_m=(None if link.from_position is None else leaves_at(link, lanes[link.source])),
            target_position_m=enters_at(link, lanes[link.target]),
        )
        for link in file.links
    )


def _vector(values: NDArray[np.float64]) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
