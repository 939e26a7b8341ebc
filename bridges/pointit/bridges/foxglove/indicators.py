"""Entities that change seldom: colours of lamps, counts at bays."""

from collections.abc import Iterable, Mapping

from pointit.bridges.foxglove import shapes
from pointit.bridges.foxglove.room import Lines
from pointit.bridges.foxglove.shapes import NamedEntity
from pointit.schemas import ConveyorState, Environment, Lamp, LampColor

LAMP_M = 0.09
OFF = 45
"""Minimum grey of a lamp that is off."""
ABOVE_M = 0.2


def lamps(all_lamps: Iterable[Lamp], colors: Mapping[str, LampColor], now_ns: int) -> list[NamedEntity]:
    """Return a labelled ball per lamp in its commanded colour."""
    entities: list[NamedEntity] = []
    for lamp in all_lamps:
        told = colors.get(lamp.id)
        r, g, b = (0, 0, 0) if told is None else told.color
        facts = {"kind": "lamp", "id": lamp.id, "color": f"{r} {g} {b}"}
        x, y, z = lamp.position_m
        entities.append(
            shapes.entity(
                f"lamp {lamp.id}",
                now_ns,
                facts=facts,
                spheres=[shapes.sphere((x, y, z), LAMP_M, (max(r, OFF), max(g, OFF), max(b, OFF)))],
                texts=[shapes.label(lamp.id, (x, y, z + ABOVE_M))],
            )
        )
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
        words = "\n".join((f"bay {bay.id}", *rows))
        entities.append(
            shapes.entity(
                f"bay {bay.id}",
                now_ns,
                facts={"kind": "bay", "id": bay.id, "belt": bay.belt},
                texts=[shapes.label(words, (x, y, z + 2.0 * ABOVE_M))],
            )
        )
    return entities
