"""Checks of things: below the floor, in each other, with the same light, hard to tell apart."""

import math
from collections.abc import Iterator, Sequence
from itertools import permutations

import numpy as np

from pointit.geometry import vector
from pointit.geometry.solids import BoxSolid
from pointit.geometry.vector import Vec3
from pointit.maps.checks.finding import Finding, error, warning
from pointit.maps.model import MapFile
from pointit.maps.things import broken_things, things_of
from pointit.schemas import Thing

EYES_M = 1.64
"""Height of the eyes of a person of 1.76 m, m."""
APART_DEG = 5.0
"""Angle between two things, edge to edge, below which pointing alone does not tell which one is meant."""
NAMED = 10
"""Pairs of things that are named."""


def check_things(file: MapFile, person_m: tuple[float, float] | None) -> Iterator[Finding]:
    """Yield problems of things; with a place of a person, which of them are hard to tell apart from there."""
    if not file.things or any(broken_things(file)):
        return
    things = things_of(file)
    lights: dict[tuple[object, ...], str] = {}
    names: dict[str, str] = {}
    for thing in things:
        where = f"things.{thing.id}"
        top_m = thing.center_m[2] + thing.size_m[2] / 2.0
        if top_m <= 0.0:
            yield error(where, f"ends {-top_m:g} m below the floor; correct its center")
        light = (thing.lamp, thing.strip, thing.part_m)
        if (thing.lamp or thing.strip) and (other := lights.setdefault(light, thing.id)) != thing.id:
            yield warning(where, f"has the light of {other}; give each a light of its own")
        if (twin := names.setdefault(thing.label or thing.id, thing.id)) != thing.id:
            yield warning(where, f"is called as {twin} is; change one label")
    solids = [BoxSolid(thing.center_m, thing.size_m, thing.yaw_rad) for thing in things]
    for (inner, _), (outer, solid) in permutations(zip(things, solids, strict=True), 2):
        if solid.contains(inner.center_m):
            yield warning(f"things.{inner.id}", f"lies in {outer.id}; move it, or make {outer.id} smaller")
    if person_m is not None:
        yield from _confused(things, solids, (*person_m, EYES_M))


def _confused(things: Sequence[Thing], solids: Sequence[BoxSolid], eyes_m: Vec3) -> Iterator[Finding]:
    near = sorted(
        (apart_deg, things[one].id, things[other].id)
        for one, other in _near(things, eyes_m)
        if (apart_deg := _apart_deg(solids[one], solids[other], things[one].center_m, eyes_m)) < APART_DEG
    )
    for apart_deg, name, other_name in near[:NAMED]:
        yield warning(
            f"things.{name}",
            f"is {apart_deg:.0f}° beside {other_name} from there: people need light to tell them apart; move "
            "one, or let people stand nearer",
        )
    if len(near) > NAMED:
        yield warning("things", f"{len(near) - NAMED} more pairs are as near to each other")


def _near(things: Sequence[Thing], eyes_m: Vec3) -> Iterator[tuple[int, int]]:
    """Yield pairs that may be as near to each other, by the balls around them."""
    reach = np.array([thing.center_m for thing in things]) - eyes_m
    range_m = np.linalg.norm(reach, axis=1) + 1e-9
    halves = np.arctan(np.linalg.norm([thing.size_m for thing in things], axis=1) / 2.0 / range_m)
    towards = reach / range_m[:, None]
    for one in range(len(things)):
        angles = np.arccos(np.clip(towards[one + 1 :] @ towards[one], -1.0, 1.0))
        close = angles - halves[one + 1 :] - halves[one] < math.radians(APART_DEG)
        yield from ((one, one + 1 + int(other)) for other in np.flatnonzero(close))


def _apart_deg(one: BoxSolid, other: BoxSolid, start_m: Vec3, eyes_m: Vec3) -> float:
    """Return the angle from edge to edge, as seen from `eyes_m`, 0 if they overlap.

    The nearest point of one to the other is found in turns, from `start_m` on.
    """
    if one.contains(eyes_m) or other.contains(eyes_m):
        return 0.0
    point_m, apart_rad = start_m, 0.0
    for solid in (other, one) * 4:
        towards = vector.normalized(vector.subtract(point_m, eyes_m))
        if solid.intersect(eyes_m, towards) is not None:
            return 0.0
        point_m = solid.closest_approach(eyes_m, towards, "angle")
        apart_rad = vector.angle_between(towards, vector.subtract(point_m, eyes_m))
    return math.degrees(apart_rad)
