"""Entities of the scene: moving objects, people, and what changes seldom in the room."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from foxglove.messages import CubePrimitive, FrameTransform, LinePrimitive, Quaternion, TextPrimitive

from pointit.bridges.foxglove import shapes
from pointit.bridges.foxglove.shapes import NamedEntity, Places
from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.solids import plane_axes
from pointit.geometry.vector import Vec3
from pointit.plugins import rotation
from pointit.schemas import (
    Belt,
    ConveyorState,
    Cursor,
    Environment,
    Goal,
    Hover,
    Lamp,
    LampColor,
    Selection,
    Strip,
    Thing,
    TrackedObject,
    UserPose,
    UserProfile,
)
from pointit.schemas.base import Rgb
from pointit.schemas.environment import KIND_COLORS, OTHER_COLOR, Cloud, Fence, Plane
from pointit.schemas.topics import POSE
from pointit.sim.aim import Stance

LIFETIME_S = 2.0
"""Lifetime of an entity, s, for viewers that missed its deletion."""
NO_PROFILE = UserProfile(stamp_ns=0)
"""Profile of a person who has not published one."""

SIGMAS = 2.0
"""Size of the position's ellipse, in standard deviations."""
SMALLEST_M = 5e-3
"""An ellipse with a shorter major half-axis is not drawn: the position is known."""
FREE_RAY_M = 4.0
"""Drawn length of a ray that meets nothing, as in the page (`appearance.ts`)."""
CURSOR_M = 0.08
GOAL_M = 0.5
"""Length of the arrow at a goal."""
GOAL_ABOVE_M = 0.03
"""Height of the arrow above the floor, to be visible."""
TORSO_M, HEAD_M, ARM_M, RAY_M = 0.34, 0.22, 0.07, 0.012
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)


@dataclass(slots=True)
class DrawnPerson:
    """Last messages of one person."""

    profile: UserProfile = NO_PROFILE
    pose: UserPose | None = None
    cursor: Cursor | None = None
    goal: Goal | None = None
    """Last goal that the person sent a robot to."""

    @property
    def color(self) -> Rgb:
        """Return the person's colour."""
        return self.profile.cursor_color


def frame_of(user: str) -> str:
    """Return the name of the person's frame {H}, beside the key of their pose."""
    return POSE.at(user).rpartition("/")[0] + "/feet"


def transform(user: str, pose: UserPose, now_ns: int) -> FrameTransform:
    """Return {H} of `user` in {W}."""
    x, y, z, w = rotation.from_yaw(pose.yaw_rad)
    return FrameTransform(
        timestamp=shapes.timestamp(now_ns),
        parent_frame_id=shapes.WORLD,
        child_frame_id=frame_of(user),
        translation=shapes.size(*pose.position_m),
        rotation=Quaternion(x=x, y=y, z=z, w=w),
    )


def ellipse(pose: UserPose) -> Places | None:
    """Return the points of the `SIGMAS` ellipse around the position, or None if it is too small to see."""
    spread = np.array(pose.covariance).reshape(3, 3)[:2, :2]
    variances, axes = np.linalg.eigh((spread + spread.T) / 2.0)
    halves_m = SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    if halves_m[1] < SMALLEST_M:
        return None
    around = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)]) * halves_m @ axes.T
    rim: Places = np.column_stack([around, np.full(len(around), 0.01)]) + np.array(pose.position_m)
    return rim


def entities(user: str, person: DrawnPerson, now_ns: int) -> list[NamedEntity]:
    """Return the body of `user` if the position is known, ray and cursor while pointing, and the goal."""
    entities: list[NamedEntity] = []
    if person.pose is not None:
        entities.append(_body(user, person, person.pose, now_ns))
    if person.cursor is not None:
        entities += _pointing(user, person.cursor, person.color, now_ns)
    if person.goal is not None:
        entities.append(_goal(user, person.goal, person.color, now_ns))
    return entities


def _body(user: str, person: DrawnPerson, pose: UserPose, now_ns: int) -> NamedEntity:
    profile, rgb = person.profile, person.color
    stance = Stance(profile.body, profile.hand, pose.position_m, ray_model=profile.ray_model)
    neck_m = profile.body.footprint_to_neck_m
    limbs = [shapes.cylinder(pose.position_m, neck_m, TORSO_M, rgb, alpha=0.75, waist=0.6)]
    cursor = person.cursor
    if cursor is not None and cursor.origin_m is not None and cursor.direction is not None:
        met = vector.add(cursor.origin_m, vector.scale(cursor.direction, cursor.range_m or FREE_RAY_M))
        azimuth, elevation = stance.aim_at(met)
        arm = vector.scale(vector.direction(azimuth, elevation), stance.arm_m)
        shoulder = stance.shoulder_m(azimuth)
        limbs.append(shapes.cylinder_between(shoulder, vector.add(shoulder, arm), ARM_M, rgb))
    rim = ellipse(pose)
    return shapes.entity(
        f"person {user}",
        now_ns,
        facts={"user": user, "located by": pose.method, "samples": str(pose.samples)},
        cylinders=limbs,
        spheres=[shapes.sphere(stance.eyes_m, HEAD_M, rgb)],
        lines=[] if rim is None else [shapes.line(rim.tolist(), rgb, kind="loop")],
        texts=[shapes.label(user, vector.add(stance.eyes_m, (0.0, 0.0, 0.3)), rgb)],
    )


def _pointing(user: str, cursor: Cursor, rgb: Rgb, now_ns: int) -> list[NamedEntity]:
    entities: list[NamedEntity] = []
    point_m: Vec3 | None = cursor.point_m
    if cursor.origin_m is not None and cursor.direction is not None:
        way = vector.scale(cursor.direction, FREE_RAY_M if point_m is None else max(cursor.range_m, 0.1))
        alpha = 0.3 if point_m is None else 0.8
        ray = shapes.arrow(cursor.origin_m, way, rgb, width_m=RAY_M, alpha=alpha)
        facts = {"user": user}
        entities.append(
            shapes.entity(f"ray {user}", now_ns, lifetime_s=LIFETIME_S, facts=facts, arrows=[ray])
        )
    if point_m is not None:
        on = cursor.solid or cursor.surface
        facts = {"user": user, "on": f"{on} {cursor.surface_id}", "miss_m": f"{cursor.miss_m:.3f}"}
        ball = shapes.sphere(point_m, CURSOR_M, rgb)
        entities.append(
            shapes.entity(f"cursor {user}", now_ns, lifetime_s=LIFETIME_S, facts=facts, spheres=[ball])
        )
    return entities


def _goal(user: str, goal: Goal, rgb: Rgb, now_ns: int) -> NamedEntity:
    foot = vector.add(goal.position_m, (0.0, 0.0, GOAL_ABOVE_M))
    arrow = shapes.arrow(foot, vector.scale(vector.direction(goal.yaw_rad, 0.0), GOAL_M), rgb, width_m=0.05)
    label = shapes.label(f"goal of {user}", vector.add(foot, (0.0, 0.0, 0.4)), rgb)
    facts = {"user": user, "on": goal.surface_id, "sigma_m": f"{goal.position_sigma_m:.3f}"}
    return shapes.entity(f"goal {user}", now_ns, facts=facts, arrows=[arrow], texts=[label])


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
    across[upright], lengths[upright] = (0.0, 1.0), 1.0
    across /= lengths[:, None]
    for index in np.flatnonzero(upright[1:]) + 1:
        across[index] = across[index - 1]
    before, after = np.vstack([across[:1], across]), np.vstack([across, across[-1:]])
    middle = before + after
    length = np.linalg.norm(middle, axis=1)
    turns_back = length < 1e-6
    middle[turns_back], length[turns_back] = before[turns_back], 1.0
    middle /= length[:, None]
    cosine = np.maximum(np.einsum("nk,nk->n", middle, after), SHARPEST)
    reach_m = np.zeros_like(line.vertices_m)
    reach_m[:, :2] = middle * (width_m / 2.0 / cosine)[:, None]
    places = np.empty((2 * len(reach_m), 3))
    places[0::2], places[1::2] = line.vertices_m + reach_m, line.vertices_m - reach_m
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
        pose, size = shapes.pose(box.center_m, turned), shapes.size(*box.size_m)
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
    across, up = vector.scale(u, wide_m / 2.0), vector.scale(v, high_m / 2.0)
    signs = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
    offsets = [vector.add(vector.scale(across, a), vector.scale(up, b)) for a, b in signs]
    corners = np.array([vector.add(plane.center_m, offset) for offset in offsets])
    return {
        "triangles": [shapes.surface(corners, (0, 1, 2, 0, 2, 3), SOLID, GLASS)],
        "lines": [shapes.line(corners.tolist(), RIM, kind="loop", pixels=1.0)],
    }


def _cloud(cloud: Cloud) -> dict[str, object]:
    low, high = cloud.low_m, cloud.high_m
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


LAMP_M = 0.09
OFF = 45
"""Minimum grey of a lamp that is off."""
ABOVE_M = 0.2


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


# As in `web/client/src/geometry/appearance.ts`: messages have lengths only.
PACKAGE_WIDE = (0.75, 0.1, 0.34)
"""Width of a package: share of its length, minimum and maximum, m."""
PACKAGE_HIGH = (0.6, 0.1, 0.26)
"""Height of a package: share of its length, minimum and maximum, m."""
SEGMENT = (0.07, 0.06)
"""Width and height of a segment of a strip, m."""
USUAL_LENGTH_M = 0.12
"""Length of an object on a line without a length of its own."""
ROBOT_M = 0.3
"""Diameter of an object that is on no line and has no length."""

SELECTED_PIXELS, HOVERED_PIXELS, RESERVED_PIXELS = 4.0, 2.0, 1.0
MOVES_MPS = 0.05


@dataclass(slots=True)
class ObjectOwnership:
    """Owners, reservers and hovering users by object id."""

    owners: dict[str, str] = field(default_factory=dict[str, str])
    reservers: dict[str, str] = field(default_factory=dict[str, str])
    hovers: dict[str, list[tuple[str, Hover]]] = field(default_factory=dict[str, list[tuple[str, Hover]]])

    @classmethod
    def of(cls, selection: Selection | None, hovers: Mapping[str, Hover]) -> "ObjectOwnership":
        """Return the claims in `selection` and in what each user hovers."""
        ownership = cls()
        if selection is not None:
            ownership.owners = {each.id: each.user for each in selection.objects}
            ownership.reservers = {each.id: each.user for each in selection.reserved}
        for user in sorted(hovers):
            if hovers[user].object_id:
                ownership.hovers.setdefault(hovers[user].object_id, []).append((user, hovers[user]))
        return ownership


@dataclass(frozen=True, slots=True)
class _Box:
    center_m: Vec3
    size_m: Vec3
    turned: rotation.Quaternion

    @property
    def above_m(self) -> Vec3:
        return vector.add(self.center_m, (0.0, 0.0, self.size_m[2] / 2.0 + 0.12))


class ObjectRenderer:
    """Draws objects on the lines of a map."""

    def __init__(self, lines: Lines) -> None:
        self._lines = lines

    def entities(
        self,
        tracker: str,
        objects: Iterable[TrackedObject],
        ownership: ObjectOwnership,
        colors: Mapping[str, Rgb],
        now_ns: int,
    ) -> list[NamedEntity]:
        """Return an entity for each of the `objects` of `tracker`; `colors` are those of people."""
        return [self._entity(f"{tracker} {item.id}", item, ownership, colors, now_ns) for item in objects]

    def _entity(
        self,
        name: str,
        item: TrackedObject,
        ownership: ObjectOwnership,
        colors: Mapping[str, Rgb],
        now_ns: int,
    ) -> NamedEntity:
        rgb = KIND_COLORS.get(item.kind, OTHER_COLOR)
        facts = {"id": item.id, "kind": item.kind}
        if item.bay:
            facts["bay"] = item.bay
        line, size_m = self._box(item)
        if line is None:
            center, turned = item.position_m, rotation.IDENTITY
        else:
            ahead = line.tangent_at(item.surface_position_m)
            turned = rotation.from_azimuth_elevation(vector.azimuth(ahead), vector.elevation(ahead))
            rise_m = size_m[2] / 2.0 if item.surface == "belt" else 0.0
            center = vector.add(item.position_m, (0.0, 0.0, rise_m))
        box = _Box(center, size_m, turned)
        lines, texts = self._claimed(item, ownership, colors, box, facts)
        drawn: dict[str, Any] = {"lines": lines, "texts": texts}
        if line is not None:
            color = shapes.color(rgb, 1.0 if item.id in ownership.owners else 0.85)
            pose, size = shapes.pose(center, turned), shapes.size(*size_m)
            drawn["cubes"] = [CubePrimitive(pose=pose, size=size, color=color)]
        else:
            drawn["spheres"] = [shapes.sphere(center, size_m[0], rgb)]
            drawn["texts"] = texts or [shapes.label(item.id, box.above_m)]
            if vector.norm(item.velocity_mps) > MOVES_MPS:
                drawn["arrows"] = [shapes.arrow(center, item.velocity_mps, rgb)]
        return shapes.entity(name, now_ns, lifetime_s=LIFETIME_S, facts=facts, **drawn)

    def _box(self, item: TrackedObject) -> tuple[Polyline | None, Vec3]:
        """Return the object's line, or None if it is on none, and its length, width and height."""
        length_m = item.length_m or USUAL_LENGTH_M
        if item.surface == "belt" and item.surface_id in self._lines.belts:
            width_m, height_m = (
                min(max(share * length_m, least_m), most_m)
                for share, least_m, most_m in (PACKAGE_WIDE, PACKAGE_HIGH)
            )
            return self._lines.belts[item.surface_id][0], (length_m, width_m, height_m)
        if item.surface == "strip" and item.surface_id in self._lines.strips:
            return self._lines.strips[item.surface_id][0], (length_m, *SEGMENT)
        diameter_m = item.length_m or ROBOT_M
        return None, (diameter_m, diameter_m, diameter_m)

    def _claimed(
        self,
        item: TrackedObject,
        ownership: ObjectOwnership,
        colors: Mapping[str, Rgb],
        box: _Box,
        facts: dict[str, str],
    ) -> tuple[list[LinePrimitive], list[TextPrimitive]]:
        """Return outlines and labels of owners, the owner's outline the thickest. Adds them to `facts`."""
        outlines: list[tuple[Rgb, float]] = []
        words: list[str] = []
        owner, reserver = ownership.owners.get(item.id), ownership.reservers.get(item.id)
        if owner is not None:
            outlines.append((colors.get(owner, shapes.WHITE), SELECTED_PIXELS))
            words.append(owner)
            facts["selected by"] = owner
        elif reserver is not None:
            outlines.append((colors.get(reserver, shapes.WHITE), RESERVED_PIXELS))
            facts["reserved by"] = reserver
        for user, hover in ownership.hovers.get(item.id, ()):
            outlines.append((colors.get(user, shapes.WHITE), HOVERED_PIXELS))
            facts[f"hovered by {user}"] = f"{hover.progress:.0%} {hover.action}".rstrip()
            if hover.progress > 0.0:
                words.append(f"{user} {hover.progress:.0%}")
        lines: list[LinePrimitive] = []
        for number, (rgb, pixels) in enumerate(outlines):
            grown_m = 0.02 + 0.03 * number  # one around the other
            around = vector.add(box.size_m, (grown_m, grown_m, grown_m))
            edges = shapes.box_edges(box.center_m, around, box.turned)
            lines.append(shapes.line(edges, rgb, kind="list", pixels=pixels))
        return lines, [shapes.label("\n".join(words), box.above_m)] if words else []
