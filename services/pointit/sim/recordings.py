"""Recordings of people: a wrist's orientation over time, and the true positions of the robot and the head."""

import csv
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointit.runtime.errors import ConfigError
from pointit.schemas import FARTHEST, BodyMeasures

Array = NDArray[np.float64]

UNIT_TOLERANCE = 0.01
"""Largest deviation of a recorded quaternion's norm from 1, before normalization."""

LATEST_S = 1e12
LONGEST_S = 1e9
"""Thirty years: in nanoseconds it fits 64 bits, also added to other times."""

MAX_BYTES = 64_000_000
"""An hour at 1000 Hz; more would use too much memory of a service."""

_EMPTY: list[str] = []
_TIME = "t"
_ORIENTATION = ("qx", "qy", "qz", "qw")
_ROBOT = ("robot_x", "robot_y", "robot_z")
_HEAD = ("head_x", "head_y", "head_z")
_FLOOR = ("px", "py")

MARKER_OVER_EYES_M = 0.115
"""Height of the head's marker over the eyes in recordings of points on the floor."""

OPERATOR = BodyMeasures(
    footprint_to_neck_m=1.47, neck_to_eyes_m=0.22, shoulder_to_wrist_m=0.52, wrist_to_finger_m=0.17
)
"""Shoulder 1.47 m, eyes 1.69 m, arm 0.69 m: the operator of `motion_relloc`, 1.83 m tall."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Motion capture, its time starting at 0."""

    path: Path
    t_s: Array
    """n, never falling, the first is 0."""
    robot_m: Array | None = None
    """n x 3, {W}."""
    head_m: Array | None = None
    """n x 3, {W}: the marker on top of the head."""

    @property
    def duration_s(self) -> float:
        """Return the time of the last sample."""
        return float(self.t_s[-1])


@dataclass(frozen=True, kw_only=True)
class ImuRecording(Motion):
    """A recorded wrist with motion capture."""

    orientation_xyzw: Array
    """n x 4, norm 1, as recorded: rotates vectors of the *sensor* (not of the arm) into {H}."""


@dataclass(frozen=True, kw_only=True)
class FloorRecording(Motion):
    """The recorded points at which a person's rays meet the floor, with motion capture."""

    floor_m: Array
    """n x 2, {H}; NaN where the ray does not meet the floor."""
    eye_height_m: float


def is_floor_csv(path: Path) -> bool:
    """Return True if the CSV file at `path` has points on the floor instead of orientations."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = [name.strip() for name in next(csv.reader(file), _EMPTY)]
    except (OSError, UnicodeDecodeError, csv.Error):
        return False
    return set(_FLOOR) <= set(header) and not set(_ORIENTATION) & set(header)


def read_floor_csv(path: Path) -> FloorRecording:
    """Return the recording in a CSV file with the columns `t,px,py,robot_x,…,head_x,…`.

    Raises:
        ConfigError: As `read_imu_csv`. Cells of `px` and `py` may be empty.
    """
    columns, values = _read(path, (_TIME, *_FLOOR, *_ROBOT, *_HEAD), (), gaps=_FLOOR)
    table = np.array(values, dtype=np.float64)
    t_s = _times_s(path, columns, table)
    part = _parts(columns, table)
    return FloorRecording(
        path=path,
        t_s=t_s,
        floor_m=part(_FLOOR),
        robot_m=part(_ROBOT),
        head_m=part(_HEAD),
        eye_height_m=float(np.mean(part(_HEAD)[:, 2])) - MARKER_OVER_EYES_M,
    )


def read_imu_csv(path: Path) -> ImuRecording:
    """Return the recording in a CSV file with the columns `t,qw,qx,qy,qz[,robot_x,…][,head_x,…]`.

    Other columns are ignored; the order does not matter.

    Raises:
        ConfigError: If it cannot be read, is too long, a column or value is missing, a value is not a number
            within bounds, a quaternion is far from norm 1, the time goes backwards, or there are no rows.
            Names file, line, column and value.
    """
    columns, values = _read(path, (_TIME, *_ORIENTATION), (_ROBOT, _HEAD))
    table = np.array(values, dtype=np.float64)
    lines = table[:, 0].astype(int)
    t_s = _times_s(path, columns, table)
    part = _parts(columns, table)
    orientation = part(_ORIENTATION)
    norms = np.linalg.norm(orientation, axis=1)
    off = np.flatnonzero(np.abs(norms - 1.0) > UNIT_TOLERANCE)
    if len(off):
        row = int(off[0])
        raise ConfigError(
            f"{path}, line {lines[row]}, columns 'qw' to 'qz': a quaternion of norm 1 was expected, "
            f"got norm {norms[row]:.6g}"
        )
    return ImuRecording(
        path=path,
        t_s=t_s,
        orientation_xyzw=orientation / norms[:, None],
        robot_m=part(_ROBOT) if _ROBOT[0] in columns else None,
        head_m=part(_HEAD) if _HEAD[0] in columns else None,
    )


def _read(
    path: Path, wanted: Sequence[str], optional: Sequence[Sequence[str]], gaps: Sequence[str] = ()
) -> tuple[dict[str, int], list[list[float]]]:
    """Return the indices of the columns that are used, and their numbers; NaN for empty cells of `gaps`."""
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ConfigError(
                f"{path}: has {size / 1e6:.1f} MB and at most {MAX_BYTES / 1e6:.0f} MB are read; "
                "cut it into pieces"
            )
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.reader(file)
            header = [name.strip() for name in next(rows, _EMPTY)]
            columns = _columns(path, header, wanted, optional)
            values = _values(path, rows, columns, gaps)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is not a CSV text file ({error})") from error
    return columns, values


def _columns(
    path: Path, header: Sequence[str], wanted: Sequence[str], optional: Sequence[Sequence[str]]
) -> dict[str, int]:
    wanted = [*wanted, *(name for group in optional if set(group) & set(header) for name in group)]
    for name in wanted:
        if name not in header:
            found = ", ".join(header) or "nothing"
            raise ConfigError(f"{path}, line 1: column {name!r} is missing, found {found}")
        if header.count(name) > 1:
            raise ConfigError(f"{path}, line 1: column {name!r} is there more than once")
    return {name: header.index(name) for name in wanted}


def _values(
    path: Path, rows: Iterator[list[str]], columns: dict[str, int], gaps: Sequence[str]
) -> list[list[float]]:
    """Return the numbers of `columns`, row by row, with the line number in front."""
    line = 1
    values: list[list[float]] = []
    for line, row in enumerate(rows, start=2):
        if not row:  # an empty line, as at the end of many files
            continue
        numbers = [float(line)]
        for name, index in columns.items():
            text = row[index] if index < len(row) else ""
            if not text and name in gaps:
                numbers.append(math.nan)
                continue
            try:
                number = float(text)
            except ValueError:
                number = math.nan
            most = LATEST_S if name == _TIME else FARTHEST
            if not abs(number) <= most:
                raise ConfigError(
                    f"{path}, line {line}, column {name!r}: a number within {most:g} was expected, "
                    f"got {text!r}"
                )
            numbers.append(number)
        values.append(numbers)
    if not values:
        raise ConfigError(f"{path}, line {line}: there is a header but no samples")
    return values


def _parts(columns: dict[str, int], table: Array) -> Callable[[Sequence[str]], Array]:
    where = {name: index for index, name in enumerate(columns, start=1)}
    return lambda names: table[:, [where[name] for name in names]]


def _times_s(path: Path, columns: dict[str, int], table: Array) -> Array:
    lines = table[:, 0].astype(int)
    t_s = _parts(columns, table)([_TIME])[:, 0]
    back = np.flatnonzero(np.diff(t_s) < 0.0)
    if len(back):
        row = int(back[0]) + 1
        raise ConfigError(
            f"{path}, line {lines[row]}, column {_TIME!r}: time goes backwards, "
            f"{t_s[row]:g} after {t_s[row - 1]:g}"
        )
    if t_s[-1] - t_s[0] > LONGEST_S:
        raise ConfigError(
            f"{path}, line {lines[-1]}, column {_TIME!r}: the recording is {t_s[-1] - t_s[0]:g} s long and "
            f"at most {LONGEST_S:g} s can be played; is its time in seconds?"
        )
    return np.asarray(t_s - t_s[0], dtype=np.float64)
