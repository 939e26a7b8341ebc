"""Geometry of the things of a map: lines, points, solids, clouds, each with its kind and id."""

from collections.abc import Collection, Iterable, Mapping
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.cylinder import CylinderSolid
from pointit.geometry.plane import PlaneSolid
from pointit.geometry.polyline import Polyline
from pointit.geometry.solids import BoxSolid, Solid, SphereSolid
from pointit.geometry.vector import Vec3
from pointit.schemas import Environment
from pointit.schemas.pointing import Solid as SolidName
from pointit.schemas.pointing import SurfaceKind

Clouds = Mapping[str, NDArray[Any]]
"""Points of each cloud by id, n x 3."""

SolidKind = Literal["box", "plane", "cylinder", "sphere"]
Kind = Literal["strip", "belt", "lamp", "box", "plane", "cylinder", "sphere", "points"]

ALL_KINDS: tuple[Kind, ...] = get_args(Kind)

PRIORITY: Mapping[str, int] = {"lamp": 2, "strip": 2, "belt": 2, "points": 1}
"""Default priorities by kind, 0 for others. Thin things come first, since an area is seldom missed."""


PLACES: dict[Kind, tuple[SurfaceKind, SolidName]] = {
    "strip": ("strip", ""),
    "belt": ("belt", ""),
    "lamp": ("lamp", ""),
    "points": ("points", ""),
    "box": ("none", "box"),
    "plane": ("none", "plane"),
    "cylinder": ("none", "cylinder"),
    "sphere": ("none", "sphere"),
}
"""Surface and solid of a cursor on each kind."""


class Surface(NamedTuple):
    """A thing with a name."""

    kind: Kind
    id: str


class Shape(NamedTuple):
    """A thing and its geometry."""

    surface: Surface
    form: Polyline | Vec3 | Solid | NDArray[Any]


def group_by_priority(
    environment: Environment,
    kinds: Collection[Kind],
    clouds: Clouds,
    priority: Mapping[str, int],
    grazing_rad: float,
    *,
    may_be_empty: bool = False,
) -> dict[int, list[Shape]]:
    """Return the things of `kinds` by their priority, which is that of the id or else of the kind.

    Raises:
        ValueError: If there are none (unless `may_be_empty`, or the map has things that react), a cloud is
            missing, or a priority has no thing.
    """
    shapes = shapes_of(environment, kinds, clouds, grazing_rad)
    if not shapes and not may_be_empty and not environment.things:
        has = ",".join(kind for kind in ALL_KINDS if shapes_of(environment, [kind], clouds, grazing_rad))
        raise ValueError(
            f"surfaces: map {environment.name!r} has no {' or '.join(kinds)} to point at; "
            f"use what it has (--set pui.surfaces=[{has}]) or another map (--set pui.map=NAME)"
        )
    unknown = priority.keys() - set(ALL_KINDS) - {shape.surface.id for shape in shapes}
    if unknown:
        raise ValueError(
            f"priority: {min(unknown)!r} is neither a kind nor the id of a thing that can be pointed at; "
            "correct or remove it"
        )
    ranks = {**PRIORITY, **priority}
    groups: dict[int, list[Shape]] = {}
    for shape in shapes:
        kind, name = shape.surface
        rank = priority[name] if name in priority else ranks.get(kind, 0)
        groups.setdefault(rank, []).append(shape)
    return groups


def shapes_of(
    environment: Environment, kinds: Collection[Kind], clouds: Clouds, grazing_rad: float
) -> list[Shape]:
    """Return the things of `kinds`, and the boxes of those that react.

    A box whose centre is on a belt has none: it would hide the packages that pass through it.

    Raises:
        ValueError: If the map names a cloud that is not among `clouds`.
    """
    things = environment.fixed_things
    belts = [(Polyline(belt.line_m), belt.width_m / 2.0) for belt in environment.belts if things]
    shapes = [
        Shape(Surface("box", thing.id), BoxSolid(thing.center_m, thing.size_m, thing.yaw_rad))
        for thing in things
        if not any(line.nearest_to(np.array([thing.center_m]))[1] <= half_m for line, half_m in belts)
    ]
    if "strip" in kinds:
        shapes += [Shape(Surface("strip", strip.id), Polyline(strip.line_m)) for strip in environment.strips]
    if "belt" in kinds:
        shapes += [Shape(Surface("belt", belt.id), Polyline(belt.line_m)) for belt in environment.belts]
    if "lamp" in kinds:
        shapes += [Shape(Surface("lamp", lamp.id), lamp.position_m) for lamp in environment.lamps]
    if "points" in kinds:
        for cloud in environment.clouds:
            if cloud.id not in clouds:
                raise ValueError(f"the points of cloud {cloud.id!r} were not read")
            shapes.append(Shape(Surface("points", cloud.id), clouds[cloud.id]))
    return shapes + [Shape(*pair) for pair in solids_of(environment, kinds, grazing_rad)]


def solids_of(
    environment: Environment, kinds: Collection[Kind], grazing_rad: float
) -> list[tuple[Surface, Solid]]:
    """Return the solids of `kinds`."""
    solids: dict[SolidKind, Iterable[tuple[str, Solid]]] = {
        "box": ((box.id, BoxSolid(box.center_m, box.size_m, box.yaw_rad)) for box in environment.boxes),
        "plane": (
            (plane.id, PlaneSolid(plane.center_m, plane.normal, plane.size_m, grazing_rad=grazing_rad))
            for plane in environment.planes
        ),
        "cylinder": (
            (each.id, CylinderSolid(each.center_m, each.radius_m, each.height_m))
            for each in environment.cylinders
        ),
        "sphere": ((ball.id, SphereSolid(ball.center_m, ball.radius_m)) for ball in environment.spheres),
    }
    return [(Surface(kind, name), solid) for kind in solids if kind in kinds for name, solid in solids[kind]]
