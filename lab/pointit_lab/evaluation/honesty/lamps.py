"""Trials at a few lamps, taken from people who have pointed once at each lamp of a room."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.localization.trial import Array, Trial

COUNTS = (3, 4, 6)
"""Numbers of lamps."""

PAUSE_S = 2.0
"""Pause between two holds."""

WALL_M = 0.01
"""Difference of the x of lamps on one wall."""


def chosen(
    room: Trial, count: int, rng: np.random.Generator, *, wrong_lamp: bool = False, one_wall: bool = False
) -> Trial:
    """Return the pointing at `count` random lamps of `room`, one hold after the other.

    Args:
        room: a hold at each of more than `count` lamps.
        count: number of lamps.
        rng: for the choice.
        wrong_lamp: True if during one hold the person pointed at another lamp than the lit one, which was not
            lit otherwise.
        one_wall: True to choose lamps of equal x.
    """
    pointings = room.pointings
    starts = np.append(True, np.any(np.diff(pointings.targets_m, axis=0) != 0.0, axis=1))
    holds: list[NDArray[np.intp]] = np.split(np.arange(len(pointings)), np.flatnonzero(starts)[1:])
    lamps_m = pointings.targets_m[np.flatnonzero(starts)]
    among: NDArray[np.intp] = np.arange(len(holds))
    if one_wall:
        walls = [np.flatnonzero(np.abs(lamps_m[:, 0] - x_m) < WALL_M) for x_m in lamps_m[:, 0].tolist()]
        walls = [wall for wall in walls if len(wall) >= count]
        among = walls[int(rng.integers(len(walls)))]
    order: list[int] = rng.choice(among, size=count + wrong_lamp, replace=False).tolist()
    pointed = order[:count]
    lit_m = lamps_m[pointed].copy()
    if wrong_lamp:
        lit_m[rng.integers(count)] = lamps_m[order[-1]]
    stamps_s: list[Array] = []
    began_s = 0.0
    for index in pointed:
        stamps_s.append(pointings.stamps_s[holds[index]] - pointings.stamps_s[holds[index][0]] + began_s)
        began_s = float(stamps_s[-1][-1]) + PAUSE_S
    held = [holds[index] for index in pointed]
    rows = np.concatenate(held)
    targets_m = np.repeat(lit_m, [len(each) for each in held], axis=0)
    return replace(
        room,
        condition=f"{count} lamps",
        pointings=Pointings(
            np.concatenate(stamps_s), pointings.origins_m[rows], pointings.directions[rows], targets_m
        ),
    )
