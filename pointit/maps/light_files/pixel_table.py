"""Tables of pixels: CSV of xLights, of programs that map LEDs with cameras, and of spreadsheets."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.maps.column_units import split_unit
from pointit.maps.point_files.point_columns import (
    StatedUnit,
    Triple,
    cells_of,
    delimiter_of,
    is_number,
    is_numbering,
    point_columns,
    unit_factors,
    units_in_comments,
    units_of_row,
)
from pointit.runtime.config.validation_message import join_names
from pointit.runtime.errors import ConfigError
from pointit.schemas import FARTHEST

MAX_POINTS = 100_000
STRIP_COLUMNS = ("strip", "name", "string", "model", "strand", "fixture", "strang", "streifen")
PIXEL_COLUMNS = ("pixel", "index", "number", "node", "led", "id", "no", "nr", "num", "idx", "nummer")
WIRE_COLUMNS = ("wire",)
"""Words in names of columns, the more telling ones first: `strip`, `Strip Name`, `LED No.`."""


@dataclass(frozen=True, kw_only=True)
class TablePixel:
    """A line of a table."""

    line: int
    """Number of the line, from 1."""
    strip: str
    """Name of its strip, `""` if the table has none."""
    number: int | None
    """Its number on its strip, or on the wire. None if the table has none."""
    point: NDArray[np.float64]
    """Position, m."""


@dataclass(frozen=True, kw_only=True)
class _Columns:
    points: tuple[int, int, int]
    units: Sequence[StatedUnit] = ()
    strip: int | None = None
    number: int | None = None
    is_of_wire: bool = False
    """True if the name of the column with numbers says that they are those of the wire."""
    unused: tuple[str, ...] = ()
    """Names of other columns."""


def pixels_of(text: str) -> tuple[list[TablePixel], bool, Sequence[str]]:
    """Return the pixels of a CSV, True if their numbers are stated to be of the wire, and unused columns.

    Raises:
        ConfigError: If a line is no pixel, or the header does not say which columns are x, y and z.
    """
    columns: _Columns | None = None
    units = units_in_comments(filter(_is_comment, text.splitlines()))
    rows: list[tuple[int, Sequence[str]]] = []
    names = 0
    for line, row in _rows(text):
        if columns is None:
            is_header = not any(map(is_number, row))
            columns = _named(row) if is_header else _unnamed(line, row)
            if is_header:
                names = len(row)
                continue
        if not rows and (of_row := units_of_row(row, columns.points)):
            units = *units, *of_row
            continue
        if len(rows) == MAX_POINTS:
            raise ConfigError(f"more than {MAX_POINTS} pixels; split the file")
        if names and len(row) > names:
            raise ConfigError(
                f"line {line}: has {len(row)} cells, and the header {names} names; name each column, also "
                "one with the numbers of rows"
            )
        rows.append((line, row))
    if columns is None:
        return [], False, ()
    if not names:
        _check_no_count([row for _, row in rows])
    factors = unit_factors((*columns.units, *units))
    return [_pixel(line, row, columns, factors) for line, row in rows], columns.is_of_wire, columns.unused


def _check_no_count(rows: Sequence[Sequence[str]]) -> None:
    """Check that the first of three columns without names does not count the pixels of a plane.

    Raises:
        ConfigError: If it may do so.
    """
    first = [row[0] for row in rows]
    is_count = len(rows) > 2 and first[0] in ("0", "1") and len(rows[0]) == 3
    start = int(first[0]) if is_count else 0
    is_count = is_count and first == [str(number) for number in range(start, start + len(rows))]
    if is_count and len({(*row[1:],) for row in rows}) > 1:
        raise ConfigError(
            "the first of three columns without names counts the lines: is it the pixel, and are the others "
            "x and y? Add a line with the names of the columns, such as x,y,z or pixel,x,y,z"
        )


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield number and cells of the lines that are neither empty nor comments."""
    lines = text.splitlines()
    for line, content in enumerate(lines, 1):
        bare = content.strip()
        if line < len(lines) and is_numbering(lines[line - 1 : line + 1]):
            continue
        if bare.startswith("[") and bare.rstrip(",]") != bare:  # as Python writes lists of lists
            bare = bare.strip("[], ")
        if bare and not _is_comment(bare) and not bare.lower().startswith("sep="):
            cells = cells_of(bare, delimiter_of(bare))
            if any(cells):
                yield line, cells


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "//"))


def _named(header: Sequence[str]) -> _Columns:
    columns = point_columns(header)
    if columns is None:
        raise ConfigError(
            f"its header does not say which columns are x, y and z ({join_names(header)}); "
            "rename them to x, y, z, with their unit, such as 'x [mm]', if it is not metres"
        )
    names = [{*split_unit(cell)[0].split("_")} for cell in header]

    def column(known: Sequence[str]) -> int | None:
        words = {*known, *PIXEL_COLUMNS, "name"}
        return next((at for word in known for at, each in enumerate(names) if {word} <= each <= words), None)

    strip, wire = column(STRIP_COLUMNS), column(WIRE_COLUMNS)
    number = column(PIXEL_COLUMNS) if wire is None else wire
    used = {*columns.indices, strip, number}
    return _Columns(
        points=columns.indices,
        units=columns.units,
        strip=strip,
        number=number,
        is_of_wire=wire is not None,
        unused=tuple(each for at, each in enumerate(header) if each and at not in used),
    )


def _unnamed(line: int, row: Sequence[str]) -> _Columns:
    if len(row) == 3:
        return _Columns(points=(0, 1, 2))
    if len(row) == 4 and row[0].isdecimal():
        return _Columns(points=(1, 2, 3), number=0)
    raise ConfigError(
        f"line {line}: has {len(row)} columns without names; write x,y,z in metres, or pixel,x,y,z, "
        "or add a line with the names of the columns"
    )


def _pixel(line: int, row: Sequence[str], columns: _Columns, factors: Triple) -> TablePixel:
    shown = repr(",".join(row)[:60])
    try:
        point = np.array([float(row[index].replace(",", ".")) for index in columns.points]) * factors
        number = None if columns.number is None else float(row[columns.number].replace(",", "."))
        strip = "" if columns.strip is None or columns.strip >= len(row) else row[columns.strip]
    except (IndexError, ValueError):
        raise ConfigError(f"line {line}: {shown} is no pixel; write x,y,z in metres") from None
    if not np.all(np.abs([*point, number or 0.0]) <= FARTHEST):
        raise ConfigError(f"line {line}: {shown} is no pixel; write numbers up to {FARTHEST:g}")
    if number is not None and (number < 0 or number != int(number)):
        raise ConfigError(f"line {line}: {shown} has the number {number:g}; write whole numbers from 0")
    return TablePixel(line=line, strip=strip, number=None if number is None else int(number), point=point)
