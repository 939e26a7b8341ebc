"""Structure of a text with a point a line: lines before the points, delimiter, columns, unit."""

import contextlib
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pointit.maps.point_files.point_columns import (
    AXES,
    PointColumns,
    cells_of,
    delimiter_of,
    is_number,
    named_columns,
    point_columns,
)
from pointit.maps.point_files.stated_units import (
    StatedUnit,
    units_in_comments,
    units_of_row,
    without_unit_of_axes,
)
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError

MAX_HEADER_LINES = 1000
SURROGATE = re.compile("[\udc80-\udcff]")
"""Bytes that are no UTF-8."""
FIRST_THREE = PointColumns(indices=(0, 1, 2))

_COLORED = 5
"""Number of columns from which more may be colours and coordinates."""
_ROWS_WITH_INDEX = 3
"""Number of rows from which a first column of consecutive whole numbers is an index."""
_MINUS = "\N{MINUS SIGN}"
_STEPS_OF_TIME = 5
"""Number of equal steps from which a first column is the time of rows."""
_MAX_STEP_CHANGE = 0.05
"""Share of a step by which these differ at most."""
_PTX_CELLS = [1, 1, 3, 3, 3, 3, 4, 4, 4, 4]
"""Numbers in the first lines of a PTX: columns, rows, pose of the scanner, transformation."""
_COMMENT = re.compile(r" *(?:#|//|%)+ *")


@dataclass(frozen=True, kw_only=True)
class TextLayout:
    """Structure of a text with a point a line."""

    skip: int = 0
    """Number of lines before the points."""
    delimiter: str | None = None
    """Character between columns, None for blanks."""
    has_decimal_comma: bool = False
    columns: PointColumns = FIRST_THREE
    units: tuple[StatedUnit, ...] = ()
    """Units that names, a row below them, and comments state."""


@dataclass(frozen=True, kw_only=True)
class _Header:
    """Names of columns."""

    cells: Sequence[str] = ()
    columns: PointColumns | None = None
    """x, y and z. None if the names do not say it."""
    unit_row: Sequence[str] = ()
    """Cells of a row above or below the names that has units."""


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
            comments += filter(_COMMENT.match, rows)
            return TextLayout(
                skip=number,
                delimiter=delimiter,
                has_decimal_comma=delimiter != "," and any("," in each for each in rows),
                columns=columns,
                units=(
                    *columns.units,
                    *units_of_row(header.unit_row, columns.indices),
                    *units_in_comments(comments),
                ),
            )
        if header.columns and len(cells) == len(header.cells) and _has_number(cells, header.columns.indices):
            raise ConfigError(
                f"line {number + 1}: {format_value(SURROGATE.sub('?', line.strip()))} is not x, y, z; "
                "correct or remove it"
            )
        first = first or line.strip()
        if comment:
            names = without_unit_of_axes(text)
            cells = cells_of(names, delimiter_of(names.strip()))
        is_prose = comment is not None and (
            bool(units_in_comments([text])) or (len(cells) == len(AXES) and not wanted)
        )
        earlier, header = (
            header,
            _next_header(header, cells, wanted, is_comment=comment is not None, is_prose=is_prose),
        )
        if header is earlier or is_prose:
            comments.append(text)
        comments += text.split("#")[1:]
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
    header: _Header, cells: Sequence[str], wanted: Sequence[str | int], *, is_comment: bool, is_prose: bool
) -> _Header:
    """Return the header after the line with `cells`, which is no row. Prose has no names but x, y and z."""
    if len(cells) < 3 or any(map(is_number, cells)):
        return header
    if units := units_of_row(cells, _indices(wanted, header, len(cells))):
        is_unit_row = units[0].units_m is not None or (bool(header.cells) and not is_comment)
        return replace(header, unit_row=cells) if is_unit_row else header
    if header.columns and len(cells) == len(header.cells):
        return header
    if columns := None if wanted else point_columns(cells):
        return replace(header, cells=cells, columns=columns)
    return header if header.columns or is_prose else replace(header, cells=cells)


def _indices(wanted: Sequence[str | int], header: _Header, count: int) -> tuple[int, int, int] | tuple[()]:
    """Return the columns of x, y and z in a row of `count` cells, empty if `wanted` are not there."""
    with contextlib.suppress(ConfigError):
        columns = named_columns(wanted, header.cells, count) if wanted else header.columns
        return (columns or FIRST_THREE).indices
    return ()


def _is_row(cells: Sequence[str], wanted: Sequence[str | int], header: _Header) -> bool:
    """Return True if `cells` have numbers where x, y and z are."""
    if len(cells) > 2 and all(map(is_number, cells)):
        return True
    indices = _indices(wanted, header, len(cells))
    return len(cells) > max(indices, default=len(cells)) and all(is_number(cells[index]) for index in indices)


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
    if shifted is None and count > len(names) and _has_colors_first(rows):
        raise ConfigError(
            f"has {count} columns without names, of which the first three may be colours; write in the map "
            "which are x, y and z by number, such as columns: [4, 5, 6]"
        )
    if shifted is None and count > len(names) and (whole := _whole_columns(rows)):
        raise ConfigError(
            f"has {count} columns without names, of which the first {whole} may be no coordinates; write in "
            f"the map which are x, y and z by number, such as columns: {[whole + 1, whole + 2, whole + 3]}"
        )
    return shifted or FIRST_THREE


def _has_number(cells: Sequence[str], indices: Sequence[int]) -> bool:
    return any(is_number(cells[index].replace(_MINUS, "-")) for index in indices)


def _has_index(rows: Sequence[Sequence[str]]) -> bool:
    """Return True if the first column counts the rows, or has their time."""
    numbers = [row[0] for row in rows if len(row) > 3 and all(map(is_number, row))]
    if len(numbers) < _ROWS_WITH_INDEX:
        return False
    if all(each.isdecimal() for each in numbers):
        return all(int(after) == int(before) + 1 for before, after in itertools.pairwise(numbers))
    steps = np.diff([float(each.replace(",", ".")) for each in numbers])
    are_equal = len(steps) >= _STEPS_OF_TIME and steps.max() - steps.min() < _MAX_STEP_CHANGE * steps.min()
    return bool(are_equal)


def _whole_columns(rows: Sequence[Sequence[str]]) -> int:
    """Return the number of first columns with whole numbers before three with others, 0 if there are none."""
    cells = [row for row in rows if len(row) > 3 and all(map(is_number, row))]
    are_whole = [all(cell.lstrip("-").isdecimal() for cell in column) for column in zip(*cells, strict=False)]
    whole = are_whole.index(False) if False in are_whole else 0
    return whole if len(cells) >= _ROWS_WITH_INDEX and are_whole[whole : whole + 3] == [False] * 3 else 0


def _has_colors_first(rows: Sequence[Sequence[str]]) -> bool:
    """Return True if the first three of six or more columns look like colours, and later ones do not."""
    cells = [row for row in rows if len(row) > _COLORED and all(map(is_number, row))]
    count = min(map(len, cells), default=0)
    numbers = np.array([[float(cell.replace(",", ".")) for cell in row[:count]] for row in cells])
    if not count or numbers[:, :3].min() < 0:
        return False
    are_bytes = (
        (numbers == np.floor(numbers)).all(axis=0) & (numbers.min(axis=0) >= 0) & (numbers.max(axis=0) <= 255)
    )
    has_colors_later = any(are_bytes[at : at + 3].all() for at in range(3, count - 2))
    has_normals = np.allclose(np.linalg.norm(numbers[:, 3:6], axis=1), 1.0, atol=0.02)
    limit = 255.0 if all(cell.isdecimal() for row in cells for cell in row[:3]) else 1.0
    is_beyond = (
        numbers[:, 3:].min() < 0 or numbers[:, 3:].max() > limit or (limit > 1 and not are_bytes[3:].all())
    )
    return bool(numbers[:, :3].max() <= limit and is_beyond and not has_colors_later and not has_normals)


def _which_columns(header: Sequence[str]) -> str:
    return (
        f"its header does not say which columns are x, y and z ({_shown(header)}); write it in the map, by "
        "name or by number from 1, such as columns: [1, 2, 3]"
    )


def _shown(header: Sequence[str]) -> str:
    return SURROGATE.sub("?", join_names(header))
