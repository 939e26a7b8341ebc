"""Stated units of coordinates: in names of columns, in the row below them, and in comments."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

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
