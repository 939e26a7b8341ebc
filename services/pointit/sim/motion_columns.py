"""Names and units of the columns of a recorded motion, as people and programs write them."""

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pointit.maps.column_units import LENGTHS_M, TIMES_S, split_unit

TIME = "t"
ORIENTATION = ("qx", "qy", "qz", "qw")
ROBOT = ("robot_x", "robot_y", "robot_z")
HEAD = ("head_x", "head_y", "head_z")
FLOOR = ("px", "py")

_ALIASES: dict[str, tuple[str, ...]] = {
    TIME: ("t", "time", "timestamp", "ts", "stamp", "elapsed", "elapsedtime", "datetime", "epoch"),
    **{
        name: (name, *(word + name[1:] for word in ("quat", "quaternion", "orientation")))
        for name in ORIENTATION
    },
    **{
        name: (body + axis, f"{body}pos{axis}", f"{body}position{axis}")
        for name in (*ROBOT, *HEAD)
        for body, axis in [name.split("_")]
    },
    **{name: (name,) for name in FLOOR},
}
"""Names without blanks and underscores, by name in the documentation. The first that a file has is used."""

_WITHOUT_UNIT = {"": 1.0, "1": 1.0, "unitless": 1.0}
_TIMES_S = {"": 1.0, **TIMES_S}
_LENGTHS_M = {"": 1.0, **LENGTHS_M}
_CAMEL = re.compile(r"(?<=[a-z\d])(?=[A-Z])")

SUGGESTED_UNITS = {TIME: ("s", "ms", "us", "ns", "min", "hours", "days"), "": ("m", "cm", "mm", "in", "ft")}
"""Units named in messages, by column; `""`: positions."""


class MotionColumn(NamedTuple):
    """A column of a recorded motion: its index, name and unit in the file."""

    position: int
    """Index in the rows."""
    title: str
    """Its name in the file."""
    unit: str
    """`""` if the file does not state it."""
    factor: float = 1.0
    """Size of the unit in SI units."""


def units_of(name: str) -> Mapping[str, float]:
    """Return the known units of a column, and what they are in SI units."""
    if name in ORIENTATION:
        return _WITHOUT_UNIT
    return _TIMES_S if name == TIME else _LENGTHS_M


def find_columns(header: Sequence[str]) -> dict[str, list[MotionColumn]]:
    """Return the columns for each name of the documentation that the file has."""
    by_title: dict[str, list[MotionColumn]] = {}
    for index, cell in enumerate(header):
        title, unit = split_unit(cell if re.search(r"[\[({<]", cell) else _CAMEL.sub("_", cell))
        by_title.setdefault(title.replace("_", ""), []).append(MotionColumn(index, cell, unit))
    found: dict[str, list[MotionColumn]] = {}
    for name, aliases in _ALIASES.items():
        exact = [MotionColumn(index, cell, "") for index, cell in enumerate(header) if cell == name]
        alias = next((each for each in aliases if each in by_title), None)
        if exact or alias is not None:
            found[name] = exact or by_title[str(alias)]
    return found


def count_known(cells: Sequence[str]) -> int:
    """Return the number of names of the documentation for which `cells` have a column."""
    return len(find_columns(cells))
