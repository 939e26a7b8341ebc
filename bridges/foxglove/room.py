"""Entities of the room, which change seldom: belts, strips, planes, fences, lamps and bays."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from foxglove.messages import CubePrimitive

from pointit.bridges.foxglove import shapes
from pointit.bridges.foxglove.shapes import NamedEntity, Places
from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.solids import plane_axes
from pointit.plugins import rotation
from pointit.schemas import Belt, ConveyorState, Environment, Lamp, LampColor, Strip, Thing
from pointit.schemas.base import Rgb
from pointit.schemas.environment import Cloud, Fence, Plane

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
            if line := self._line("belt", belt):
                self.belts[belt.id] = (line, belt)
        for strip in environment.strips:
            if line := self._line("strip", strip):
                self.strips[strip.id] = (line, strip)

    def _line(self, what: str, line: Belt | Strip) -> Polyline | None:
        try:
            return Polyline(line.line_m)
        except ValueError as error:
            self.problems.append(f"{what} {line.id!r} cannot be drawn ({error}); correct the map")
            return None


def ribbon(line: Polyline, width_m: float) -> tuple[Places, list[int]]:
    """Return a level ribbon along `line`: 2 n places, left and right of each vertex, and its triangles.

    In bends its two rims stay `width_m` apart; where a bend is sharper than `SHARPEST` says, its corner
    is cut. Pieces that go straight up are as wide as the piece before.
    """
    across = np.column_stack([-line.tangents[:, 1], line.tangents[:, 0]])
    lengths = np.linalg.norm(across, axis=1)
    upright = lengths < 1e-6
    across[upright] = (0.0, 1.0)
    lengths[upright] = 1.0
    across /= lengths[:, None]
    for index in np.flatnonzero(upright[1:]) + 1:
        across[index] = across[index - 1]
    before = np.vstack([across[:1], across])
    after = np.vstack([across, across[-1:]])
    middle = before + after
    length = np.linalg.norm(middle, axis=1)
    turns_back = length < 1e-6
    middle[turns_back] = before[turns_back]
    length[turns_back] = 1.0
    middle /= length[:, None]
    cosine = np.maximum(np.einsum("nk,nk->n", middle, after), SHARPEST)
    reach_m = np.zeros_like(line.vertices_m)
    reach_m[:, :2] = middle * (width_m / 2.0 / cosine)[:, None]
    places = np.empty((2 * len(reach_m), 3))
    places[0::2] = line.vertices_m + reach_m
    places[1::2] = line.vertices_m - reach_m
    first = range(0, 2 * (len(reach_m) - 1), 2)
    return places, [corner for i in first for corner in (i, i + 1, i + 2, i + 2, i + 1, i + 3)]


def room(environment: Environment, lines: Lines, now_ns: int) -> list[NamedEntity]:
    """Return all entities of `environment` that change only with the map."""

    def made(kind: str, name: str, **primitives: Any) -> NamedEntity:
        facts = {"kind": kind, "id": name}
        return shapes.entity(f"{kind} {name}", now_ns, facts=facts, **primitives)

    entities = [made("belt", name, **_belt(line, belt)) for name, (line, belt) in lines.belts.items()]
    if lines.strips:
        drawn = [shapes.line(line.vertices_m.tolist(), BELT) for line, _ in lines.strips.values()]
        entities.append(shapes.entity("strips", now_ns, lines=drawn))
    boxes = [
        *(("box", each) for each in environment.boxes),
        *(("thing", each) for each in environment.fixed_things),
    ]
    for kind, box in boxes:
        turned = rotation.from_yaw(box.yaw_rad)
        pose = shapes.pose(box.center_m, turned)
        size = shapes.size(*box.size_m)
        cube = CubePrimitive(pose=pose, size=size, color=shapes.color(SOLID, GLASS))
        edges = shapes.line(shapes.box_edges(box.center_m, box.size_m, turned), RIM, kind="list", pixels=1.0)
        above = vector.add(box.center_m, (0.0, 0.0, box.size_m[2] / 2.0 + LAMP_M))
        texts = [shapes.label(box.label or box.id, above)] if isinstance(box, Thing) else []
        entities.append(made(kind, box.id, cubes=[cube], lines=[edges], texts=texts))
    entities += [made("plane", plane.id, **_plane(plane)) for plane in environment.planes]
    for each in environment.cylinders:
        shape = shapes.cylinder(each.center_m, each.height_m, 2.0 * each.radius_m, SOLID, alpha=GLASS)
        entities.append(made("cylinder", each.id, cylinders=[shape]))
    for sphere in environment.spheres:
        shown = shapes.sphere(sphere.center_m, 2.0 * sphere.radius_m, SOLID, GLASS)
        entities.append(made("sphere", sphere.id, spheres=[shown]))
    entities += [made("cloud", cloud.id, **_cloud(cloud)) for cloud in environment.clouds]
    entities += [made("fence", fence.id, **_fence(fence)) for fence in environment.fences]
    for lamp in environment.lamps:
        x, y, z = lamp.position_m
        if z > POLE_M:
            pole = shapes.cylinder((x, y, 0.0), z, POLE_M, RIM)
            entities.append(made("pole", lamp.id, cylinders=[pole]))
    return entities


def _belt(line: Polyline, belt: Belt) -> dict[str, object]:
    places, triangles = ribbon(line, belt.width_m)
    middle_m = line.length_m / 2.0
    way = vector.scale(line.tangent_at(middle_m), min(0.4, line.length_m / 2.0))
    above = vector.add(line.point_at(middle_m), (0.0, 0.0, 0.01))
    rim = np.vstack([places[0::2], places[-1::-2]]).tolist()
    return {
        "triangles": [shapes.surface(places, triangles, BELT)],
        "lines": [shapes.line(rim, RIM, kind="loop", pixels=1.5)],
        "arrows": [shapes.arrow(above, way, RIM, width_m=0.015)],
    }


def _plane(plane: Plane) -> dict[str, object]:
    u, v = plane_axes(plane.normal)
    wide_m, high_m = plane.size_m or (ENDLESS_M, ENDLESS_M)
    across = vector.scale(u, wide_m / 2.0)
    up = vector.scale(v, high_m / 2.0)
    signs = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
    offsets = [vector.add(vector.scale(across, a), vector.scale(up, b)) for a, b in signs]
    corners = np.array([vector.add(plane.center_m, offset) for offset in offsets])
    return {
        "triangles": [shapes.surface(corners, (0, 1, 2, 0, 2, 3), SOLID, GLASS)],
        "lines": [shapes.line(corners.tolist(), RIM, kind="loop", pixels=1.0)],
    }


def _cloud(cloud: Cloud) -> dict[str, object]:
    low = cloud.low_m
    high = cloud.high_m
    center = vector.scale(vector.add(low, high), 0.5)
    edges = shapes.box_edges(center, vector.subtract(high, low), rotation.IDENTITY)
    lines = [shapes.line(edges, RIM, kind="list", pixels=1.0)]
    return {"lines": lines, "texts": [shapes.label(f"{cloud.id}: {cloud.points} points", center)]}


def _fence(fence: Fence) -> dict[str, object]:
    """Return the edges of a fence; the sides of one that keeps robots out are filled."""
    rgb = FENCES[fence.kind]
    low_m = max(fence.low_m or 0.0, 0.0) + 0.01
    high_m = low_m + FENCE_M if fence.high_m is None else fence.high_m
    count = len(fence.outline_m)
    places = np.array([(x, y, z) for z in (low_m, high_m) for x, y in fence.outline_m])
    sides = [(at, (at + 1) % count) for at in range(count)]
    lines = [shapes.line(places[:count].tolist(), rgb, kind="loop")]
    if fence.high_m is not None:
        lines.append(shapes.line(places[count:].tolist(), rgb, kind="loop"))
    posts = places[[end for at in range(count) for end in (at, at + count)]]
    lines.append(shapes.line(posts.tolist(), rgb, kind="list"))
    if fence.kind == "keep_in":
        return {"lines": lines}
    triangles = [i for a, b in sides for i in (a, b, b + count, a, b + count, a + count)]
    return {"lines": lines, "triangles": [shapes.surface(places, triangles, rgb, 0.25)]}


def lamps(all_lamps: Iterable[Lamp], colors: Mapping[str, LampColor], now_ns: int) -> list[NamedEntity]:
    """Return a labelled ball per lamp in its commanded colour."""
    entities: list[NamedEntity] = []
    for lamp in all_lamps:
        color = colors.get(lamp.id)
        r, g, b = (0, 0, 0) if color is None else color.color
        facts = {"kind": "lamp", "id": lamp.id, "color": f"{r} {g} {b}"}
        x, y, z = lamp.position_m
        ball = shapes.sphere((x, y, z), LAMP_M, (max(r, OFF), max(g, OFF), max(b, OFF)))
        label = shapes.label(lamp.id, (x, y, z + ABOVE_M))
        entities.append(shapes.entity(f"lamp {lamp.id}", now_ns, facts=facts, spheres=[ball], texts=[label]))
    return entities


def bays(
    environment: Environment, lines: Lines, state: ConveyorState | None, now_ns: int
) -> list[NamedEntity]:
    """Return a label at the end of each bay's belt: its name, and a line per kind that came out there."""
    entities: list[NamedEntity] = []
    for bay in environment.bays:
        if bay.belt not in lines.belts:
            continue
        line = lines.belts[bay.belt][0]
        x, y, z = line.point_at(line.length_m)
        counts = [count for count in (() if state is None else state.bays) if count.bay == bay.id]
        rows = [f"{count.kind}: {count.count} ({count.selected} selected)" for count in counts]
        label = shapes.label("\n".join((f"bay {bay.id}", *rows)), (x, y, z + 2.0 * ABOVE_M))
        facts = {"kind": "bay", "id": bay.id, "belt": bay.belt}
        entities.append(shapes.entity(f"bay {bay.id}", now_ns, facts=facts, texts=[label]))
    return entities
