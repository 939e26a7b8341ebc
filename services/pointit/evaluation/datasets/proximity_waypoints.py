"""`proximity_waypoints`: people follow a drone; of their rays the points on the floor are known."""

from pathlib import Path

import numpy as np

from pointit.evaluation.data_folder import Entry, number_of, read_index, text_of, yaw_of
from pointit.evaluation.table_file import read_table
from pointit.evaluation.trial import Following, Reading
from pointit.runtime.errors import ConfigError
from pointit.services.localizer.estimator import Pointings

NAME = "proximity_waypoints"
PREFIX = "track_"
"""Files in which somebody steadily follows the drone; in the others they fly it."""

MARKER_OVER_EYES_M = 0.115
"""How high the head's marker is over the eyes."""


def read(folder: Path, reading: Reading) -> None:
    """Add the windows of all files of `folder` whose names begin with `PREFIX`.

    Raises:
        ConfigError: the index or a file is damaged.
    """
    for entry in read_index(folder):
        name = text_of(folder, entry, "file")
        if name.startswith(PREFIX):
            if (folder / name).exists():
                _add(folder, name, entry, reading)
            else:
                reading.skip(folder / name, "the index lists it, but it is not there")


def _add(folder: Path, name: str, entry: Entry, reading: Reading) -> None:
    path = folder / name
    pierced = ("px", "py")
    table = read_table(
        path,
        numbers=("t", *pierced, "robot_x", "robot_y", "robot_z", "head_x", "head_y", "head_z"),
        gaps=pierced,
    )
    floor_m = table.vectors(*pierced)
    fresh = np.append(True, np.any(np.diff(floor_m, axis=0) != 0.0, axis=1))
    fresh &= np.all(np.isfinite(floor_m), axis=1)  # the ray may miss the floor
    if np.count_nonzero(fresh) < 2:
        reading.skip(path, "no ray in it meets the floor")
        return
    t_s = table.numbers["t"][fresh]
    if np.any(np.diff(t_s) < 0.0):
        raise ConfigError(f"{path}, column 't': time goes backwards")
    heads_m = table.vectors("head_x", "head_y", "head_z")[fresh]
    eyes_m = number_of(folder, entry, "eye_height_guess_m")
    if eyes_m is None:
        eyes_m = float(np.mean(heads_m[:, 2])) - MARKER_OVER_EYES_M
    rays = np.column_stack([floor_m[fresh], np.full(len(t_s), -eyes_m)])
    following = Following(
        set=NAME,
        subject=text_of(folder, entry, "subject"),
        pointings=Pointings(
            t_s - t_s[0],
            np.tile([0.0, 0.0, eyes_m], (len(t_s), 1)),
            rays / np.linalg.norm(rays, axis=1)[:, None],
            table.vectors("robot_x", "robot_y", "robot_z")[fresh],
        ),
        heads_m=heads_m,
        eye_height_m=eyes_m,
        yaw_rad=yaw_of(folder, entry),
    )
    reading.trials.extend(following.trials())
