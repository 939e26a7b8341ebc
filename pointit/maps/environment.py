"""A map file as its message: lines along which objects move, and the alignment of trackers."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import starmap

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.maps.model import (
    BeltEntry,
    BoxEntry,
    CylinderEntry,
    FenceEntry,
    FrameEntry,
    LampEntry,
    LinkEntry,
    MapFile,
    PlaceEntry,
    PlaneEntry,
    SphereEntry,
    StripEntry,
)
from pointit.maps.things import broken_things, things_of
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
    lanes: dict[str, Lane] = {}
    if file.belts:
        for name, belt in file.belts.items():
            lanes[name] = Lane(name, Polyline(belt.centerline), belt.width)
        return lanes
    for name, strip in file.strips.items():
        lanes[name] = Lane(name, Polyline(strip.line), STRIP_WIDTH_M)
    return lanes


def leaves_at(link: LinkEntry, source: Lane) -> float:
    """Return the arc length on `source` where `link` leaves it."""
    length_m = source.line.length_m
    position_m = length_m if link.from_position is None else link.from_position
    return min(max(position_m, 0.0), length_m)


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
                max_position = math.floor(length * 1000) / 1000
                yield (
                    f"links.{index}.{end}_position",
                    f"{position:g} m is off {kind} {name}; write 0 to {max_position:g}",
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
        lamps=tuple(starmap(_lamp, file.lamps.items())),
        strips=tuple(starmap(_strip, file.strips.items())),
        belts=tuple(starmap(_belt, file.belts.items())),
        links=_links(file),
        bays=tuple(starmap(_bay, file.bays.items())),
        frames=tuple(starmap(_frame, file.frames.items())),
        boxes=tuple(starmap(_box, file.boxes.items())),
        planes=tuple(starmap(_plane, file.planes.items())),
        cylinders=tuple(starmap(_cylinder, file.cylinders.items())),
        spheres=tuple(starmap(_sphere, file.spheres.items())),
        clouds=tuple(starmap(_cloud, clouds.items())),
        fences=tuple(starmap(_fence, file.fences.items())),
        things=things_of(file),
        paced_from=tuple(starmap(_paced_place, file.paced_from.items())),
    )


def _lamp(name: str, lamp: LampEntry) -> Lamp:
    return Lamp(id=name, position_m=lamp.position)


def _strip(name: str, strip: StripEntry) -> Strip:
    return Strip(id=name, line_m=strip.line, pixels=strip.pixels, direction=strip.direction)


def _belt(name: str, belt: BeltEntry) -> Belt:
    return Belt(id=name, line_m=belt.centerline, width_m=belt.width)


def _bay(name: str, belt: str) -> Bay:
    return Bay(id=name, belt=belt)


def _frame(name: str, frame: FrameEntry) -> Frame:
    return Frame(id=name, position_m=frame.position, orientation_xyzw=frame.orientation_xyzw)


def _box(name: str, box: BoxEntry) -> Box:
    return Box(id=name, center_m=box.center, size_m=box.size, yaw_rad=box.yaw_rad)


def _plane(name: str, plane: PlaneEntry) -> Plane:
    return Plane(id=name, center_m=plane.center, normal=plane.normal, size_m=plane.size)


def _cylinder(name: str, cylinder: CylinderEntry) -> Cylinder:
    return Cylinder(id=name, center_m=cylinder.center, radius_m=cylinder.radius, height_m=cylinder.height)


def _sphere(name: str, sphere: SphereEntry) -> Sphere:
    return Sphere(id=name, center_m=sphere.center, radius_m=sphere.radius)


def _fence(name: str, fence: FenceEntry) -> Fence:
    return Fence(id=name, kind=fence.kind, outline_m=fence.outline, low_m=fence.low, high_m=fence.high)


def _paced_place(name: str, place: PlaceEntry) -> PacedPlace:
    return PacedPlace(id=name, position_m=place.position)


def _links(file: MapFile) -> tuple[BeltLink, ...]:
    """Return the links, with positions that were rounded beyond an end clamped to it."""
    lanes = lanes_of(file)
    links: list[BeltLink] = []
    for link in file.links:
        source_position_m: float | None = None
        if link.from_position is not None:
            source_position_m = leaves_at(link, lanes[link.source])
        belt_link = BeltLink(
            source=link.source,
            target=link.target,
            source_position_m=source_position_m,
            target_position_m=enters_at(link, lanes[link.target]),
        )
        links.append(belt_link)
    return tuple(links)


def _cloud(name: str, points: NDArray[np.float64]) -> Cloud:
    """Return the extent of a cloud, whose points no message holds."""
    low_x, low_y, low_z = points.min(axis=0).tolist()
    high_x, high_y, high_z = points.max(axis=0).tolist()
    return Cloud(id=name, points=len(points), low_m=(low_x, low_y, low_z), high_m=(high_x, high_y, high_z))
