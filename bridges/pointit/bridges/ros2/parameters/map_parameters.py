"""A map as the parameters of a ROS node: `strips.1.line: [x, y, z, x, y, z]`, and back.

A parameter is called SECTION.NAME.KEY. The name may have dots in it, so nothing is nested deeper, whatever a
node says. Bays have no keys, `bays.1: side`; links have numbers, `links.0.from: main`. Only the light and the
place of a thing are nested: `things.nuts.light.strip`, `things.exit.at.belt`.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

from pointit.bridges.ros2.parameters.values import Value

BAYS, LINKS = "bays", "links"
SECTIONS = frozenset(
    (
        "lamps",
        "leds",  # of the ROS toolkit
        "strips",
        "belts",
        LINKS,
        BAYS,
        "boxes",
        "planes",
        "cylinders",
        "spheres",
        "clouds",
        "fences",
        "frames",
        "things",
    )
)
"""Sections of a map's file; docs/reference/maps.md describes them."""
LINES = {"line": "x, y, z", "centerline": "x, y, z", "outline": "x, y"}
"""Keys of lists of points, flattened: ROS has no lists of lists. Coordinates of each point."""

NESTED, PART = ("light", "at"), frozenset(("strip", "belt", "from", "to"))
"""Keys of a thing whose value may be a part of a strip or belt, and the keys of that."""

NUMBER = re.compile(r"[0-9]{1,6}")
"""Number of a link."""


def of_maps(names: Iterable[str], prefix: str = "") -> list[str]:
    """Return those of `names` that belong to a map below `prefix` (`site.map`).

    Without a prefix those that begin with a section, below one all names.
    """
    start = _start(prefix)
    return [name for name in names if name.startswith(start) and (prefix or _section(name) in SECTIONS)]


def prefixes(names: Iterable[str]) -> list[str]:
    """Return the prefixes in `names` below which a map may be."""
    found: dict[str, None] = {}
    for name in names:
        parts = name.split(".")
        for index, part in enumerate(parts[1:-1], start=1):
            if part in SECTIONS:
                found[".".join(parts[:index])] = None
                break
    return list(found)


def tree_of(parameters: Mapping[str, Value], prefix: str = "") -> dict[str, Any]:
    """Return the map in `parameters` below `prefix` as in its file, unchecked.

    Raises:
        ValueError: If a parameter's name or its list is not one of a map; names it and says what to write.
    """
    tree: dict[str, Any] = {}
    start = _start(prefix)
    for name, value in parameters.items():
        section, _, rest = name.removeprefix(start).partition(".")
        if section == BAYS and rest:
            tree.setdefault(section, {})[rest] = value
            continue
        entry, _, key = rest.rpartition(".")
        if not (section and entry and key):
            raise ValueError(
                f"{name} is not a parameter of a map; they are called {start}SECTION.NAME.KEY, as in "
                f"{start}leds.door.position"
            )
        if section == LINKS and not NUMBER.fullmatch(entry):
            raise ValueError(f"{name}: links have numbers, as in {start}links.0.{key}")
        entries = tree.setdefault(section, {})
        thing, _, outer = entry.rpartition(".")
        if section == "things" and key in PART and thing and outer in NESTED:
            entries.setdefault(thing, {}).setdefault(outer, {})[key] = value
            continue
        entries.setdefault(entry, {})[key] = _points(name, value, LINES[key]) if key in LINES else value
    if LINKS in tree:
        links = cast("dict[str, Any]", tree[LINKS])
        tree[LINKS] = [links[number] for number in sorted(links, key=int)]
    return tree


def parameters_of(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Value]:
    """Return the parameters of the valid map `tree`."""
    start = _start(prefix)
    parameters: dict[str, Value] = {}
    for section, inside in tree.items():
        for name, entry in _entries(inside):
            if section == BAYS:
                parameters[f"{start}{section}.{name}"] = entry
            else:
                for key, value in entry.items():
                    part = cast("dict[str, Any]", value) if isinstance(value, dict) else {"": value}
                    where = f"{start}{section}.{name}.{key}"
                    parameters |= {f"{where}.{each}".rstrip("."): _flat(part[each]) for each in part}
    return parameters


def _entries(section: Any) -> Iterable[tuple[object, Any]]:
    if isinstance(section, list):
        return enumerate(cast("Sequence[Any]", section))
    return cast("dict[object, Any]", section or {}).items()


def _start(prefix: str) -> str:
    return f"{prefix}." if prefix else ""


def _section(name: str) -> str:
    section, dot, _ = name.partition(".")
    return section if dot else ""


def _points(name: str, value: Value, coordinates: str) -> Value:
    """Return a list of numbers as a list of points. Other values are left to the map's check."""
    if not isinstance(value, list):
        return value
    size = len(coordinates.split())
    if len(value) % size:
        raise ValueError(
            f"{name} has {len(value)} numbers; write {coordinates} of one point after the other, "
            f"{('two', 'three')[size - 2]} for each"
        )
    return [value[index : index + size] for index in range(0, len(value), size)]


def _flat(value: Any) -> Value:
    """Return lists of points as one list; integers become floats if one number has a fraction."""
    if not isinstance(value, list):
        return cast("Value", value)
    numbers: list[Any] = []
    for each in cast("Sequence[Any]", value):
        numbers += cast("Sequence[Any]", each) if isinstance(each, list) else [each]
    return [float(number) for number in numbers] if float in map(type, numbers) else numbers
