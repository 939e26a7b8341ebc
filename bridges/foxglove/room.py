"""Entities of the room, which change seldom: belts, strips, planes, fences, lamps and bays."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from foxglove.messages import CubePrimitive, LinePrimitive, TextPrimitive

from pointit.bridges.foxglove import shapes
from pointit.bridges.foxglove.shapes import NamedEntity, Places
from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.solids import plane_axes
from pointit.geometry.vector import Vec3
from pointit.plugins import rotation
from pointit.schemas import Belt, ConveyorState, Environment, Lamp, LampColor, Strip, Thing
from pointit.schemas.base import Rgb
from pointit.schemas.environment import Box, Cloud, Fence, Plane

ENDLESS_M = 20.0
"""Drawn size of an infinite plane."""
SHARPEST = 0.35
"""Cosine of half a bend's angle below which a ribbon's corner is cut."""
POLE_M = 0.03
BELT: Rgb = (70, 74, 84)
RIM: Rgb = (150, 155, 165)
SOLID: Rgb = (140, 150, 170)
GLASS = 0.35
"""Opacity of solids, so that objects behind them are visible."""
FENCES: dict[str, Rgb] = {"keep_in": (71, 209, 168), "keep_out": (255, 144, 136)}
"""Colours of fences by kind, as in the page (`appearance.ts`)."""
FENCE_M = 2.0
"""Drawn height of a fence without an upper end."""

LAMP_M = 0.09
BLACK: Rgb = (0, 0, 0)
OFF = 45
"""Minimum grey of a lamp that is off."""
ABOVE_M = 0.2


class Lines:
    """Drawable belts and strips by name."""

    def __init__(self, environment: Environment) -> None:
        """Keep the lines of `environment`; `problems` has a message for each that cannot be drawn."""
        self.problems: list[str] = []
        self.belts: dict[str, tuple[Polyline, Belt]] = {}
        self.strips: dict[str, tuple[Polyline, Strip]] = {}
        for belt in environment.belts:
            line = self._line("belt", belt)
            if line is not None:
                self.belts[belt.id] = (line, belt)
        for strip in environment.strips:
            line = self._line("strip", strip)
            if line is not None:
                self.strips[strip.id] = (line, strip)

    def _line(self, kind: str, line: Belt | Strip) -> Polyline | None:
        try:
            return Polyline(line.line_m)
        except ValueError as error:
            subject = f"{kind} {line.id!r}"
            self.problems.append(f"{subject} cannot be drawn ({error}); correct the map")
            return None


def ribbon(line: Polyline, width_m: float) -> tuple[Places, list[int]]:
    """Return a level ribbon along `line`: 2 n places, left and right of each vertex, and its triangles.

    In bends its two rims stay `width_m` apart; where a bend is sharper than `SHARPEST` says, its corner
    is cut. Pieces that go straight up are as wide as the piece before.
    """
    # Unit vectors to the left of each piece; a piece straight up has that of the piece before
    tangents = line.tangents
    x = tangents[:, 0]
    y = tangents[:, 1]
    across = np.column_stack([-y, x])
    lengths = np.linalg.norm(across, axis=1)
    upright = lengths < 1e-6
    across[upright] = (0.0, 1.0)
    lengths[upright] = 1.0
    across /= lengths[:, None]
    for index in np.flatnonzero(upright[1:]) + 1:
        across[index] = across[index - 1]

    # At each vertex the mean direction of both pieces; in a turn back, which has none, that of the first
    before = np.vstack([across[:1], across])
    after = np.vstack([across, across[-1:]])
    middle = before + after
    length = np.linalg.norm(middle, axis=1)
    turns_back = length < 1e-6
    middle[turns_back] = before[turns_back]
    length[turns_back] = 1.0
    middle /= length[:, None]

    # Further out by the cosine of half the bend, so that the rims stay parallel to the pieces
    cosine = np.maximum(np.einsum("nk,nk->n", middle, after), SHARPEST)
    half_widths_m = width_m / 2.0 / cosine
    reach_m = np.zeros_like(line.vertices_m)
    reach_m[:, :2] = middle * half_widths_m[:, None]
    places = np.empty((2 * len(reach_m), 3))
    places[0::2] = line.vertices_m + reach_m
    places[1::2] = line.vertices_m - reach_m

    # Two triangles between each vertex and the next
    triangles: list[int] = []
    for first in range(0, 2 * (len(reach_m) - 1), 2):
        triangles += (first, first + 1, first + 2)
        triangles += (first + 2, first + 1, first + 3)
    return places, triangles


def room(environment: Environment, lines: Lines, now_ns: int) -> list[NamedEntity]:
    """Return all entities of `environment` that change only with the map."""

    def new_entity(kind: str, name: str, **primitives: Any) -> NamedEntity:
        facts = {"kind": kind, "id": name}
        return shapes.entity(f"{kind} {name}", now_ns, facts=facts, **primitives)

    # Belts one by one, strips together
    entities: list[NamedEntity] = []
    for name, (line, belt) in lines.belts.items():
        entities.append(new_entity("belt", name, **_belt(line, belt)))
    if lines.strips:
        strips: list[LinePrimitive] = []
        for line, _ in lines.strips.values():
            strips.append(shapes.line(line.vertices_m.tolist(), BELT))
        entities.append(shapes.entity("strips", now_ns, lines=strips))

    for kind, name, primitives in _solids(environment):
        entities.append(new_entity(kind, name, **primitives))

    # Lamps change their colours and are drawn apart: here only what they stand on
    for lamp in environment.lamps:
        x, y, z = lamp.position_m
        if z > POLE_M:
            pole = shapes.cylinder((x, y, 0.0), z, POLE_M, RIM)
            entities.append(new_entity("pole", lamp.id, cylinders=[pole]))
    return entities


def _solids(environment: Environment) -> Iterator[tuple[str, str, dict[str, object]]]:
    """Yield kind, id and primitives of each solid, and of what is like one."""
    for box in environment.boxes:
        yield "box", box.id, _box(box)
    for thing in environment.fixed_things:
        yield "thing", thing.id, _box(thing)
    for plane in environment.planes:
        yield "plane", plane.id, _plane(plane)
    for cylinder in environment.cylinders:
        diameter_m = 2.0 * cylinder.radius_m
        shape = shapes.cylinder(cylinder.center_m, cylinder.height_m, diameter_m, SOLID, alpha=GLASS)
        yield "cylinder", cylinder.id, {"cylinders": [shape]}
    for sphere in environment.spheres:
        ball = shapes.sphere(sphere.center_m, 2.0 * sphere.radius_m, SOLID, GLASS)
        yield "sphere", sphere.id, {"spheres": [ball]}
    for cloud in environment.clouds:
        yield "cloud", cloud.id, _cloud(cloud)
    for fence in environment.fences:
        yield "fence", fence.id, _fence(fence)


def _box(box: Box | Thing) -> dict[str, object]:
    """Return a box and its edges, and its name if it is a thing."""
    orientation = rotation.from_yaw(box.yaw_rad)
    pose = shapes.pose(box.center_m, orientation)
    size = shapes.size(*box.size_m)
    cube = CubePrimitive(pose=pose, size=size, color=shapes.color(SOLID, GLASS))
    ends = shapes.box_edges(box.center_m, box.size_m, orientation)
    edges = shapes.line(ends, RIM, kind="list", pixels=1.0)
    texts: list[TextPrimitive] = []
    if isinstance(box, Thing):
        height_m = box.size_m[2] / 2.0 + LAMP_M
        name = box.label or box.id
        above = shapes.above(box.center_m, height_m)
        texts.append(shapes.label(name, above))
    return {"cubes": [cube], "lines": [edges], "texts": texts}


def _belt(line: Polyline, belt: Belt) -> dict[str, object]:
    places, triangles = ribbon(line, belt.width_m)
    middle_m = line.length_m / 2.0
    length_m = min(0.4, line.length_m / 2.0)
    step = vector.scale(line.tangent_at(middle_m), length_m)
    above = shapes.above(line.point_at(middle_m), 0.01)
    left = places[0::2]
    right_back = places[-1::-2]
    rim = np.vstack([left, right_back]).tolist()
    surface = shapes.surface(places, triangles, BELT)
    outline = shapes.line(rim, RIM, kind="loop", pixels=1.5)
    arrow = shapes.arrow(above, step, RIM, width_m=0.015)
    return {"triangles": [surface], "lines": [outline], "arrows": [arrow]}


def _plane(plane: Plane) -> dict[str, object]:
    u, v = plane_axes(plane.normal)
    wide_m, high_m = plane.size_m or (ENDLESS_M, ENDLESS_M)
    across = vector.scale(u, wide_m / 2.0)
    up = vector.scale(v, high_m / 2.0)
    corners: list[Vec3] = []
    for sign_u, sign_v in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)):
        offset_u = vector.scale(across, sign_u)
        offset_v = vector.scale(up, sign_v)
        offset = vector.add(offset_u, offset_v)
        corners.append(vector.add(plane.center_m, offset))
    places = np.array(corners)
    triangles = (0, 1, 2, 0, 2, 3)
    surface = shapes.surface(places, triangles, SOLID, GLASS)
    outline = shapes.line(places.tolist(), RIM, kind="loop", pixels=1.0)
    return {"triangles": [surface], "lines": [outline]}


def _cloud(cloud: Cloud) -> dict[str, object]:
    low = cloud.low_m
    high = cloud.high_m
    center = vector.scale(vector.add(low, high), 0.5)
    size_m = vector.subtract(high, low)
    edges = shapes.box_edges(center, size_m, rotation.IDENTITY)
    lines = [shapes.line(edges, RIM, kind="list", pixels=1.0)]
    text = f"{cloud.id}: {cloud.points} points"
    label = shapes.label(text, center)
    return {"lines": lines, "texts": [label]}


def _fence(fence: Fence) -> dict[str, object]:
    """Return the edges of a fence; the sides of one that keeps robots out are filled."""
    rgb = FENCES[fence.kind]
    low_m = max(fence.low_m or 0.0, 0.0) + 0.01
    high_m = low_m + FENCE_M if fence.high_m is None else fence.high_m
    count = len(fence.outline_m)
    bottom = [(x, y, low_m) for x, y in fence.outline_m]
    top = [(x, y, high_m) for x, y in fence.outline_m]
    places = np.array(bottom + top)

    # Edges; one without an upper end is open at the top
    lines = [shapes.line(bottom, rgb, kind="loop")]
    if fence.high_m is not None:
        lines.append(shapes.line(top, rgb, kind="loop"))
    posts: list[Vec3] = []
    for ends in zip(bottom, top, strict=True):
        posts += ends
    lines.append(shapes.line(posts, rgb, kind="list"))
    if fence.kind == "keep_in":
        return {"lines": lines}

    # Two triangles a side
    triangles: list[int] = []
    for start in range(count):
        end = (start + 1) % count
        triangles += (start, end, end + count)
        triangles += (start, end + count, start + count)
    sides = shapes.surface(places, triangles, rgb, 0.25)
    return {"lines": lines, "triangles": [sides]}


def lamps(all_lamps: Iterable[Lamp], colors: Mapping[str, LampColor], now_ns: int) -> list[NamedEntity]:
    """Return a labelled ball per lamp in its commanded colour."""
    entities: list[NamedEntity] = []
    for lamp in all_lamps:
        commanded = colors.get(lamp.id)
        red, green, blue = BLACK if commanded is None else commanded.color
        color = f"{red} {green} {blue}"
        facts = {"kind": "lamp", "id": lamp.id, "color": color}
        shown: Rgb = (max(red, OFF), max(green, OFF), max(blue, OFF))
        ball = shapes.sphere(lamp.position_m, LAMP_M, shown)
        label = shapes.label(lamp.id, shapes.above(lamp.position_m, ABOVE_M))
        name = f"lamp {lamp.id}"
        entity = shapes.entity(name, now_ns, facts=facts, spheres=[ball], texts=[label])
        entities.append(entity)
    return entities


def bays(
    environment: Environment, lines: Lines, state: ConveyorState | None, now_ns: int
) -> list[NamedEntity]:
    """Return a label at the end of each bay's belt: its name, and a line per kind that came out there."""
    entities: list[NamedEntity] = []
    all_counts = () if state is None else state.bays
    for bay in environment.bays:
        if bay.belt not in lines.belts:
            continue
        rows = [f"bay {bay.id}"]
        for count in all_counts:
            if count.bay == bay.id:
                selected = f"{count.selected} selected"
                rows.append(f"{count.kind}: {count.count} ({selected})")
        line, _ = lines.belts[bay.belt]
        end_m = line.point_at(line.length_m)
        text = "\n".join(rows)
        label = shapes.label(text, shapes.above(end_m, 2.0 * ABOVE_M))
        facts = {"kind": "bay", "id": bay.id, "belt": bay.belt}
        entity = shapes.entity(f"bay {bay.id}", now_ns, facts=facts, texts=[label])
        entities.append(entity)
    return entities
