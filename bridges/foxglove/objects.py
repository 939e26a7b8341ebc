"""Entities of moving objects on the lines of a map, with their owners."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from foxglove.messages import CubePrimitive, LinePrimitive, TextPrimitive

from pointit.bridges.foxglove import shapes
from pointit.bridges.foxglove.people import LIFETIME_S
from pointit.bridges.foxglove.room import Lines
from pointit.bridges.foxglove.shapes import NamedEntity
from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.plugins import rotation
from pointit.schemas import Hover, Selection, TrackedObject
from pointit.schemas.base import Rgb
from pointit.schemas.environment import KIND_COLORS, OTHER_COLOR

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

SELECTED_PIXELS = 4.0
HOVERED_PIXELS = 2.0
RESERVED_PIXELS = 1.0
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
            ownership.owners = {item.id: item.user for item in selection.settled}
            ownership.reservers = {item.id: item.user for item in selection.reserved}
            for item in selection.objects:
                if item.is_pending:
                    ownership.reservers[item.id] = item.user
        for user in sorted(hovers):
            hover = hovers[user]
            if hover.object_id:
                of_object = ownership.hovers.setdefault(hover.object_id, [])
                of_object.append((user, hover))
        return ownership


@dataclass(frozen=True, slots=True)
class _Box:
    center_m: Vec3
    size_m: Vec3
    orientation: rotation.Quaternion

    @property
    def above_m(self) -> Vec3:
        height_m = self.size_m[2] / 2.0 + 0.12
        return shapes.above(self.center_m, height_m)


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
        entities: list[NamedEntity] = []
        for item in objects:
            name = f"{tracker} {item.id}"
            entities.append(self._entity(name, item, ownership, colors, now_ns))
        return entities

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

        # Place: packages stand on their belt, segments are in their strip
        line, size_m = self._box(item)
        center = item.position_m
        orientation = rotation.IDENTITY
        if line is not None:
            tangent = line.tangent_at(item.surface_position_m)
            orientation = shapes.towards(tangent)
            rise_m = 0.0
            if item.surface == "belt":
                rise_m = size_m[2] / 2.0
            center = shapes.above(item.position_m, rise_m)
        box = _Box(center, size_m, orientation)

        # Shape: a box, or a ball with its name and velocity
        lines, texts = self._claimed(item, ownership, colors, box, facts)
        primitives: dict[str, Any] = {"lines": lines, "texts": texts}
        if line is not None:
            alpha = 1.0 if item.id in ownership.owners else 0.85
            color = shapes.color(rgb, alpha)
            pose = shapes.pose(center, orientation)
            size = shapes.size(*size_m)
            primitives["cubes"] = [CubePrimitive(pose=pose, size=size, color=color)]
        else:
            primitives["spheres"] = [shapes.sphere(center, size_m[0], rgb)]
            if not texts:
                primitives["texts"] = [shapes.label(item.id, box.above_m)]
            if vector.norm(item.velocity_mps) > MOVES_MPS:
                primitives["arrows"] = [shapes.arrow(center, item.velocity_mps, rgb)]
        return shapes.entity(name, now_ns, lifetime_s=LIFETIME_S, facts=facts, **primitives)

    def _box(self, item: TrackedObject) -> tuple[Polyline | None, Vec3]:
        """Return the object's line, or None if it is on none, and its length, width and height."""
        length_m = item.length_m or USUAL_LENGTH_M
        if item.surface == "belt" and item.surface_id in self._lines.belts:
            line, _ = self._lines.belts[item.surface_id]
            width_m = _share_m(PACKAGE_WIDE, length_m)
            height_m = _share_m(PACKAGE_HIGH, length_m)
            return line, (length_m, width_m, height_m)
        if item.surface == "strip" and item.surface_id in self._lines.strips:
            line, _ = self._lines.strips[item.surface_id]
            return line, (length_m, *SEGMENT)
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

        # Whose it is
        owner = ownership.owners.get(item.id)
        reserver = ownership.reservers.get(item.id)
        if owner is not None:
            outlines.append((colors.get(owner, shapes.WHITE), SELECTED_PIXELS))
            words.append(owner)
            facts["selected by"] = owner
        elif reserver is not None:
            outlines.append((colors.get(reserver, shapes.WHITE), RESERVED_PIXELS))
            facts["reserved by"] = reserver

        # Who is about to act on it
        for user, hover in ownership.hovers.get(item.id, ()):
            outlines.append((colors.get(user, shapes.WHITE), HOVERED_PIXELS))
            progress = f"{hover.progress:.0%}"
            action = f"{progress} {hover.action}"
            facts[f"hovered by {user}"] = action.rstrip()
            if hover.progress > 0.0:
                words.append(f"{user} {progress}")

        lines: list[LinePrimitive] = []
        for number, (rgb, pixels) in enumerate(outlines):
            grown_m = 0.02 + 0.03 * number  # one around the other
            around = vector.add(box.size_m, (grown_m, grown_m, grown_m))
            edges = shapes.box_edges(box.center_m, around, box.orientation)
            lines.append(shapes.line(edges, rgb, kind="list", pixels=pixels))
        if not words:
            return lines, []
        label = shapes.label("\n".join(words), box.above_m)
        return lines, [label]


def _share_m(limits: tuple[float, float, float], length_m: float) -> float:
    """Return the width or height of a package of this length by its share, minimum and maximum."""
    share, least_m, most_m = limits
    return min(max(share * length_m, least_m), most_m)
