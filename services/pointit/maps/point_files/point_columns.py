"""Columns x, y and z of a table: its dialect, their names and numbers."""

import csv
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from pointit.maps.column_units import split_unit
from pointit.maps.point_files.stated_units import StatedUnit, unit_factors, units_of_names
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError

AXES = ("x", "y", "z")
_DIGITS = ("0", "1", "2")
_JOINED_STEMS = ("p", "pos", "position", "pt", "point", "points", "coord", "loc", "location")
"""Words to which programs append the axis without a blank, `PosX`."""
_OTHER_VECTORS = {
    *("n", "normal", "normals", "ori", "orientation", "rot", "rotation", "dir", "direction"),
    *("v", "vel", "velocity", "acc", "accel", "acceleration"),
    *("gyro", "mag", "size", "scale", "sigma", "std"),
}
"""Words in names of vectors that are no positions."""
_MAP_AXES = {
    **dict.fromkeys(("easting", "east", "rechtswert"), "x"),
    **dict.fromkeys(("northing", "north", "hochwert"), "y"),
    **dict.fromkeys(("elevation", "elev", "altitude", "height", "höhe"), "z"),
}
_MAP_WORDS = {"east", "north", "altitude"}
"""Words beside an axis: `X/East`."""
_METRES = {"m", "xyz"}
"""Words between the name and the axis: `Points_m_XYZ:0`."""
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_UNIT_BEHIND_BLANK = re.compile(r"(?<=\S)\s+(?=[\[({])")


@dataclass(frozen=True, kw_only=True)
class PointColumns:
    """Columns of x, y and z."""

    indices: tuple[int, int, int]
    units: tuple[StatedUnit, ...] = ()
    """Units that their names state."""


def delimiter_of(row: str) -> str | None:
    """Return the character between the numbers of `row`, None for blanks. A decimal comma is none."""
    for each in "\t;|":
        if each in row:
            return each
    words = row.split()
    if "," not in row or (
        len(words) > 2
        and "." not in row
        and all(_DECIMAL_COMMA.fullmatch(word) or "," not in word for word in words)
    ):
        return None
    return ","


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of `line` without quotes, without empty ones at its end."""
    text = line.strip(" \r\n")
    if delimiter is None:
        cells = _UNIT_BEHIND_BLANK.sub("", text).split()
    elif '"' in text:
        cells = next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), list[str]())
    else:
        cells = text.split(delimiter)
    cells = [cell.strip().strip("\"'").strip() for cell in cells]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def point_columns(header: Sequence[str]) -> PointColumns | None:
    """Return the columns that the names in `header` give, None if they give no position or several.

    Raises:
        ConfigError: If a unit is not a length, or some of the three have one and others none.
    """
    by_stem: defaultdict[str, defaultdict[str, list[int]]] = defaultdict(lambda: defaultdict(list))
    for index, column in enumerate(header):
        stem, axis = _stem_and_axis(split_unit(column)[0])
        if axis:
            by_stem[stem][axis].append(index)
    triples = {stem: axes for stem, axes in by_stem.items() if len(axes) == 3}
    if "*" not in triples:
        triples = {stem: axes for stem, axes in triples.items() if not _OTHER_VECTORS & set(stem.split("_"))}
    if "*" not in triples and len(triples) != 1:
        return None
    chosen = triples["*"] if "*" in triples else next(iter(triples.values()))
    if any(len(indices) > 1 for indices in chosen.values()):
        return None
    x, y, z = (chosen[axis][0] for axis in AXES)
    units = units_of_names([header[index] for index in (x, y, z)])
    unit_factors(units, remedy=", such as 'X [mm]', or write columns and scale in the map")
    return PointColumns(indices=(x, y, z), units=units)


def named_columns(wanted: Sequence[str | int], header: Sequence[str], count: int) -> PointColumns:
    """Return the columns that a map names: by the names in `header`, or by numbers from 1 to `count`.

    Raises:
        ConfigError: If there is no such column, or two have its name.
    """
    indices: list[int] = []
    names = [split_unit(column)[0] for column in header]
    for column in wanted:
        if isinstance(column, int):
            at = [column - 1] if 1 <= column <= count else []
        else:
            at = [index for index, each in enumerate(header) if each == column] or [
                index for index, name in enumerate(names) if name == split_unit(column)[0]
            ]
        if len(at) != 1:
            there = f"its columns are {join_names(header)}" if header else f"it has {count} columns, no names"
            problem = "names several columns" if at else "is no column"
            raise ConfigError(
                f"{format_value(column)} of columns {problem}, {there}; "
                f"give names, or numbers from 1 to {count}"
            )
        indices += at
    x, y, z = indices
    units = units_of_names([header[index] for index in indices]) if max(indices) < len(header) else ()
    return PointColumns(indices=(x, y, z), units=units)


def is_number(cell: str) -> bool:
    """Return True if `cell` is a number, with a decimal point or comma."""
    try:
        float(cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell)
    except ValueError:
        return False
    return True


def is_numbering(lines: Sequence[str]) -> bool:
    """Return True if the first of two `lines` numbers the columns from 0, as pandas does, and is no point."""
    first, *rest = [cells_of(line, delimiter_of(line.strip())) for line in lines]
    is_count = len(first) > 2 and first == [str(column) for column in range(len(first))]
    return is_count and any("." in cell for row in rest for cell in row)


def _stem_and_axis(name: str) -> tuple[str, str]:
    """Return `name` with `*` for its axis, and the axis; `""` if it is not of one."""
    words = [word for word in name.split("_") if word not in _MAP_WORDS] or name.split("_")
    axes = [word for word in words if word in AXES]
    if len(axes) == 1:
        return "_".join("*" if word in AXES else word for word in words), axes[0]
    if name in _MAP_AXES:
        return "map", _MAP_AXES[name]
    if name[-1:] in AXES and name[:-1] in _JOINED_STEMS:
        return f"{name[:-1]}_*", name[-1]
    if len(words) > 1 and words[0] in _JOINED_STEMS and words[-1] in _DIGITS and {*words[1:-1]} <= _METRES:
        return f"{words[0]}_*", AXES[_DIGITS.index(words[-1])]
    return name, ""
