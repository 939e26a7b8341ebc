"""Reads point clouds: PLY (text or binary) and plain text with a point a line (XYZ, TXT, CSV, PTS, ASC)."""

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
"""Of one cloud: 120 MB as they are kept, some seconds to read."""

SUFFIXES = (".ply", ".xyz", ".txt", ".csv", ".pts", ".asc")

_MAX_HEADER_LINES = 1000


def read_cloud(path: Path) -> Points:
    """Return the points in the file at `path`, n x 3, in the file's units and frame.

    Raises:
        ConfigError: one sentence with file, what is wrong in it and what to do.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ConfigError(f"{path}: is no point cloud; give a file that ends in {join_names(SUFFIXES)}")
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe: reading would wait for ever
            raise ConfigError(f"{path}: is no file; give the file itself")
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


def _refuse_many(path: Path, count: int, how_many: str) -> None:
    if count > MAX_POINTS:
        raise ConfigError(
            f"{path}: has {how_many} points and at most {MAX_POINTS} are taken; thin it, "
            "points closer together than 1 cm serve no pointing"
        )


def _read_ply(path: Path) -> Points:
    header = read_ply_header(path)
    wanted = header.vertex.rows
    _refuse_many(path, wanted, str(wanted))
    if header.order:
        points = binary_vertices(path, header)
    else:
        with path.open(encoding="ascii", errors="replace") as file:
            file.seek(header.body)
            skip = min(sum(each.rows for each in header.before), sys.maxsize)
            points = _table(path, file, columns=header.columns, skip=skip, most=max(wanted, 1))[:wanted]
    if len(points) < wanted:
        raise ConfigError(
            f"{path}: is cut off, its header says {wanted} points and {len(points)} are there; copy it again"
        )
    return points


def _read_text(path: Path) -> Points:
    with path.open(encoding="utf-8-sig") as file:
        skip, delimiter, columns = _text_layout(path, file)
        file.seek(0)
        points = _table(path, file, columns=columns, skip=skip, most=MAX_POINTS + 1, delimiter=delimiter)
    _refuse_many(path, len(points), "more")
    return points


def _text_layout(path: Path, file: TextIO) -> tuple[int, str | None, list[int]]:
    """Return how many lines stand before the first point, what separates columns (none: blanks), and x, y, z.

    They are the first three columns, unless a line before says which they are.
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
            numbers = []  # names of columns, remarks, how many there are
        if numbers:
            return number, delimiter, columns
        first = first or line.strip()
    if not first:
        return 0, None, columns
    raise ConfigError(
        f"{path}: no line begins with x, y and z, the first is {format_value(first)}; "
        "write three numbers a line"
    )


def _table(
    path: Path,
    file: TextIO,
    *,
    columns: Sequence[int],
    skip: int,
    most: int,
    delimiter: str | None = None,
) -> Points:
    """Return `columns` of the rows that follow after `skip` lines, at most `most` of them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # no rows: told better by who asked for them
        try:
            return np.loadtxt(
                file, usecols=columns, skiprows=skip, max_rows=most, delimiter=delimiter, ndmin=2
            )
        except UnicodeDecodeError:
            raise
        except ValueError as error:
            reason = str(error).splitlines()[0].removesuffix(".")
            raise ConfigError(
                f"{path}: below its header a row is not x, y, z ({reason}); correct or remove it"
            ) from error
