"""`proximity_waypoints`: people follow a drone; their rays are recorded as points on the floor."""

from pathlib import Path

import numpy as np

from pointit.geometry.array_types import Array
from pointit.runtime.errors import ConfigError
from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.datasets.plausible import check_floor, check_reach, check_times
from pointit_lab.evaluation.localization.trial import FollowRecording, TrialReading
from pointit_lab.evaluation.recordings.data_folder import (
    EYE_HEIGHTS_M,
    Entry,
    eye_height_of,
    file_of,
    read_index,
    text_of,
    yaw_of,
)
from pointit_lab.evaluation.recordings.table_file import read_table

NAME = "proximity_waypoints"
PREFIX = "track_"
"""Prefix of files in which a person steadily follows the drone; in the others they fly it."""

MARKER_OVER_EYES_M = 0.115
"""Height of the head's marker over the eyes."""


def read(folder: Path, reading: TrialReading) -> None:
    """Add the windows of all files of `folder` whose names start with `PREFIX`.

    Raises:
        ConfigError: If the index or a file is damaged.
    """
    for entry in read_index(folder):
        name = text_of(folder, entry, "file")
        if not name.startswith(PREFIX):
            continue
        path = file_of(folder, entry)
        if path is None:
            reading.skip(folder / name, "the index lists it, but it is missing")
        else:
            _add(folder, path, entry, reading)


def _add(folder: Path, path: Path, entry: Entry, reading: TrialReading) -> None:
    pierced = ("px", "py")
    robot = ("robot_x", "robot_y", "robot_z")
    head = ("head_x", "head_y", "head_z")
    table = read_table(path, numbers=("t", *pierced, *robot, *head), gaps=pierced)
    check_times(path, table.numbers["t"])
    robots_m = table.vectors(*robot)
    heads_m = table.vectors(*head)
    check_reach(path, robots_m, heads_m, "robot ('robot_x', …) and head ('head_x', …)", table.lines)

    # repeated samples are old
    floor_m = table.vectors(*pierced)
    steps_m = np.diff(floor_m, axis=0)
    is_new = np.any(steps_m != 0.0, axis=1)
    fresh = np.append(True, is_new)
    fresh &= np.all(np.isfinite(floor_m), axis=1)  # the ray may miss the floor
    if np.count_nonzero(fresh) < 2:
        reading.skip(path, "no ray in it meets the floor")
        return
    floor_m = floor_m[fresh]
    heads_m = heads_m[fresh]
    check_floor(path, floor_m, "columns 'px', 'py'")

    # rays begin at the eyes, whose height the index has, or the marker on the head
    eyes_m = eye_height_of(folder, entry)
    if eyes_m is None:
        eyes_m = _eyes_under_marker_m(path, heads_m)
    t_s = table.numbers["t"][fresh]
    origins_m = np.tile([0.0, 0.0, eyes_m], (len(t_s), 1))
    directions = _floor_directions(floor_m, eyes_m)
    following = FollowRecording(
        set=NAME,
        subject=text_of(folder, entry, "subject"),
        pointings=Pointings(t_s - t_s[0], origins_m, directions, robots_m[fresh]),
        heads_m=heads_m,
        eye_height_m=eyes_m,
        yaw_rad=yaw_of(folder, entry),
    )
    reading.follow(path, following)


def _eyes_under_marker_m(path: Path, heads_m: Array) -> float:
    """Return the height of the eyes by that of the marker on the head.

    Raises:
        ConfigError: If it is not plausible.
    """
    eyes_m = float(np.mean(heads_m[:, 2])) - MARKER_OVER_EYES_M
    least_m, most_m = EYE_HEIGHTS_M
    if not least_m <= eyes_m <= most_m:
        expected = f"{least_m:g} to {most_m:g} m were expected"
        raise ConfigError(
            f"{path}, column 'head_z': the eyes, {MARKER_OVER_EYES_M:g} m below the head's marker, would "
            f"be {eyes_m:g} m high, and {expected}; is it in metres over the floor?"
        )
    return eyes_m


def _floor_directions(floor_m: Array, eyes_m: float) -> Array:
    """Return unit vectors (n x 3) from the eyes to points on the floor (n x 2, from the feet)."""
    down_m = np.full(len(floor_m), -eyes_m)
    rays = np.column_stack([floor_m, down_m])
    lengths_m = np.linalg.norm(rays, axis=1)
    return rays / lengths_m[:, None]
