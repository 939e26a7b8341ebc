"""`vr_arm_pointing`: people in virtual reality point at static targets, seeing a hand but no cursor.

The recorded rays are in the room's axes, whose origin is the person's position. Each trial has a random yaw
origin and map origin, as in reality; otherwise a solver that starts at zero would start at the truth.
"""

import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pointit.geometry.array_types import Array
from pointit.runtime.errors import ConfigError
from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.datasets.plausible import check_reach
from pointit_lab.evaluation.localization.arm_rays import along, eye_finger_rays, eye_height_m, scaled_body
from pointit_lab.evaluation.localization.trial import LocalizationTrial, TrialReading
from pointit_lab.evaluation.recordings.table_file import RecordingTable, is_file, read_table

NAME = "vr_arm_pointing"
FILE = "endpoints.csv"

TARGETS = (2, 3, 4, 6)
"""Numbers of different targets in a trial."""

ALL_TARGETS = 27
"""Number of targets in the room."""

SUBSETS = 100
"""Trials of each subject and number of targets: random targets, a random act of each."""

HOLD_S = 2.0
HOLD_RAYS = 40
"""Rays of a hold. An act, recorded only at its end, is given as a hold of equal rays as long as at a lamp."""

ROOM_M = 3.0
"""Maximum distance of a random map origin from the recorded one, along each axis."""

PAUSE_S = 2.0
"""Pause between two holds."""

STATURES_M = (0.5, 2.5)

FOREARMS_M = (0.01, 1.0)

MAX_SUBJECTS = 100
"""Limit of subjects, which bounds the memory of an evaluation."""

_ACTED = ("hmd_x", "hmd_y", "forearm_x", "forearm_y", "forearm_z", "hand_x", "hand_y", "hand_z")
_TARGET = ("target_x", "target_y", "target_z")


@dataclass(frozen=True, kw_only=True)
class RecordedActs:
    """All acts of one subject."""

    subject: str
    eye_height_m: float
    origins_m: Array
    directions: Array
    targets_m: Array
    heads_m: Array
    """n x 2."""
    kinds: NDArray[np.int64]
    """n: index of the target."""
    lean_rad: float
    """Mean angle of the rays to the left of the targets, since forearms are not parallel to them."""


def read(
    folder: Path, reading: TrialReading, counts: Sequence[int] = TARGETS, subsets: int = SUBSETS
) -> None:
    """Add random subsets of the targets of each subject, the same ones in each run.

    Args:
        folder: of the set.
        reading: gets the trials.
        counts: numbers of different targets in a trial.
        subsets: trials of each subject and number of targets.

    Raises:
        ConfigError: If the file is damaged.
    """
    path = folder / FILE
    if not is_file(path):
        reading.skip(path, "it is missing")
        return
    for acts in read_acts(path):
        for count in counts:
            _add(acts, count, subsets, reading)


def read_acts(path: Path) -> Iterator[RecordedActs]:
    """Yield the acts of each subject, in the order of the file.

    Raises:
        ConfigError: If the file is damaged.
    """
    table = read_table(path, numbers=("stature", *_TARGET, *_ACTED), texts=("subject",))
    groups = table.rows_by("subject")
    if len(groups) > MAX_SUBJECTS:
        problem = f"has {len(groups)} subjects, limit {MAX_SUBJECTS}"
        raise ConfigError(f"{path}, column 'subject': {problem}; is it the subject? then split the file")
    for (subject,), rows in groups.items():
        yield _acts_of(table.only(rows), subject)


def _acts_of(table: RecordingTable, subject: str) -> RecordedActs:
    """Return the acts of `subject`; `table` has only their rows."""
    body = scaled_body(_stature_m(table))
    # a straight arm in the direction of the forearm
    orientations = map(along, _forearms(table).tolist())
    origins_m, directions = eye_finger_rays(orientations, body)

    targets_m = table.vectors(*_TARGET)
    heads_m = table.vectors("hmd_x", "hmd_y")
    floor_m = np.zeros(len(table))
    people_m = np.column_stack([heads_m, floor_m])
    names = "target ('target_x', …) and head ('hmd_x', …)"
    check_reach(table.path, targets_m, people_m, names, table.lines)

    # the mean error sideways is that of the yaw in which people point
    away_m = targets_m[:, :2] - heads_m
    azimuths = np.arctan2(directions[:, 1], directions[:, 0])
    target_azimuths = np.arctan2(away_m[:, 1], away_m[:, 0])
    turns = azimuths - target_azimuths
    mean_turn = np.exp(1j * turns).mean()
    _, kinds = np.unique(targets_m, axis=0, return_inverse=True)
    return RecordedActs(
        subject=subject,
        eye_height_m=eye_height_m(body),
        origins_m=origins_m,
        directions=directions,
        targets_m=targets_m,
        heads_m=heads_m,
        kinds=kinds.reshape(-1),
        lean_rad=float(np.angle(mean_turn)),
    )


def _stature_m(table: RecordingTable) -> float:
    """Return the median stature.

    Raises:
        ConfigError: If one is not plausible.
    """
    statures_m = table.numbers["stature"]
    row = _row_outside(statures_m, STATURES_M)
    if row is not None:
        least_m, most_m = STATURES_M
        problem = f"metres were expected, got {statures_m[row]:g}"
        raise table.refuse(row, f"column 'stature': {problem}; give {least_m:g} to {most_m:g}")
    return float(np.median(statures_m))


def _forearms(table: RecordingTable) -> Array:
    """Return the vectors (n x 3, m) from the middle of the forearm to the hand.

    Raises:
        ConfigError: If the length of one is not plausible.
    """
    hands_m = table.vectors("hand_x", "hand_y", "hand_z")
    forearms = hands_m - table.vectors("forearm_x", "forearm_y", "forearm_z")
    lengths_m = np.linalg.norm(forearms, axis=1)
    row = _row_outside(lengths_m, FOREARMS_M)
    if row is not None:
        least_m, most_m = FOREARMS_M
        expected = f"{least_m:g} to {most_m:g} m were expected"
        raise table.refuse(
            row,
            f"columns 'hand_…', 'forearm_…': they are {lengths_m[row]:g} m apart, and {expected}; "
            "are they in metres?",
        )
    return forearms


def _row_outside(values: Array, limits: tuple[float, float]) -> int | None:
    """Return the first row whose value is outside `limits`, or None."""
    least, most = limits
    outside = np.flatnonzero((values < least) | (values > most))
    return int(outside[0]) if len(outside) else None


def _add(acts: RecordedActs, count: int, subsets: int, reading: TrialReading) -> None:
    kinds = int(acts.kinds.max()) + 1
    if kinds < count:
        problem = f"has {kinds} targets, so there are no trials of {count}"
        reading.notes.append(f"{NAME}, subject {acts.subject}: {problem}")
        return

    # each trial draws its targets and their acts, then a pose of the map
    seed = zlib.crc32(acts.subject.encode())
    random = np.random.default_rng([seed, count])
    for _ in range(subsets):
        chosen: list[int] = []
        for kind in random.choice(kinds, size=count, replace=False):
            candidates = np.flatnonzero(acts.kinds == kind)
            chosen.append(int(random.choice(candidates)))
        # the trial is in axes of its own, as those of an IMU and of a map
        yaw_rad = float(random.uniform(-math.pi, math.pi))
        origin_m = random.uniform(-ROOM_M, ROOM_M, 2)
        head = acts.heads_m[chosen].mean(axis=0)
        place_m = head - origin_m
        trial = LocalizationTrial(
            set=NAME,
            subject=acts.subject,
            condition=f"{count} targets",
            pointings=_holds(acts, chosen, yaw_rad, origin_m),
            eye_height_m=acts.eye_height_m,
            x_m=float(place_m[0]),
            y_m=float(place_m[1]),
            yaw_rad=math.remainder(yaw_rad - acts.lean_rad, math.tau),
        )
        reading.trials.append(trial)


def _holds(acts: RecordedActs, chosen: Sequence[int], yaw_rad: float, origin_m: Array) -> Pointings:
    """Return each act as a hold, with the IMU's yaw origin at `yaw_rad` and the map's at `origin_m`."""
    within_s = np.arange(HOLD_RAYS) * (HOLD_S / HOLD_RAYS)
    holds = np.arange(len(chosen))
    starts_s = holds * (HOLD_S + PAUSE_S)
    stamps_s = starts_s[:, None] + within_s

    rows = np.repeat(chosen, HOLD_RAYS)
    turn = Rotation.from_rotvec([0.0, 0.0, -yaw_rad])
    origins_m = turn.apply(acts.origins_m[rows])
    directions = turn.apply(acts.directions[rows])
    map_origin_m = np.append(origin_m, 0.0)
    targets_m = acts.targets_m[rows] - map_origin_m
    return Pointings(stamps_s.reshape(-1), origins_m, directions, targets_m)
