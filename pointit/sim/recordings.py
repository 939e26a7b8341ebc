"""Recordings of people: a wrist's orientation over time, and the true positions of the robot and the head."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pointit.geometry.array_types import Array
from pointit.runtime.errors import ConfigError
from pointit.schemas import BodyMeasures
from pointit.schemas.base import NORM_TOLERANCE
from pointit.sim.motion_table import (
    DOCUMENTED,
    FLOOR,
    HEAD,
    ORIENTATION,
    ROBOT,
    TIME,
    MotionForm,
    MotionTable,
    has_columns,
)

LONGEST_S = 1e9
"""Thirty years: in nanoseconds it fits 64 bits, also added to other times."""

BODIES = {"robot": ROBOT, "head": HEAD, "points": FLOOR}
"""Columns of positions by body."""

MARKER_OVER_EYES_M = 0.115
"""Height of the head's marker over the eyes in recordings of points on the floor."""

OPERATOR = BodyMeasures(
    footprint_to_neck_m=1.47, neck_to_eyes_m=0.22, shoulder_to_wrist_m=0.52, wrist_to_finger_m=0.17
)
"""Shoulder 1.47 m, eyes 1.69 m, arm 0.69 m: the operator of `motion_relloc`, 1.83 m tall."""


@dataclass(frozen=True, kw_only=True)
class RecordedMotion:
    """Motion capture, its time starting at 0."""

    path: Path
    t_s: Array
    """n, rising, the first is 0."""
    robot_m: Array | None = None
    """n x 3, {W}; NaN in rows without it."""
    head_m: Array | None = None
    """n x 3, {W}: the marker on top of the head; NaN in rows without it."""
    notes: tuple[str, ...] = ()
    """Sentences about what is missing in the file."""

    @property
    def duration_s(self) -> float:
        """Return the time of the last sample."""
        return float(self.t_s[-1])


@dataclass(frozen=True, kw_only=True)
class ImuRecording(RecordedMotion):
    """A recorded wrist with motion capture."""

    orientation_xyzw: Array
    """n x 4, norm 1, as recorded: rotates vectors of the *sensor* (not of the arm) into {H}; NaN in rows
    without it."""


@dataclass(frozen=True, kw_only=True)
class FloorRecording(RecordedMotion):
    """The recorded points at which a person's rays meet the floor, with motion capture."""

    floor_m: Array
    """n x 2, {H}; NaN where the ray does not meet the floor."""
    eye_height_m: float


def is_floor_csv(path: Path, form: MotionForm = DOCUMENTED) -> bool:
    """Return True if the CSV file at `path` has points on the floor instead of orientations."""
    has_points = has_columns(path, (TIME, *FLOOR), form)
    return has_points and not has_columns(path, (TIME, *ORIENTATION), form)


def read_floor_csv(path: Path, form: MotionForm = DOCUMENTED) -> FloorRecording:
    """Return the recording in a CSV file with the columns `t,px,py,robot_x,…,head_x,…`.

    Raises:
        ConfigError: As `read_imu_csv`.
    """
    table = MotionTable(path, (TIME, *FLOOR, *ROBOT, *HEAD), (), form)
    t_s = _times_s(path, table)
    bodies = _bodies(table, t_s)
    head_m = bodies.get("head")
    if head_m is None:
        raise ConfigError(
            f"{path}: the head ('head_x', …) is lost in all rows; it tells the height of the eyes"
        )
    head_height_m = float(np.nanmean(head_m[:, 2]))
    no_points_m = np.full((len(t_s), 2), np.nan)
    return FloorRecording(
        path=path,
        t_s=t_s,
        floor_m=bodies.get("points", no_points_m),
        robot_m=bodies.get("robot"),
        head_m=head_m,
        eye_height_m=head_height_m - MARKER_OVER_EYES_M,
        notes=tuple(table.notes),
    )


def read_robot_csv(path: Path, form: MotionForm = DOCUMENTED) -> RecordedMotion:
    """Return the robot in a CSV file with the columns `t,robot_x,robot_y,robot_z`.

    Raises:
        ConfigError: As `read_imu_csv`.
    """
    table = MotionTable(path, (TIME, *ROBOT), (), form)
    t_s = _times_s(path, table)
    robot_m = _bodies(table, t_s).get("robot")
    return RecordedMotion(path=path, t_s=t_s, robot_m=robot_m, notes=tuple(table.notes))


def read_imu_csv(path: Path, form: MotionForm = DOCUMENTED) -> ImuRecording:
    """Return the recording in a CSV file with the columns `t,qw,qx,qy,qz[,robot_x,…][,head_x,…]`.

    Other columns are noted, and the order does not matter. `form` declares other names, units and axes.

    Raises:
        ConfigError: If it cannot be read, is too long, a column is missing, a value is not a number within
            bounds, a quaternion is far from norm 1, the time does not rise, rates, speeds or distances are
            implausible for seconds and metres, or there are no rows. Names file, line, column and value, and
            the parameter of `form` that describes it.
    """
    # Orientations, which some rows may lack
    table = MotionTable(path, (TIME, *ORIENTATION), (ROBOT, HEAD), form)
    t_s = _times_s(path, table)
    orientation = table.vectors("orientation", ORIENTATION)
    if np.isnan(orientation).all():
        raise ConfigError(f"{path}, line {table.lines[0]}, columns 'qw' to 'qz': are missing in all rows")

    # Rows of zeros or of other numbers are no quaternions
    norms = np.linalg.norm(orientation, axis=1)
    wrong_rows = np.flatnonzero(np.abs(norms - 1.0) > NORM_TOLERANCE)
    if len(wrong_rows):
        row = int(wrong_rows[0])
        raise ConfigError(
            f"{path}, line {table.lines[row]}, columns 'qw' to 'qz': a quaternion of norm 1 was expected, "
            f"got norm {norms[row]:.6g}; set columns to those of the quaternion, or lost to "
            "the number that stands for lost ones"
        )

    # Motion capture beside them
    bodies = _bodies(table, t_s)
    return ImuRecording(
        path=path,
        t_s=t_s,
        orientation_xyzw=orientation / norms[:, None],
        robot_m=bodies.get("robot"),
        head_m=bodies.get("head"),
        notes=tuple(table.notes),
    )


def _bodies(table: MotionTable, t_s: Array) -> dict[str, Array]:
    """Return the positions of the bodies in `table`, without those that are lost in all rows.

    Raises:
        ConfigError: If they are not plausible as metres, z up.
    """
    bodies: dict[str, Array] = {}
    for body, names in BODIES.items():
        if names[0] not in table.names:
            continue
        vectors = table.vectors(body, names)
        table.check_positions(body, names, vectors, t_s)
        if np.isfinite(vectors).any():
            bodies[body] = vectors
    return bodies


def _times_s(path: Path, table: MotionTable) -> Array:
    """Return the times from the first one."""
    t_s = table.times()
    duration_s = t_s[-1] - t_s[0]
    if duration_s > LONGEST_S:
        last_line = table.lines[-1]
        title = table.title(TIME)
        raise ConfigError(
            f"{path}, line {last_line}, column {title!r}: the recording is {duration_s:.6g} s long and at "
            f"most {LONGEST_S:g} s can be played; set columns to the unit of its time, such as t=ms"
        )
    return np.asarray(t_s - t_s[0], dtype=np.float64)
