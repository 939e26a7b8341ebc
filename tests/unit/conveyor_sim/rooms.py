"""Rooms with belts by hand, and what must hold in every one of them."""

import functools
import math
from collections.abc import Sequence
from itertools import combinations

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import Bay, Belt, BeltLink, Environment, TrackedObject
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.plant import Plant

S = 1_000_000_000
CHORD_M = 2e-3
"""Largest difference between chord and arc of two packages in a curve."""


def belt(name: str, *points: tuple[float, float]) -> Belt:
    return Belt(id=name, line_m=tuple((x, y, 1.0) for x, y in points))


def room(belts: Sequence[Belt], links: Sequence[BeltLink] = (), **bays: str) -> Environment:
    return Environment(
        stamp_ns=1,
        name="hall",
        belts=tuple(belts),
        links=tuple(links),
        bays=tuple(Bay(id=name[1:], belt=to) for name, to in bays.items()),
    )


def link(source: str, target: str, at_m: float | None = None, to_m: float = 0.0) -> BeltLink:
    """Return a link from `at_m` of its source, or the end, to `to_m` of its target."""
    return BeltLink(source=source, target=target, source_position_m=at_m, target_position_m=to_m)


def lanes(*lengths_m: float) -> Environment:
    return room(
        [belt(str(index), (0.0, 2.0 * index), (long, 2.0 * index)) for index, long in enumerate(lengths_m)]
    )


CHAIN = room(
    [belt("a", (0, 0), (2, 0)), belt("b", (2.01, 0), (5, 0)), belt("c", (5.2, 0), (5.2, 3))],
    [link("a", "b"), link("b", "c")],
)
"""One after the other, the last round a corner."""

FORK = room(
    [belt("main", (0, 0), (6, 0)), belt("side", (3, 0.3), (3, 3)), belt("late", (4.5, -0.3), (4.5, -3))],
    [link("main", "side", 3.0), link("main", "late", 4.5)],
    b1="side",
    b2="late",
    b3="main",
)
"""Two diverters on a straight belt."""

MERGE = room(
    [belt("main", (0, 0), (6, 0)), belt("left", (2, 3), (2, 0.3)), belt("slant", (1.5, -2.5), (4, -0.2))],
    [link("left", "main", to_m=2.0), link("slant", "main", to_m=4.2)],
    b3="main",
)
"""Three belts into one, one of them at a narrow angle."""

RING = room(
    [
        belt("south", (0, 0), (4, 0)),
        belt("east", (4.2, 0.2), (4.2, 4)),
        belt("north", (4, 4.2), (0, 4.2)),
        belt("west", (-0.2, 4), (-0.2, 0.2)),
        belt("in", (2, -3), (2, -0.3)),
        belt("out", (2, 4.5), (2, 7)),
    ],
    [
        link("south", "east"),
        link("east", "north"),
        link("north", "west"),
        link("west", "south"),
        link("in", "south", to_m=2.0),
        link("north", "out", 2.0),
    ],
    b1="out",
)
"""Round and round, with a way in and a way out."""


def cross(gap_m: float) -> Environment:
    return room(
        [belt("w", (0, 0), (4.0 - gap_m, 0)), belt("e", (4, 0), (6, 0)), belt("n", (3.5, 3), (3.5, -3))],
        [link("w", "e"), link("w", "n", to_m=3.0)],
        b1="n",
        b3="e",
    )


CROSS = cross(1.0)

ROOMS = {"chain": CHAIN, "fork": FORK, "merge": MERGE, "ring": RING, "cross": CROSS}


def config(**changes: object) -> ConveyorSimConfig:
    return ConveyorSimConfig.model_validate(changes)


def plant(environment: Environment, *, seed: int = 0, **changes: object) -> Plant:
    return Plant(environment, config(**changes), seed=seed, start_ns=0)


def halves(a: TrackedObject, b: TrackedObject) -> float:
    return (a.length_m + b.length_m) / 2.0


_line = functools.cache(Polyline)


def on_two_bridges(a: TrackedObject, b: TrackedObject, length_m: float) -> bool:
    """Return True if both are beyond one end of their belt, on bridges that differ. Bridges are straight."""
    a_m = a.surface_position_m
    b_m = b.surface_position_m
    is_beyond = max(a_m, b_m) < 0.0 or min(a_m, b_m) > length_m
    return is_beyond and math.dist(a.position_m, b.position_m) > abs(a_m - b_m) + 1e-6


def check_apart(environment: Environment, objects: Sequence[TrackedObject], *, corners: bool = True) -> None:
    """Fail where two packages overlap: on a belt, over a link, or anywhere in the room."""
    lines = {line.id: _line(line.line_m) for line in environment.belts}
    for a, b in combinations(objects, 2):
        if a.surface_id == b.surface_id != "" and not on_two_bridges(a, b, lines[a.surface_id].length_m):
            apart_m = abs(a.surface_position_m - b.surface_position_m)
            assert apart_m >= halves(a, b) - 1e-6, (a, b)
        if corners:
            assert math.dist(a.position_m, b.position_m) >= halves(a, b) - CHORD_M, (a, b)
    for link in environment.links:
        source = lines[link.source]
        target = lines[link.target]
        leaves_m = source.length_m if link.source_position_m is None else link.source_position_m
        gap_m = math.dist(source.point_at(leaves_m), target.point_at(link.target_position_m))
        for a in objects:
            for b in objects:
                if a.surface_id != link.source or b.surface_id != link.target or a is b:
                    continue
                before_m = leaves_m - a.surface_position_m
                after_m = b.surface_position_m - link.target_position_m
                if before_m >= 0.0 and after_m >= 0.0:
                    assert before_m + gap_m + after_m >= halves(a, b) - 1e-6, (link, a, b)


def position(objects: Sequence[TrackedObject], name: str) -> Vec3:
    return next(tracked.position_m for tracked in objects if tracked.id == name)
