"""Reads point clouds: PLY and text with a point per line, by its delimiter, columns and unit."""

import contextlib
import itertools
import re
import sys
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from pointit.maps.point_files.ply_file import (
    ascii_vertex_lines,
    binary_vertices,
    read_pcd_header,
    read_ply_header,
)
from pointit.maps.point_files.point_columns import (
    AXES,
    PointColumns,
    StatedUnit,
    cells_of,
    delimiter_of,
    first_columns_problem,
    is_number,
    is_numbering,
    named_columns,
    point_columns,
    unit_factors,
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

_MINUS = "\N{MINUS SIGN}"
_PTX_CELLS = [1, 1, 3, 3, 3, 3, 4, 4, 4, 4]
"""Numbers in the first lines of a PTX: columns, rows, pose of the scanner, transformation."""
_ROW_NAME = re.compile(r"""\s*(["'])[^"']*\1[,;|\s]+[^"',;|\s]""")
"""Quoted name of a row before numbers without quotes, for which the header of R has no name."""
_OFF = re.compile(r"(ST)?C?N?4?n?OFF")
"""First line of a mesh in the Object File Format."""
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
    if sample and _OFF.fullmatch(sample[0].strip()):
        raise ConfigError("is an OFF mesh, whose faces are no points; export it as PLY")
    if pcd := read_pcd_header(sample):
        skip, names = pcd
        columns = named_columns(wanted, names, len(names)) if wanted else point_columns(names)
        if columns is None:
            raise ConfigError(_which_columns(names))
        return TextLayout(skip=skip, columns=columns)
    return _layout_of_table(sample, wanted)


def _layout_of_table(sample: Sequence[str], wanted: Sequence[str | int]) -> TextLayout:
    header = _Header()
    first, comments = "", list[str]()
    for number, line in enumerate(sample):
        comment = _COMMENT.match(line)
        text = line[comment.end() :] if comment else line
        if not text.strip() or is_numbering(sample[number : number + 2]):
            continue
        row = text.split("#")[0]
        delimiter = delimiter_of(row.strip())
        cells = cells_of(row, delimiter)
        header = _with_row_name(header, row, cells, wanted)
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
        "write three numbers per line, or write in the map which columns are x, y and z, such as "
        "columns: [2, 3, 4]"
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
    named = _with_names(header, cells, wanted)
    return named if named.columns or not (header.columns or is_prose) else header


def _with_row_name(header: _Header, row: str, cells: Sequence[str], wanted: Sequence[str | int]) -> _Header:
    """Return `header` with an empty name for the names of rows, if it has none and `row` begins with one."""
    if len(cells) != len(header.cells) + 1 or not _ROW_NAME.match(row):
        return header
    return _with_names(header, ["", *header.cells], wanted)


def _with_names(header: _Header, names: Sequence[str], wanted: Sequence[str | int]) -> _Header:
    return replace(header, cells=names, columns=None if wanted else point_columns(names))


def _indices(wanted: Sequence[str | int], header: _Header, count: int) -> tuple[int, int, int] | tuple[()]:
    """Return the indices of x, y and z in rows of `count` cells, or `()` if a wanted column is missing."""
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
    problem = first_columns_problem(rows) if len(names) < count else ("", 0)
    if wanted and not (problem[0] and names and any(isinstance(each, str) for each in wanted)):
        has_row_names = problem[0] and len(names) == count - 1
        return named_columns(wanted, ["", *names] if has_row_names else names, count)
    shifted = point_columns(names) if names is not header.cells else header.columns
    if shifted is None and len(names) == count:
        raise ConfigError(_which_columns(names))
    counts = {len(row) for row in rows if row}
    is_split = delimiter == "," and 0 < len(names) < count and (len(counts) > 1 or count == 2 * len(names))
    if is_split or (shifted and len(names) > count):
        hint = " (are there decimal commas?)" if is_split else ""
        raise ConfigError(
            f"its header has {len(names)} columns ({_shown(names)}) and its rows have {count}{hint}; "
            "write in the map which are x, y and z by number, such as columns: [1, 2, 3], or correct the file"
        )
    if problem[0]:
        raise ConfigError(_first_columns(count, names, problem, rows[0]))
    return shifted or FIRST_THREE


def _has_number(cells: Sequence[str], indices: Sequence[int]) -> bool:
    return any(is_number(cells[index].replace(_MINUS, "-")) for index in indices)


def _first_columns(count: int, names: Sequence[str], problem: tuple[str, int], row: Sequence[str]) -> str:
    reason, skipped = problem
    header = f"has {len(names)} names ({_shown(names)}) for {count}" if names else f"has {count}"
    without = "" if names else " without names"
    first = format_value(SURROGATE.sub("?", ", ".join(row)))
    return (
        f"{header} columns{without}, of which {reason}; its first row is {first}: write in the map which are "
        f"x, y and z by number, such as columns: {[skipped + 1, skipped + 2, skipped + 3]}"
    )


def _which_columns(header: Sequence[str]) -> str:
    return (
        f"its header does not say which columns are x, y and z ({_shown(header)}); write it in the map, by "
        "name or by number from 1, such as columns: [1, 2, 3]"
    )


def _shown(header: Sequence[str]) -> str:
    return SURROGATE.sub("?", join_names(header))


Points = NDArray[np.float64]
Wanted = Sequence[str | int]
"""Columns of x, y and z that a map names: by name or by number from 1. Empty: the file says it."""

MAX_POINTS = 5_000_000
"""Limit of the points of one cloud: 120 MB in memory, some seconds to read."""

SUFFIXES = (".ply", ".xyz", ".txt", ".csv", ".pts", ".asc", ".pcd")


def read_cloud(path: Path, columns: Wanted = (), scale: float | None = None) -> Points:
    """Return the points in the file at `path`, n x 3, in its frame, m.

    They are multiplied with the unit that the file states, or with `scale` if it states none, or several.

    Raises:
        ConfigError: If it is invalid, or states another unit than `scale`. One sentence with file, problem
            and remedy.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ConfigError(f"{path}: is not a point cloud; give a file that ends in {join_names(SUFFIXES)}")
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):  # reading a pipe would block
            raise ConfigError(f"{path}: is not a file; give the file itself")
        points, units = (_read_ply if suffix == ".ply" else _read_text)(path, columns)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not text; give the points as text, or as a binary .ply") from error
    if not len(points):
        raise ConfigError(f"{path}: has no points; give a file with at least one")
    good = np.isfinite(points).all(axis=1)
    if not good.all():
        first = int(np.argmin(good))
        raise ConfigError(
            f"{path}: {len(points) - int(good.sum())} of {len(points)} points are not finite, the first is "
            f"point {first + 1} {format_value(points[first].tolist())}; remove them"
        )
    try:
        factors = unit_factors(units, scale, ", or write scale in the map")
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    with np.errstate(over="ignore"):  # the caller checks the result
        points *= factors
    return points


def _check_size(path: Path, count: int, how_many: str) -> None:
    if count > MAX_POINTS:
        raise ConfigError(
            f"{path}: has {how_many} points, limit {MAX_POINTS}; thin it, "
            "as points closer than 1 cm do not improve pointing"
        )


def _read_ply(path: Path, wanted: Wanted) -> tuple[Points, Sequence[StatedUnit]]:
    header = read_ply_header(path, wanted)
    rows = header.vertex.rows
    _check_size(path, rows, str(rows))
    if header.order:
        points = binary_vertices(path, header)
    else:
        with path.open(encoding="latin-1") as file:
            file.seek(header.body)
            skip = min(sum(each.rows for each in header.before), sys.maxsize)
            lines: Iterable[str] = filter(str.strip, file) if skip else file  # blank lines are no rows
            columns = header.columns
            if header.is_list_before_points:
                lines, columns = ascii_vertex_lines(itertools.islice(lines, skip, None), header), [0, 1, 2]
                skip = 0
            points = _table(path, lines, columns=columns, skip=skip, max_rows=max(rows, 1))[:rows]
    if len(points) < rows:
        raise ConfigError(f"{path}: is cut off, {len(points)} of {rows} points are there; copy it again")
    return points, (*header.units, *units_in_comments(header.comments))


def _read_text(path: Path, wanted: Wanted) -> tuple[Points, Sequence[StatedUnit]]:
    with path.open("rb") as binary:
        is_wide = binary.read(2) in (b"\xff\xfe", b"\xfe\xff")

    def text() -> TextIO:  # a header may have letters of another code page
        if is_wide:
            return path.open(encoding="utf-16")
        return path.open(encoding="utf-8-sig", errors="surrogateescape")

    with text() as file:
        sample = list(itertools.islice(file, MAX_HEADER_LINES))
    try:
        layout = text_layout(sample, wanted)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    with text() as file:
        lines: Iterable[str] = file
        if layout.has_decimal_comma:
            lines = (line.replace(",", ".") for line in file)
        points = _table(
            path,
            lines,
            columns=layout.columns.indices,
            skip=layout.skip,
            max_rows=MAX_POINTS + 1,
            delimiter=layout.delimiter,
        )
    _check_size(path, len(points), "more")
    return points, layout.units


def _table(
    path: Path,
    lines: Iterable[str],
    *,
    columns: Sequence[int],
    skip: int = 0,
    max_rows: int,
    delimiter: str | None = None,
) -> Points:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # no rows: the caller reports it
        try:
            return np.loadtxt(
                lines,
                usecols=columns,
                skiprows=skip,
                max_rows=max_rows,
                delimiter=delimiter,
                ndmin=2,
                quotechar='"',
            )
        except UnicodeDecodeError:
            raise
        except ValueError as error:
            reason = str(error).splitlines()[0].removesuffix(".")
            if r"\udc" in reason:  # bytes that are no UTF-8
                raise ConfigError(
                    f"{path}: is not text; give the points as text, or as a binary .ply"
                ) from error
            raise ConfigError(
                f"{path}: below its header a row is not x, y, z ({reason}); correct or remove it"
            ) from error
