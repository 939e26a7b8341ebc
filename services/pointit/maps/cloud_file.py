"""Reads point clouds: PLY (text or binary) and plain text with a point per line (XYZ, TXT, CSV, PTS, ASC)."""

import itertools
import re
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from pointit.maps.ply_file import AXES, binary_vertices, read_ply_header
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError

Points = NDArray[np.float64]

MAX_POINTS = 5_000_000
"""Limit of the points of one cloud: 120 MB in memory, some seconds to read."""

SUFFIXES = (".ply", ".xyz", ".txt", ".csv", ".pts", ".asc")

_MAX_HEADER_LINES = 1000


def read_cloud(path: Path) -> Points:
    """Return the points in the file at `path`, n x 3, in the file's units and frame.

    Raises:
        ConfigError: If it is invalid. One sentence with file, problem and remedy.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ConfigError(f"{path}: is not a point cloud; give a file that ends in {join_names(SUFFIXES)}")
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):  # reading a pipe would block
            raise ConfigError(f"{path}: is not a file; give the file itself")
        points = _read_ply(path) if suffix == ".ply" else _read_text(path)
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
    return points


def _check_size(path: Path, count: int, how_many: str) -> None:
    if count > MAX_POINTS:
        raise ConfigError(
            f"{path}: has {how_many} points, limit {MAX_POINTS}; thin it, "
            "as points closer than 1 cm do not improve pointing"
        )


def _read_ply(path: Path) -> Points:
    header = read_ply_header(path)
    wanted = header.vertex.rows
    _check_size(path, wanted, str(wanted))
    if header.order:
        points = binary_vertices(path, header)
    else:
        with path.open(encoding="ascii", errors="replace") as file:
            file.seek(header.body)
            skip = min(sum(each.rows for each in header.before), sys.maxsize)
            points = _table(path, file, columns=header.columns, skip=skip, max_rows=max(wanted, 1))[:wanted]
    if len(points) < wanted:
        raise ConfigError(f"{path}: is cut off, {len(points)} of {wanted} points are there; copy it again")
    return points


def _read_text(path: Path) -> Points:
    with path.open(encoding="utf-8-sig") as file:
        skip, delimiter, columns = _text_layout(path, file)
        file.seek(0)
        points = _table(path, file, columns=columns, skip=skip, max_rows=MAX_POINTS + 1, delimiter=delimiter)
    _check_size(path, len(points), "more")
    return points


def _text_layout(path: Path, file: TextIO) -> tuple[int, str | None, list[int]]:
    """Return the number of lines before the points, the delimiter (None: blanks), and columns of x, y, z.

    They are the first three columns, unless a header names them.
    """
    first, columns = "", [0, 1, 2]
    for number, line in enumerate(itertools.islice(file, _MAX_HEADER_LINES)):
        names = re.findall(r"\w+", line.lower())
        if {"x", "y", "z"} <= set(names):
            columns = [names.index(axis) for axis in AXES]
        text = line.split("#")[0].strip()
        delimiter = next((each for each in ",;" if each in text), None)
        try:
            words = text.split(delimiter)
            numbers = [float(words[column]) for column in columns]
        except (ValueError, IndexError):
            numbers = []  # names of columns, comments, number of points
        if numbers:
            return number, delimiter, columns
        first = first or line.strip()
    if not first:
        return 0, None, columns
    raise ConfigError(
        f"{path}: no line begins with x, y and z, the first is {format_value(first)}; "
        "write three numbers per line"
    )


def _table(
    path: Path,
    file: TextIO,
    *,
    columns: Sequence[int],
    skip: int,
    max_rows: int,
    delimiter: str | None = None,
) -> Points:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # no rows: the caller reports it
        try:
            return np.loadtxt(
                file, usecols=columns, skiprows=skip, max_rows=max_rows, delimiter=delimiter, ndmin=2
            )
        except UnicodeDecodeError:
            raise
        except ValueError as error:
            reason = str(error).splitlines()[0].removesuffix(".")
            raise ConfigError(
                f"{path}: below its header a row is not x, y, z ({reason}); correct or remove it"
            ) from error
