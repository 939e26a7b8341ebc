"""The things of a map that can be pointed at, and where a ray in {W} meets them (paper, §II-D)."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, Protocol

from pointit.geometry.closest import Hit
from pointit.geometry.point_tree import REACH_M, STEP_M, PointTree
from pointit.geometry.polyline import Polyline
from pointit.geometry.ray_cast import RayCaster
from pointit.geometry.vector import Vec3
from pointit.schemas import Environment

Kind = Literal["strip", "belt", "lamp"]

PAPER_TOLERANCE_M = 0.7


class Surface(NamedTuple):
    """A thing with a name."""

    kind: Kind
    id: str


class Caster(Protocol):
    """Finds the closest of its targets."""

    def cast(self, origin_m: Vec3, direction: Vec3, tolerance: float = ..., /) -> Hit | None:
        """Return the closest point, or none beyond the tolerance."""
        ...


class Surfaces:
    """The pointable part of an environment."""

    def __init__(
        self,
        environment: Environment,
        kinds: Sequence[Kind] = ("strip", "belt"),
        *,
        method: Literal["exact", "kd_tree"] = "exact",
        tolerance_rad: float = math.radians(12.0),
        tolerance_m: float | None = None,
        step_m: float = STEP_M,
        reach_m: float = REACH_M,
    ) -> None:
        """Take the things of `kinds`.

        Args:
            environment: the map.
            kinds: what takes part.
            method: the closed form, or the paper's k-d tree, which measures in metres.
            tolerance_rad: the largest angle at the eyes; used unless metres are.
            tolerance_m: if given, nearest and tolerance are in metres.
            step_m: spacing of the tree's points.
            reach_m: length of the ray that is asked for in the tree.

        Raises:
            ValueError: the map has nothing of these kinds.
        """
        lines: list[Polyline] = []
        points: list[Vec3] = []
        self._surfaces: list[Surface] = []
        if "strip" in kinds:
            lines += [Polyline(strip.line_m) for strip in environment.strips]
            self._surfaces += [Surface("strip", strip.id) for strip in environment.strips]
        if "belt" in kinds:
            lines += [Polyline(belt.line_m) for belt in environment.belts]
            self._surfaces += [Surface("belt", belt.id) for belt in environment.belts]
        if "lamp" in kinds:
            points = [lamp.position_m for lamp in environment.lamps]
            self._surfaces += [Surface("lamp", lamp.id) for lamp in environment.lamps]
        if not self._surfaces:
            raise ValueError(f"map {environment.name!r} has no {' or '.join(kinds)} to point at")
        self._caster: Caster
        if method == "kd_tree":
            self._caster = PointTree(lines, points, step_m=step_m, reach_m=reach_m)
            self._tolerance = PAPER_TOLERANCE_M if tolerance_m is None else tolerance_m
        else:
            measure: Literal["angle", "metres"] = "angle" if tolerance_m is None else "metres"
            self._caster = RayCaster(lines, points, measure=measure)
            self._tolerance = tolerance_rad if tolerance_m is None else tolerance_m

    def meet(self, origin_m: Vec3, direction: Vec3) -> tuple[Surface, Hit] | None:
        """Return what the ray (in {W}, unit direction) points at and where, or none beyond the tolerance."""
        hit = self._caster.cast(origin_m, direction, self._tolerance)
        return None if hit is None else (self._surfaces[hit.target], hit)
