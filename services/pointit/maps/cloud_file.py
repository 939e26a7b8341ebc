"""Reads point clouds: PLY (text or binary) and text with a point per line (XYZ, TXT, CSV, PTS, ASC, PCD)."""

import itertools
import sys
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from pointit.maps.point_files.cloud_text import MAX_HEADER_LINES, text_layout
from pointit.maps.point_files.ply_header import read_ply_header
from pointit.maps.point_files.ply_vertices import ascii_vertex_lines, binary_vertices
from pointit.maps.point_files.stated_units import StatedUnit, unit_factors, units_in_comments
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError

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
