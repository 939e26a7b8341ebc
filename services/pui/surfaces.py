"""Pointable surfaces of a map: hit tests of rays, and occlusion by opaque things."""

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.polyline import Hit, Polyline
from pointit.geometry.ray_cast import SAME, RayCaster, SolidCaster
from pointit.geometry.solids import BoxSolid, CylinderSolid, PlaneSolid, Solid, SphereSolid
from pointit.geometry.vector import Vec3
from pointit.runtime.host.extras import import_room
from pointit.schemas import Belt, Environment, Strip
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

WIDENING_RAD = (math.radians(45.0), math.inf)
"""Cone angles of the search for the nearest of many things: those outside the first are skipped at once."""

OPAQUE: tuple[SolidKind, ...] = ("box", "cylinder", "sphere")

SLACK_M = 0.05
"""Depth in an opaque thing at which mounted things are still visible, the accuracy of maps."""


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
    *,
    may_be_empty: bool = False,
) -> dict[int, list[Shape]]:
    """Return the things of `kinds` by their priority, which is that of the id or else of the kind.

    Raises:
        ValueError: If there are none (unless `may_be_empty`, or the map has things that react, or is being
            paced), a cloud is missing, or a priority has no thing.
    """
    shapes = shapes_of(environment, kinds, clouds)
    is_in_preparation = bool(environment.paced_from)  # things are placed while the site runs
    is_allowed = may_be_empty or bool(environment.things) or is_in_preparation
    if not shapes and not is_allowed:
        available = [kind for kind in ALL_KINDS if shapes_of(environment, [kind], clouds)]
        raise ValueError(
            f"surfaces: map {environment.name!r} has no {' or '.join(kinds)} to point at; "
            f"use what it has (--set pui.surfaces=[{','.join(available)}]) or another map (--set "
            "pui.map=NAME)"
        )

    # a misspelt priority would have no effect, and nobody would know why
    unknown = priority.keys() - set(ALL_KINDS) - {shape.surface.id for shape in shapes}
    if unknown:
        raise ValueError(
            f"priority: {min(unknown)!r} is neither a kind nor the id of a thing that can be pointed at; "
            "correct or remove it"
        )
    priority_by_kind = {**PRIORITY, **priority}
    groups: dict[int, list[Shape]] = {}
    for shape in shapes:
        kind, name = shape.surface
        rank = priority_by_kind.get(kind, 0)
        if name in priority:
            rank = priority[name]
        groups.setdefault(rank, []).append(shape)
    return groups


def shapes_of(environment: Environment, kinds: Collection[Kind], clouds: Clouds) -> list[Shape]:
    """Return the things of `kinds`, and the boxes of those that react.

    A box whose centre is on a belt has none: it would hide the packages that pass through it.

    Raises:
        ValueError: If the map names a cloud that is not among `clouds`.
    """
    shapes = _reacting_shapes(environment)
    if "strip" in kinds:
        shapes += _line_shapes("strip", environment.strips)
    if "belt" in kinds:
        shapes += _line_shapes("belt", environment.belts)
    if "lamp" in kinds:
        shapes += [Shape(Surface("lamp", lamp.id), lamp.position_m) for lamp in environment.lamps]
    if "points" in kinds:
        for cloud in environment.clouds:
            if cloud.id not in clouds:
                raise ValueError(f"the points of cloud {cloud.id!r} were not read")
            shapes.append(Shape(Surface("points", cloud.id), clouds[cloud.id]))
    shapes += [Shape(surface, solid) for surface, solid in solids_of(environment, kinds)]
    return shapes


def _line_shapes(kind: Kind, lines: Iterable[Strip | Belt]) -> list[Shape]:
    """Return the strips or belts of a map."""
    return [Shape(Surface(kind, line.id), Polyline(line.line_m)) for line in lines]


def _reacting_shapes(environment: Environment) -> list[Shape]:
    """Return the boxes of the things that react, without those on a belt."""
    things = environment.fixed_things
    if not things:
        return []
    belts = [(Polyline(belt.line_m), belt.width_m / 2.0) for belt in environment.belts]
    shapes: list[Shape] = []
    for thing in things:
        center_m = np.array([thing.center_m])
        is_on_belt = any(line.nearest_to(center_m)[1] <= half_width_m for line, half_width_m in belts)
        if not is_on_belt:
            box = BoxSolid(thing.center_m, thing.size_m, thing.yaw_rad)
            shapes.append(Shape(Surface("box", thing.id), box))
    return shapes


def solids_of(environment: Environment, kinds: Collection[Kind]) -> list[tuple[Surface, Solid]]:
    """Return the solids of `kinds`."""
    solids: list[tuple[Surface, Solid]] = []
    if "box" in kinds:
        for box in environment.boxes:
            solid = BoxSolid(box.center_m, box.size_m, box.yaw_rad)
            solids.append((Surface("box", box.id), solid))
    if "plane" in kinds:
        for plane in environment.planes:
            solid = PlaneSolid(plane.center_m, plane.normal, plane.size_m)
            solids.append((Surface("plane", plane.id), solid))
    if "cylinder" in kinds:
        for cylinder in environment.cylinders:
            solid = CylinderSolid(cylinder.center_m, cylinder.radius_m, cylinder.height_m)
            solids.append((Surface("cylinder", cylinder.id), solid))
    if "sphere" in kinds:
        for sphere in environment.spheres:
            solid = SphereSolid(sphere.center_m, sphere.radius_m)
            solids.append((Surface("sphere", sphere.id), solid))
    return solids


class Caster(Protocol):
    """Finds the closest of its targets."""

    def cast(
        self, origin_m: Vec3, direction: Vec3, tolerance: float = ..., reach_m: float = ..., /
    ) -> Hit | None:
        """Return the closest point, or None beyond the tolerance or further along the ray than the reach."""
        ...


class _CasterGroup(NamedTuple):
    """A caster and the surfaces of its targets."""

    caster: Caster
    surfaces: list[Surface]


class Surfaces:
    """Pointable part of an environment."""

    def __init__(
        self,
        environment: Environment,
        kinds: Sequence[Kind] = ("strip", "belt"),
        *,
        tolerance_rad: float = math.radians(12.0),
        clouds: Clouds | None = None,
        priority: Mapping[str, int] | None = None,
        opaque: Sequence[SolidKind] = OPAQUE,
        may_be_empty: bool = False,
    ) -> None:
        """Create from the things of `kinds`.

        Args:
            environment: map.
            kinds: pointable kinds.
            tolerance_rad: maximum angle at the eyes.
            clouds: points of the map's clouds by id.
            priority: priority by id or kind. The highest within the tolerance is pointed at.
            opaque: kinds that hide what is behind them, pointable or not.
            may_be_empty: True to accept a map without these kinds, as people point at a workspace.

        Raises:
            ValueError: If the map has nothing of these kinds, or nothing for a priority.
        """
        groups = group_by_priority(
            environment, kinds, clouds or {}, priority or {}, may_be_empty=may_be_empty
        )
        highest_first = sorted(groups.items(), reverse=True)
        self.tolerance_rad = tolerance_rad
        """Maximum angle at the eyes."""
        self._groups = [_caster_groups(shapes) for _, shapes in highest_first]
        opaque_solids = [solid for _, solid in solids_of(environment, opaque)]
        self._occluders: Occluders | None = None
        if opaque_solids:
            self._occluders = Occluders(opaque_solids)

    def hit_test(self, origin_m: Vec3, direction: Vec3) -> tuple[Surface, Hit] | None:
        """Return the surface and hit of a ray (in {W}, unit direction), or None beyond the tolerance."""
        occluder_m = math.inf
        if self._occluders is not None:
            occluder_m = self._occluders.first(origin_m, direction)

        # a hit of a higher priority ends the search, however near one of a lower priority is
        for groups in self._groups:
            best: tuple[Surface, Hit] | None = None
            for group in groups:
                hit = self._cast(group.caster, origin_m, direction, occluder_m)
                if hit is not None and (best is None or _is_better(hit, best[1])):
                    best = (group.surfaces[hit.target], hit)
            if best is not None:
                return best
        return None

    def nearest(self, origin_m: Vec3, direction: Vec3) -> tuple[Surface, Hit] | None:
        """Return the visible thing at the smallest angle from the ray, and its hit.

        None if it is within the tolerance, which the ray then misses because something hides it.
        """
        best: tuple[Surface, Hit] | None = None
        all_groups = itertools.chain.from_iterable(self._groups)
        for group in all_groups:
            hit = _cast_widening(group.caster, origin_m, direction)
            if hit is not None and (best is None or hit.miss_rad < best[1].miss_rad):
                best = (group.surfaces[hit.target], hit)
        if best is None or best[1].miss_rad <= self.tolerance_rad:
            return None
        return best

    def _cast(self, caster: Caster, origin_m: Vec3, direction: Vec3, occluder_m: float) -> Hit | None:
        """Return the closest hit that no opaque thing hides. The ray meets the first one at `occluder_m`."""
        hit = caster.cast(origin_m, direction, self.tolerance_rad)
        occluders = self._occluders
        if hit is None or occluders is None or math.isinf(occluder_m):
            return hit
        if not occluders.hides(hit, origin_m, direction, occluder_m):
            return hit
        return caster.cast(origin_m, direction, self.tolerance_rad, occluders.reach(occluder_m))


def _cast_widening(caster: Caster, origin_m: Vec3, direction: Vec3) -> Hit | None:
    """Return the hit within the narrowest of `WIDENING_RAD` that has one."""
    for tolerance_rad in WIDENING_RAD:
        hit = caster.cast(origin_m, direction, tolerance_rad)
        if hit is not None:
            return hit
    return None


def _is_better(a: Hit, b: Hit) -> bool:
    """Return True if `a` is closer to the ray than `b`, or as close and nearer to the eyes."""
    difference_rad = a.miss_rad - b.miss_rad
    if difference_rad < -SAME:
        return True
    return difference_rad <= SAME and a.range_m < b.range_m


def _caster_groups(shapes: list[Shape]) -> list[_CasterGroup]:
    """Return a caster for each kind of geometry among `shapes`, all of one priority."""

    def targets(*kinds: Kind) -> tuple[list[Surface], list[Any]]:
        own = [shape for shape in shapes if shape.surface.kind in kinds]
        return [surface for surface, _ in own], [form for _, form in own]

    on_lines, lines = targets("strip", "belt")
    at_points, points = targets("lamp")
    in_clouds, clouds = targets("points")
    on_solids, solids = targets(*get_args(SolidKind))
    groups: list[_CasterGroup] = []
    if lines or points:
        groups.append(_CasterGroup(RayCaster(lines, points), on_lines + at_points))
    if clouds:
        trees = import_room("pointit.geometry.cloud_tree", "pointing at clouds")
        groups.append(_CasterGroup(trees.CloudCaster(clouds), in_clouds))
    if solids:
        groups.append(_CasterGroup(SolidCaster(solids), on_solids))
    return groups


class Occluders:
    """Opaque things of a room.

    They hide points only if the ray itself intersects one of them. Then a point further along the ray is
    hidden if the line from the eyes to it intersects one. A part that protrudes beside the thing is visible.
    A thing that contains the eyes, because of a coarse map or pose, hides nothing.
    """

    def __init__(self, solids: Sequence[Solid]) -> None:
        self._caster = SolidCaster(solids)

    def first(self, origin_m: Vec3, direction: Vec3) -> float:
        """Return the distance along the ray to the first one, m, or infinity."""
        return self._caster.first_hit_m(origin_m, direction)

    def reach(self, first_m: float) -> float:
        """Return the distance along the ray up to which points are not hidden, m."""
        return first_m + SLACK_M

    def hides(self, hit: Hit, origin_m: Vec3, direction: Vec3, first_m: float) -> bool:
        """Return True if the point of `hit` is hidden to a ray that meets an opaque thing at `first_m`."""
        reach = vector.subtract(hit.point_m, origin_m)
        if vector.dot(direction, reach) <= self.reach(first_m):
            return False
        return self._caster.first_hit_m(origin_m, reach) < hit.range_m - SLACK_M
