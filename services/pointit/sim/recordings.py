"""Recordings of people: a wrist's orientation over time, and the true positions of the robot and the head."""

import csv
import math
from collections.abc import Iterator, Sequence
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

OPERATOR = BodyMeasures(
    footprint_to_neck_m=1.47, neck_to_eyes_m=0.22, shoulder_to_wrist_m=0.52, wrist_to_finger_m=0.17
)
"""Shoulder 1.47 m, eyes 1.69 m, arm 0.69 m: the operator of `motion_relloc`, 1.83 m tall."""


@dataclass(frozen=True, kw_only=True)
class ImuRecording:
    """A recorded wrist, its time starting at 0, with motion capture."""

    path: Path
    t_s: Array
    """n, never falling, the first is 0."""
    orientation_xyzw: Array
    """n x 4, norm 1, as recorded: rotates vectors of the *sensor* (not of the arm) into {H}."""
    robot_m: Array | None = None
    """n x 3, {W}."""
    head_m: Array | None = None
    """n x 3, {W}: the marker on top of the head."""

    @property
    def duration_s(self) -> float:
        """Return the time of the last sample."""
        return float(self.t_s[-1])


def read_imu_csv(path: Path) -> ImuRecording:
    """Return the recording in a CSV file with the columns `t,qw,qx,qy,qz[,robot_x,…][,head_x,…]`.

    Other columns are ignored; the order does not matter.

    Raises:
        ConfigError: If it cannot be read, is too long, a column or value is missing, a value is not a number
            within bounds, a quaternion is far from norm 1, the time goes backwards, or there are no rows.
            Names file, line, column and value.
    """
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
            columns = _columns(path, header)
            values = _values(path, rows, columns)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is not a CSV text file ({error})") from error
    return _recording(path, columns, values)


def _columns(path: Path, header: Sequence[str]) -> dict[str, int]:
    """Return the indices of the columns that are used, in file order."""
    wanted = [_TIME, *_ORIENTATION]
    for optional in (_ROBOT, _HEAD):
        if any(name in header for name in optional):
            wanted += optional
    for name in wanted:
        if name not in header:
            found = ", ".join(header) or "nothing"
            raise ConfigError(f"{path}, line 1: column {name!r} is missing, found {found}")
        if header.count(name) > 1:
            raise ConfigError(f"{path}, line 1: column {name!r} is there more than once")
    return {name: header.index(name) for name in wanted}


def _values(path: Path, rows: Iterator[list[str]], columns: dict[str, int]) -> list[list[float]]:
    """Return the numbers of `columns`, row by row, with the line number in front."""
    line = 1
    values: list[list[float]] = []
    for line, row in enumerate(rows, start=2):
        if not row:  # an empty line, as at the end of many files
            continue
        numbers = [float(line)]
        for name, index in columns.items():
            text = row[index] if index < len(row) else ""
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


def _recording(path: Path, columns: dict[str, int], values: list[list[float]]) -> ImuRecording:
    table = np.array(values, dtype=np.float64)
    lines = table[:, 0].astype(int)
    where = {name: index for index, name in enumerate(columns, start=1)}

    def part(names: Sequence[str]) -> Array:
        return table[:, [where[name] for name in names]]

    t_s = table[:, where[_TIME]]
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
        t_s=t_s - t_s[0],
        orientation_xyzw=orientation / norms[:, None],
        robot_m=part(_ROBOT) if _ROBOT[0] in where else None,
        head_m=part(_HEAD) if _HEAD[0] in where else None,
    )
