"""Converts a map file to its message."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.vector import Vec3
from pointit.maps.lanes import enters_at, lanes_of, leaves_at
from pointit.maps.model import MapFile
from pointit.maps.things import things_of
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
    Plane,
    Sphere,
    Strip,
)


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
