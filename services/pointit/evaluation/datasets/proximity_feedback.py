"""`proximity_feedback`: people point at three places on the floor, without and with a spot of light there."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from pointit.evaluation.table_file import Table, read_table
from pointit.runtime.errors import ConfigError

Array = NDArray[np.float64]

NAME = "proximity_feedback"
PREFIX = "user_"
SAMPLE_HZ = 50.0

Phase = Literal["open_loop_reach", "open_loop_hold", "feedback_reach", "feedback_hold"]
"""In this order; the spot is seen in the last two only."""

PHASES: tuple[Phase, ...] = get_args(Phase)


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """One phase of a trial."""

    times_s: Array
    """n, from the beginning of the person's first trial."""
    points_m: Array
    """n x 2: where the ray meets the floor in {H}, the feet at 0."""


@dataclass(frozen=True, kw_only=True)
class FloorTrial:
    """Somebody points at one place on the floor; their feet are at 0, they face along x."""

    subject: str
    number: int
    target_id: str
    target_m: tuple[float, float]
    start_s: float
    """From the beginning of the person's first trial, rests counted as they lasted."""
    phases: dict[Phase, Stretch]
    """Those that were recorded."""


def read_floor_trials(folder: Path) -> list[FloorTrial]:
    """Return the trials of all people in `folder`, in order.

    Raises:
        ConfigError: a file is damaged, or there is none.
    """
    paths = sorted(folder.glob(f"{PREFIX}*.csv"))
    if not paths:
        raise ConfigError(f"{folder}: has no files {PREFIX}*.csv")
    return [trial for path in paths for trial in _trials(path)]


def _trials(path: Path) -> Iterator[FloorTrial]:
    table = read_table(
        path,
        numbers=("trial", "target_x", "target_y", "t", "x", "y", "trial_len_samples"),
        texts=("target_id", "phase"),
    )
    numbers = table.numbers["trial"]
    edges = [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist(), len(table)]
    start_s = 0.0
    for first, end in pairwise(edges):
        length_s = float(table.numbers["trial_len_samples"][first]) / SAMPLE_HZ
        if length_s <= 0.0:
            raise ConfigError(f"{path}, line {first + 2}, column 'trial_len_samples': must be above 0")
        yield FloorTrial(
            subject=path.stem.removeprefix(PREFIX),
            number=int(numbers[first]),
            target_id=table.texts["target_id"][first],
            target_m=(float(table.numbers["target_x"][first]), float(table.numbers["target_y"][first])),
            start_s=start_s,
            phases=_phases(table, first, end, start_s),
        )
        start_s += length_s


def _phases(table: Table, first: int, end: int, start_s: float) -> dict[Phase, Stretch]:
    """Return the phases of rows `first` to `end`, one after the other."""
    names = table.texts["phase"][first:end]
    strange = next((i for i, name in enumerate(names) if name not in PHASES), None)
    if strange is not None:
        raise ConfigError(
            f"{table.path}, line {first + strange + 2}, column 'phase': one of {', '.join(PHASES)} was "
            f"expected, got {names[strange]!r}"
        )
    out: dict[Phase, Stretch] = {}
    begins_s = start_s
    for phase in dict.fromkeys(names):
        rows = first + np.flatnonzero(np.array(names) == phase)
        times = table.numbers["t"][rows]
        if len(times) > 1 and not np.all(np.diff(times) > 0.0):
            raise ConfigError(
                f"{table.path}, trial {table.numbers['trial'][first]:.0f}, {phase}: column 't' must increase"
            )
        out[cast("Phase", phase)] = Stretch(
            times_s=begins_s + times, points_m=table.vectors("x", "y")[rows].astype(np.float64)
        )
        begins_s += float(times[-1]) + 1.0 / SAMPLE_HZ
    return out
