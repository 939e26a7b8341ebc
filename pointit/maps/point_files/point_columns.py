"""Columns x, y and z of a table: dialect, names, stated units, and reasons against columns without names."""

import csv
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.maps.column_units import LENGTHS_M, split_unit, unit_name
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError

Triple = tuple[float, float, float]

_WORD = r"([a-zµμáéíóúèà]+(?:[ _-](?:survey[ _-])?f(?:ee|oo)t)?)(?!\w)"
_NUMBER = r"([0-9]*\.?[0-9]+(?:e[+-]?[0-9]+)?)?"
_UNIT_WORD = r"(?:(?:units?|unidad(?:es)?|einheit(?:en)?|maßeinheit|scale|unit[éàe]s?)(?!\w))"
_AXES = r"x[\s,;/]+y[\s,;/]+(?:and\s+)?z"
_SUBJECT = (
    rf"(?:{_AXES}|xyz|coordinates?|coords?|positions?|points?|vertices|values?|lengths?|distances?|dimensions?|"
    r"measurements?|data|all|everything|koordinaten|werte|coordonnées|coordenadas|coordinate|posiciones)(?!\w)"
)
_FILLER = (
    r"(?:[\s,:=()\[\]/*-]|\b(?:x|y|z|xyz|are|is|all|given|measured|expressed|stated|stored|saved|"
    r"and|of|the|sind|sont)\b)*"
)
_STATEMENTS = (
    re.compile(
        rf"(?<![a-z]){_UNIT_WORD}(?:\s+(?:of|for)\s+\w+)*[\s:=,;\[(\"']*(?:(?:is|are|in|ist|est)\s+)?"
        rf"{_NUMBER}\s*{_WORD}",
        re.IGNORECASE,
    ),
    re.compile(rf"(?<![a-z]){_SUBJECT}{_FILLER}\b(?:in|en)\s+(){_WORD}", re.IGNORECASE),
    re.compile(rf"(?<![a-z]){_SUBJECT}\s*[\[(]\s*(){_WORD}\s*[\])]", re.IGNORECASE),
)
"""Statements in prose. The groups are a factor and a unit."""
_ALONE = re.compile(rf"[\[(]?()(?!in\b){_WORD}[\])]?", re.IGNORECASE)
"""A unit without other words."""
_UNKNOWN = re.compile(r"\W*(?:units|(?:\w+[ _-])?length[ _-]units?)\s*[:=]\s*([^\W\d]+)\W*", re.IGNORECASE)
"""A unit that stands alone in a comment."""
_MAX_COMMENT = 500
"""Characters of a comment that are searched."""
_MORE_WORDS = re.compile(rf"[\s,;/]+{_WORD}", re.IGNORECASE)
_UNIT_OF_AXES = re.compile(rf"({_AXES})[\s,:]*(?:\bin\s+|[\[(]\s*){_WORD}\s*[\])]?[.\s]*$", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class StatedUnit:
    """A statement of a file about the unit of its coordinates."""

    text: str
    """The statement, or the problem if it is not understood."""
    units_m: Triple | None
    """Length of one unit of x, y and z, m. None if it is not understood."""


def unit_factors(stated: Sequence[StatedUnit], scale: float | None = None, remedy: str = "") -> Triple:
    """Return the factors of x, y and z to metres.

    Args:
        stated: statements of the file.
        scale: factor that the map gives, None if none. It decides between statements, and replaces those that
            are not understood.
        remedy: what to do beside correcting the file, the end of a sentence.

    Raises:
        ConfigError: If statements differ, one is not understood, or `scale` is another one. Does not name the
            file.
    """
    factor = 1.0 if scale is None else scale
    scaled = factor, factor, factor
    if not stated:
        return scaled
    first = stated[0]
    other = next((each for each in stated if each.units_m is None or each.units_m != first.units_m), None)
    if other is None:
        units_m = first.units_m or scaled
        if scaled[0] in (1.0, *units_m):
            return units_m
        if set(units_m) != {1.0}:
            raise ConfigError(
                f"states a unit of {units_m[0]:g} m, and the map has scale {scaled[0]:g}; "
                "remove scale from the map"
            )
    elif scale is None:
        is_unknown = other.units_m is None
        problem = other.text if is_unknown else f"states two units, {first.text} and {other.text}"
        raise ConfigError(f"{problem}; {'rename it' if is_unknown else 'keep the right one'}{remedy}")
    return scaled


def units_of_names(columns: Sequence[str]) -> tuple[StatedUnit, ...]:
    """Return the units in the names of the columns of x, y and z, empty if there are none."""
    units = [split_unit(column)[1] for column in columns]
    if not any(units):
        return ()
    for column, unit in zip(columns, units, strict=True):
        if unit not in LENGTHS_M:
            problem = f"has the unit {unit}, which is no known length" if unit else "has no unit, others have"
            return (StatedUnit(text=f"column {format_value(column)} {problem}", units_m=None),)
    return (StatedUnit(text=f"column {format_value(columns[0])}", units_m=_triple(units)),)


def units_of_row(cells: Sequence[str], indices: Sequence[int]) -> tuple[StatedUnit, ...]:
    """Return the units in the `cells` of a row above or below the names, empty if it is none of units."""
    if not cells or not indices:
        return ()
    row = [cells[index] if index < len(cells) else "" for index in indices]
    units = [unit_name(cell.strip("[](){}<> ")) for cell in row]
    are_known = [unit in LENGTHS_M for unit in units]
    if all(are_known):
        return (StatedUnit(text=f"the row {join_names(row)}", units_m=_triple(units)),)
    if any(are_known) or all(cell[:1] in ("[", "(") for cell in row):
        problem = f"the row {join_names(row)} is no known length of x, y and z each"
        return (StatedUnit(text=problem, units_m=None),)
    return ()


def units_in_comments(comments: Iterable[str]) -> tuple[StatedUnit, ...]:
    """Return the units that comments state in prose: `Units: mm`, `coordinates in mm`, `1 unit = 0.01 m`."""
    return tuple(
        stated for comment in comments for stated in _units_in(comment.strip("#/% \r\n")[:_MAX_COMMENT])
    )


def without_unit_of_axes(comment: str) -> str:
    """Return `comment` without the unit behind its names, `x y z in mm`, which is that of all three."""
    return _UNIT_OF_AXES.sub(r"\1", comment)


def _units_in(comment: str) -> Iterable[StatedUnit]:
    alone = _ALONE.fullmatch(comment)
    for matches in ([alone] if alone else [], *(pattern.finditer(comment) for pattern in _STATEMENTS)):
        for match in matches:
            factor, word = match.groups()
            units = [unit_name(word)]
            at = match.end()
            while (more := _MORE_WORDS.match(comment, at)) and unit_name(more[1]) in LENGTHS_M.keys() - {
                "in"
            }:
                units.append(unit_name(more[1]))
                at = more.end()
            if units[0] not in LENGTHS_M:
                continue
            text = format_value(comment)
            if len(units) in (1, 3):
                units_m = _triple(units * (3 // len(units)), float(factor or 1.0))
                yield StatedUnit(text=text, units_m=units_m)
            else:
                problem = f"{text} has {len(units)} units for x, y and z"
                yield StatedUnit(text=problem, units_m=None)
            return
    if unknown := _UNKNOWN.fullmatch(comment):
        text = f"{format_value(comment)} has the unit {unknown[1]}, which is no known length"
        yield StatedUnit(text=text, units_m=None)


def _triple(units: Sequence[str], factor: float = 1.0) -> Triple:
    x, y, z = (float(f"{factor * LENGTHS_M[unit]:.12g}") for unit in units[:3])
    return x, y, z


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


_COLORED = 5
"""Number of columns from which more may be colours and coordinates."""
_MIN_RISING_ROWS = 3
"""Number of rows from which a first column that rises in each row is an index or a time."""
_MIN_RISING_SHARE = 0.5
"""Share of the steps that rise in a column of times, of which several rows may have the same."""


def first_columns_problem(rows: Sequence[Sequence[str]]) -> tuple[str, int]:
    """Return the reason for which first columns of `rows` may be no coordinates, and their number.

    The reason is `""` if there is none.

    A number of the point, its time, the row and column of a scanner, an intensity or a colour may be first.
    Cells behind the numbers may be a code or a label.
    """
    points = [row for row in rows if len(row) > 3 and all(map(is_number, row[:3]))]
    count = min((_leading_numbers(row) for row in points), default=0)
    if count < 3:
        return "", 0
    cells = [row[:count] for row in points]
    numbers = np.array([[float(cell.replace(",", ".")) for cell in row] for row in cells])
    are_whole = [all(cell.lstrip("-").isdecimal() for cell in column) for column in zip(*cells, strict=True)]
    if count > _COLORED and _has_colors_first(cells, numbers):
        return "the first three may be colours", 3
    if _is_index_or_time(numbers, are_whole):
        return "the first counts the rows or has their time", 1
    whole = (*are_whole, False).index(False)
    if whole and are_whole[whole : whole + 3] == [False] * 3:
        return f"the first {whole} may be no coordinates", whole
    if count == 4 and are_whole[0] and all(len(row) > count for row in points):
        return "the first may be the number of the point", 1
    return "", 0


def _leading_numbers(row: Sequence[str]) -> int:
    return next((at for at, cell in enumerate(row) if not is_number(cell)), len(row))


def _is_index_or_time(numbers: NDArray[np.float64], are_whole: Sequence[bool]) -> bool:
    """Return True if the first column rises from row to row, and is not x before colours or normals."""
    steps = np.diff(numbers[:, 0])
    if len(steps) < _MIN_RISING_ROWS - 1 or not (steps >= 0.0).all():
        return False
    if are_whole[0]:
        return bool((steps > 0.0).all()) and (numbers.shape[1] > 3 or bool((steps == 1.0).all()))
    if numbers.shape[1] == 3 or (steps > 0.0).mean() <= _MIN_RISING_SHARE:
        return False
    last = numbers[:, 3:]
    if any(are_whole[3:]) and (np.diff(last[:, are_whole[3:]], axis=0) > 0.0).all(axis=0).any():
        return False  # the number of the point is behind the coordinates
    has_colors = all(are_whole[3:]) and last.min() >= 0 and last.max() <= 255
    has_normals = np.allclose(np.linalg.norm(last, axis=1), 1.0, atol=0.02)
    return not (last.shape[1] == 3 and (has_colors or has_normals))


def _has_colors_first(cells: Sequence[Sequence[str]], numbers: NDArray[np.float64]) -> bool:
    """Return True if the first three of six or more columns look like colours, and later ones do not."""
    if numbers[:, :3].min() < 0:
        return False
    are_bytes = (
        (numbers == np.floor(numbers)).all(axis=0) & (numbers.min(axis=0) >= 0) & (numbers.max(axis=0) <= 255)
    )
    has_colors_later = any(are_bytes[at : at + 3].all() for at in range(3, numbers.shape[1] - 2))
    has_normals = np.allclose(np.linalg.norm(numbers[:, 3:6], axis=1), 1.0, atol=0.02)
    limit = 255.0 if all(cell.isdecimal() for row in cells for cell in row[:3]) else 1.0
    is_beyond = (
        numbers[:, 3:].min() < 0 or numbers[:, 3:].max() > limit or (limit > 1 and not are_bytes[3:].all())
    )
    return bool(numbers[:, :3].max() <= limit and is_beyond and not has_colors_later and not has_normals)
