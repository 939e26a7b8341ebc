"""Reads point clouds: PLY, PCD and text with a point per line, as the map declares them.

Without a declaration the columns are x, y and z, in metres, z up. What is implausible for a room is refused.
"""

import itertools
import sys
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.rotation import rotate
from pointit.geometry.vector import Vec3
from pointit.maps.model import CloudEntry
from pointit.maps.ply_file import ascii_vertex_lines, binary_vertices, read_pcd_header, read_ply_header
from pointit.maps.text_table import (
    MAX_HEADER_LINES,
    MAX_LINE,
    TextLayout,
    Wanted,
    check_lengths,
    column_indices,
    find_layout,
    shown_cells,
)
from pointit.maps.units import UP_AXES
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError
from pointit.schemas.text import system_reason

Points = NDArray[np.float64]

MAX_POINTS = 5_000_000
"""Limit of the points of one cloud: 120 MB in memory, some seconds to read."""
MAX_EXTENT_M = 200.0
"""Largest extent of a cloud, and largest distance from the map's origin, m."""
MIN_EXTENT_M = 0.2
"""Least of its largest extent, m."""
MAX_BELOW_FLOOR_M = 3.0
SUNK_M = 0.3
"""Depth below the floor at which points count as deep, m."""
MAX_SUNK = 0.1
"""Share of points that may be deeper if the map does not state `up`."""

SUFFIXES = (".ply", ".xyz", ".txt", ".csv", ".pts", ".asc", ".pcd")
XYZ: Wanted = {"x": "x", "y": "y", "z": "z"}
REMEDY = "set columns in the map to those of x, y and z, by name or number, such as {x: 1, y: 2, z: 3}"
"""End of sentences about columns."""

_AXES: tuple[Vec3, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def read_cloud(path: Path, entry: CloudEntry) -> Points:
    """Return the points of the cloud `entry` in the file at `path`, n x 3, {W}.

    Raises:
        ConfigError: If it is invalid, or implausible for a room. One sentence with file, problem and the
            parameter that describes it.
    """
    points: Points = read_points(path, entry.columns)
    lowest = points.min(axis=0)

    # Into {W}. Rotations by quarters are rounded, so that coordinates stay exact.
    turned_axes = [rotate(UP_AXES[entry.up], axis) for axis in _AXES]
    up_rotation = np.rint(turned_axes)
    c = np.cos(np.radians(entry.yaw_deg))
    s = np.sin(np.radians(entry.yaw_deg))
    yaw_rotation = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    with np.errstate(over="ignore", invalid="ignore"):  # checked below
        points -= entry.origin
        points *= entry.unit
        points = np.asarray(points @ (up_rotation @ yaw_rotation))
        points += entry.position
        low = points.min(axis=0)
        high = points.max(axis=0)
        extent_m = float((high - low).max())
        distances_m = np.maximum(low, -high)
        away_m = max(float(distances_m.max()), 0.0)

    # Each implausible figure has the parameter that is probably wrong. An infinite or lost one is one, too.
    if not MIN_EXTENT_M <= extent_m <= MAX_EXTENT_M:
        example = "m"
        if extent_m > MAX_EXTENT_M:
            example = "mm"
        elif entry.unit == 1.0:
            example = "km"
        raise ConfigError(
            f"{path}: its longest side is {extent_m:.6g} m, and that of a room is {MIN_EXTENT_M:g} to "
            f"{MAX_EXTENT_M:g} m; set unit in the map to that of the file, such as unit: {example}"
        )
    if not away_m <= MAX_EXTENT_M:
        rounded = np.floor(lowest * 10.0) / 10.0
        origin = ", ".join(f"{value:.10g}" for value in rounded)
        raise ConfigError(
            f"{path}: is {away_m:.6g} m from the map's origin, limit {MAX_EXTENT_M:g} m; set origin in the "
            f"map to the point of the file that is there, such as origin: [{origin}]"
        )
    if low[2] < -MAX_BELOW_FLOOR_M:
        raise ConfigError(
            f"{path}: reaches {-low[2]:.1f} m below the floor, limit {MAX_BELOW_FLOOR_M:g} m; set up in the "
            "map to the axis of the file that points up, such as up: y, or origin to a point of the floor"
        )
    sunk = float(np.mean(points[:, 2] < -SUNK_M))
    if sunk > MAX_SUNK and "up" not in entry.model_fields_set:
        raise ConfigError(
            f"{path}: {sunk:.0%} of its points are more than {SUNK_M:g} m below the floor; set up in the map "
            "to the axis of the file that points up, such as up: y, up: z if there is a lower floor, or "
            "origin to a point of the floor"
        )
    return points


def read_points(path: Path, columns: Wanted = XYZ) -> Points:
    """Return the points in the file at `path`, n x 3, in its frame and unit.

    Raises:
        ConfigError: If it is invalid. One sentence with file, problem and remedy.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ConfigError(f"{path}: is not a point cloud; give a file that ends in {join_names(SUFFIXES)}")
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):  # reading a pipe would block
            raise ConfigError(f"{path}: is not a file; give the file itself")
        points = _read_ply(path, columns) if suffix == ".ply" else _read_text(path, columns)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({system_reason(error)})") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text; save it as UTF-8, or as a binary .ply") from error

    # Programs write lost points as NaN
    if not len(points):
        raise ConfigError(f"{path}: has no points; give a file with at least one")
    is_finite = np.isfinite(points).all(axis=1)
    if not is_finite.all():
        count = len(points) - int(is_finite.sum())
        first = int(np.argmin(is_finite))
        raise ConfigError(
            f"{path}: {count} of {len(points)} points are not finite, the first is "
            f"point {first + 1} {format_value(points[first].tolist())}; remove them"
        )
    return points


def _check_size(path: Path, count: int, how_many: str) -> None:
    if count > MAX_POINTS:
        raise ConfigError(
            f"{path}: has {how_many} points, limit {MAX_POINTS}; thin it, "
            "as points closer than 1 cm do not improve pointing"
        )


def _read_ply(path: Path, wanted: Wanted) -> Points:
    header = read_ply_header(path, wanted, REMEDY)
    rows = header.vertex.rows
    _check_size(path, rows, str(rows))
    if header.order:
        points = binary_vertices(path, header)
    else:
        with path.open(encoding="latin-1") as file:
            file.seek(header.body)
            skip = min(sum(element.rows for element in header.before), sys.maxsize)
            lines: Iterable[str] = filter(str.strip, file) if skip else file  # blank lines are no rows
            columns = header.columns
            if header.is_list_before_points:
                lines = ascii_vertex_lines(itertools.islice(lines, skip, None), header)
                columns = [0, 1, 2]
                skip = 0
            points = _table(path, lines, columns=columns, skip=skip, max_rows=max(rows, 1))[:rows]
    if len(points) < rows:
        raise ConfigError(f"{path}: is cut off, {len(points)} of {rows} points are there; copy it again")
    return points


def _read_text(path: Path, wanted: Wanted) -> Points:
    with path.open(encoding="utf-8-sig", errors="surrogateescape") as file:  # a binary PCD is named below
        sample = [line[:MAX_LINE] for line in itertools.islice(file, MAX_HEADER_LINES)]
    try:
        layout = _text_layout(sample, wanted)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    has_decimal_commas = layout.delimiter != "," and any("," in line for line in sample[layout.skip :])
    delimiter = layout.delimiter if layout.delimiter != " " else None
    with path.open(encoding="utf-8-sig") as file:
        lines = check_lengths(file, f"{path}: ")
        if has_decimal_commas:
            lines = (line.replace(",", ".") for line in lines)
        points = _table(
            path,
            lines,
            columns=[layout.indices[axis] for axis in XYZ],
            skip=layout.skip,
            max_rows=MAX_POINTS + 1,
            delimiter=delimiter,
        )
    _check_size(path, len(points), "more")
    return points


def _text_layout(sample: Sequence[str], wanted: Wanted) -> TextLayout:
    pcd_header = read_pcd_header(sample)
    if pcd_header is None:
        return find_layout(sample, wanted, anchors=("x", "y", "z"), remedy=REMEDY)
    skip, names = pcd_header
    indices = column_indices(wanted, names)
    if indices is None:
        raise ConfigError(f"its fields are {shown_cells(names)}; {REMEDY}")
    return TextLayout(skip, " ", len(names), indices, names, REMEDY)


def _table(
    path: Path,
    lines: Iterable[str],
    *,
    columns: Sequence[int],
    skip: int = 0,
    max_rows: int,
    delimiter: str | None = None,
) -> Points:
    """Return the numbers in `columns` of `lines`, one row a line.

    Raises:
        ConfigError: If a row has no numbers there.
    """
    # Numpy warns of a table without rows, which the caller reports
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
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
        except UnicodeDecodeError:  # a ValueError, too, which the caller reports
            raise
        except ValueError as error:
            reason = str(error).splitlines()[0].removesuffix(".")
            raise ConfigError(
                f"{path}: below its header a row is not x, y, z ({reason}); correct or remove it"
            ) from error
