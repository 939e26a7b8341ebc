"""Structure of a text with a point a line: lines before the points, delimiter, columns, unit."""

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from pointit.maps.column_units import LENGTHS_M, unit_name
from pointit.maps.point_files.point_columns import (
    PointColumns,
    Triple,
    cells_of,
    delimiter_of,
    is_number,
    named_columns,
    point_columns,
)
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError

MAX_HEADER_LINES = 1000
SURROGATE = re.compile("[\udc80-\udcff]")
"""Bytes that are no UTF-8."""
FIRST_THREE = PointColumns(indices=(0, 1, 2))

_ROWS_WITH_INDEX = 3
"""Number of rows from which a first column of consecutive whole numbers is an index."""
_PTX_CELLS = [1, 1, 3, 3, 3, 3, 4, 4, 4, 4]
"""Numbers in the first lines of a PTX: columns, rows, pose of the scanner, transformation."""
_COMMENT = re.compile(r" *(?:#|//|%)+ *")
_UNIT_IN_COMMENT = re.compile(r"\bunits?\b\s*[:=]?\s*(?:(?:is|are|in)\s)?\s*([a-zµμ]+)", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class TextLayout:
    """Structure of a text with a point a line."""

    skip: int = 0
    """Number of lines before the points."""
    delimiter: str | None = None
    """Character between columns, None for blanks."""
    has_decimal_comma: bool = False
    columns: PointColumns = FIRST_THREE


@dataclass(frozen=True, kw_only=True)
class _Header:
    """Names of columns."""

    cells: Sequence[str] = ()
    columns: PointColumns | None = None
    """x, y and z. None if the names do not say it."""


def unit_in_comments(comments: Iterable[str]) -> Triple | None:
    """Return the length of one unit of x, y and z that a comment states (`units: mm`), m, or None."""
    for comment in comments:
        if (match := _UNIT_IN_COMMENT.search(comment)) and (name := unit_name(match[1])) in LENGTHS_M:
            return LENGTHS_M[name], LENGTHS_M[name], LENGTHS_M[name]
    return None


def text_layout(sample: Sequence[str], wanted: Sequence[str | int]) -> TextLayout:
    """Return the structure of a text that begins with the lines `sample`.

    Args:
        sample: first lines of the text, with its header and some rows.
        wanted: columns of x, y and z by name, or number from 1. Empty: the text says it.

    Raises:
        ConfigError: If it does not say which columns are x, y and z. Does not name the file.
    """
    if [len(line.split()) for line in sample[: len(_PTX_CELLS)]] == _PTX_CELLS:
        raise ConfigError("is a PTX, which begins with the pose of its scanner; export it as PTS or PLY")
    header = _Header()
    first, comments = "", list[str]()
    for number, line in enumerate(sample):
        comment = _COMMENT.match(line)
        text = line[comment.end() :] if comment else line
        if not text.strip():
            continue
        row = text.split("#")[0]
        delimiter = delimiter_of(row.strip())
        cells = cells_of(row, delimiter)
        if comment is None and _is_row(cells, wanted, header):
            rows = sample[number:]
            columns = _columns_of_rows(
                [cells_of(each, delimiter) for each in rows], wanted, header, delimiter
            )
            if columns.units_m is None:
                columns = replace(columns, units_m=unit_in_comments(comments))
            return TextLayout(
                skip=number,
                delimiter=delimiter,
                has_decimal_comma=delimiter != "," and any("," in each for each in rows),
                columns=columns,
            )
        first = first or line.strip()
        if comment:
            comments.append(text)
        header = _next_header(
            header, cells_of(text, delimiter), is_comment=comment is not None, wanted=wanted
        )
    if not first:
        return TextLayout()
    if header.columns:
        raise ConfigError(
            f"no row below its header ({_shown(header.cells)}) has numbers for x, y and z; "
            "write three numbers per line"
        )
    raise ConfigError(
        f"no line begins with x, y and z, the first is {format_value(SURROGATE.sub('?', first))}; "
        "write three numbers per line"
    )


def _next_header(
    header: _Header, cells: Sequence[str], *, is_comment: bool, wanted: Sequence[str | int]
) -> _Header:
    """Return the header after the line with `cells`, which is no row."""
    if len(cells) < 3 or any(map(is_number, cells)):
        return header
    if header.columns and len(cells) == len(header.cells):  # units below the names
        units = [unit_name(cells[index].strip("[](){}")) for index in header.columns.indices]
        if header.columns.units_m is None and all(unit in LENGTHS_M for unit in units):
            x, y, z = (LENGTHS_M[unit] for unit in units)
            return replace(header, columns=replace(header.columns, units_m=(x, y, z)))
        return header
    if columns := None if wanted else point_columns(cells):
        return _Header(cells=cells, columns=columns)
    is_prose = is_comment and len(cells) == 3 and not wanted
    return header if header.columns or is_prose else _Header(cells=cells)


def _is_row(cells: Sequence[str], wanted: Sequence[str | int], header: _Header) -> bool:
    """Return True if `cells` have numbers where x, y and z are."""
    if len(cells) > 2 and all(map(is_number, cells)):
        return True
    indices = (header.columns or FIRST_THREE).indices
    if wanted:
        try:
            indices = named_columns(wanted, header.cells, len(cells)).indices
        except ConfigError:
            return False
    return len(cells) > max(indices) and all(is_number(cells[index]) for index in indices)


def _columns_of_rows(
    rows: Sequence[Sequence[str]], wanted: Sequence[str | int], header: _Header, delimiter: str | None
) -> PointColumns:
    """Return the columns of x, y and z of `rows`, which are below `header`."""
    count, names = len(rows[0]), header.cells
    if len(names) == count + 1 and not names[0]:  # `#` and a tab before the names
        names = names[1:]
    if wanted:
        return named_columns(wanted, names, count)
    shifted = point_columns(names) if names is not header.cells else header.columns
    if shifted is None and len(names) == count:
        raise ConfigError(_which_columns(names))
    counts = {len(row) for row in rows if row}
    is_split = delimiter == "," and 0 < len(names) < count and (len(counts) > 1 or count == 2 * len(names))
    if is_split or (shifted and len(names) > count):
        problem = " (are there decimal commas?)" if is_split else ""
        raise ConfigError(
            f"its header has {len(names)} columns ({_shown(names)}) and its rows have {count}{problem}; "
            "write in the map which are x, y and z by number, such as columns: [1, 2, 3], or correct the file"
        )
    if count > 3 and len(names) < count and _has_index(rows):
        raise ConfigError(
            f"has {count} columns, names of {len(names)}, and the first counts the rows; write in the map "
            "which are x, y and z by number, such as columns: [2, 3, 4]"
        )
    return shifted or FIRST_THREE


def _has_index(rows: Sequence[Sequence[str]]) -> bool:
    """Return True if the first column counts the rows."""
    numbers = [row[0] for row in rows if row]
    if len(numbers) < _ROWS_WITH_INDEX or not all(each.isdecimal() for each in numbers):
        return False
    return all(int(after) == int(before) + 1 for before, after in itertools.pairwise(numbers))


def _which_columns(header: Sequence[str]) -> str:
    return (
        f"its header does not say which columns are x, y and z ({_shown(header)}); write it in the map, by "
        "name or by number from 1, such as columns: [1, 2, 3]"
    )


def _shown(header: Sequence[str]) -> str:
    return SURROGATE.sub("?", join_names(header))
