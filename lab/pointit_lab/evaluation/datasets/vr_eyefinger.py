"""`vr_eyefinger`: people in virtual reality point at nine positions on a wall; true eye-finger rays.

The file has the ray's direction and the fingertip on it, but not the eyes. All rays of one block start near
the head, which is estimated as the point closest to all rays; the eyes are the point of each ray closest to
it. It is found within centimetres; 10 cm along the ray are a thirtieth of the error.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointit_lab.evaluation.datasets.plausible import check_reach
from pointit_lab.evaluation.recordings.table_file import Table, read_table, truncate

Array = NDArray[np.float64]

NAME = "vr_eyefinger"
FILE = "wall_targets.csv"
WALL_M = 2.0
"""Distance of the wall ahead."""
FEEDBACKS = ("none", "hand", "cursor")
"""Visible feedback: nothing of the hand, the hand, the position pointed at."""

REACH_M = 3.0
"""Maximum distance of the fingertip from the eyes."""
NEAREST_M = 0.1
"""Minimum distance of the eyes from the wall."""

_MIN_ROWS = 4
"""Minimum number of rays to estimate the eyes."""
_WORST_CONDITION = 1e3


@dataclass(frozen=True, kw_only=True)
class WallTrials:
    """All trials of a person with one feedback, in file order; {W}: x to the wall, y to the left."""

    subject: str
    feedback: str
    directions: Array
    """n x 3, unit: true rays from the eyes over the fingertip."""
    ways: Array
    """n x 3, unit: directions from the eyes to the target."""
    targets: NDArray[np.int64]
    """n: index of the target."""


def read_wall_trials(folder: Path) -> list[WallTrials]:
    """Return the trials in `folder`, one person and feedback after the other.

    Raises:
        ConfigError: If the file is missing or damaged.
    """
    table = read_table(
        folder / FILE,
        numbers=(
            *("tar_x", "tar_y", "index_x", "index_y", "index_z"),
            *("efrc_dir_x", "efrc_dir_y", "efrc_dir_z"),
        ),
        texts=("subject", "session", "feedback"),
    )
    strange = next((i for i, text in enumerate(table.texts["feedback"]) if text not in FEEDBACKS), None)
    if strange is not None:
        raise table.refuse(
            strange,
            f"column 'feedback': one of {', '.join(FEEDBACKS)} was expected, got "
            f"{truncate(table.texts['feedback'][strange])}",
        )
    directions = _ours(table.vectors("efrc_dir_x", "efrc_dir_y", "efrc_dir_z"))
    lengths = np.linalg.norm(directions, axis=1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > 0.01)
    if len(wrong):
        raise table.refuse(
            int(wrong[0]),
            f"columns 'efrc_dir_…': a unit vector was expected, its norm is {lengths[wrong[0]]:.3g}",
        )
    directions = directions / lengths[:, None]
    fingers_m = _ours(table.vectors("index_x", "index_y", "index_z"))
    places_m = np.stack(
        [np.full(len(table), WALL_M), -table.numbers["tar_x"], table.numbers["tar_y"]], axis=1
    )
    check_reach(
        table.path, places_m, fingers_m, "target ('tar_x', …) and fingertip ('index_x', …)", table.lines
    )
    ways = places_m - _eyes(table, directions, fingers_m)
    ways = ways / np.linalg.norm(ways, axis=1)[:, None]
    kinds = np.unique(places_m, axis=0, return_inverse=True)[1].reshape(-1)
    trials: list[WallTrials] = []
    for name, rows in table.rows_by("subject", "feedback").items():
        trials.append(
            WallTrials(
                subject=name[0],
                feedback=name[1],
                directions=directions[rows],
                ways=ways[rows],
                targets=kinds[rows].astype(np.int64),
            )
        )
    return trials


def _ours(rows: Array) -> Array:
    """Return vectors in our axes, from x right, y up, z ahead."""
    return np.stack([rows[:, 2], -rows[:, 0], rows[:, 1]], axis=1)


def _eyes(table: Table, directions: Array, points_m: Array) -> Array:
    """Return the origin of each ray, given a point on it."""
    eyes_m = np.empty_like(points_m)
    subjects = table.rows_by("subject")
    for (subject, *_), rows in table.rows_by("subject", "session", "feedback").items():
        head_m = _meeting(directions[rows], points_m[rows])
        if head_m is None:  # the hand hung all the time, or its tracker froze: use the other blocks
            whole = subjects[subject,]
            head_m = _meeting(directions[whole], points_m[whole])
        if head_m is None:
            raise table.refuse(
                rows[0],
                f"columns 'efrc_dir_…': the rays of subject {subject} are too few, or too similar, to "
                "determine the eyes; leave the subject out",
            )
        along, points = directions[rows], points_m[rows]
        reach_m = np.einsum("ni,ni->n", along, points - head_m)
        eyes_m[rows] = points - along * reach_m[:, None]
        strange = np.flatnonzero((np.abs(reach_m) > REACH_M) | (eyes_m[rows, 0] > WALL_M - NEAREST_M))
        if len(strange):
            i = int(strange[0])
            raise table.refuse(
                rows[i],
                f"columns 'index_…': the eyes would be {reach_m[i]:.3g} m behind the fingertip and "
                f"{WALL_M - eyes_m[rows[i], 0]:.3g} m before the wall, and at most {REACH_M:g} m and at "
                f"least {NEAREST_M:g} m were expected; are they in metres?",
            )
    return eyes_m


def _meeting(along: Array, points_m: Array) -> Array | None:
    """Return the point closest to all lines, or None if they do not determine it."""
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    normal: Array = across.sum(axis=0)
    if len(along) < _MIN_ROWS or np.linalg.cond(normal) > _WORST_CONDITION:
        return None
    moments: Array = np.einsum("nij,nj->i", across, points_m)
    return np.asarray(np.linalg.solve(normal, moments), dtype=np.float64)
