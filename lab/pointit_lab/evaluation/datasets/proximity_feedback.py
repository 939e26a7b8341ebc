"""`proximity_feedback`: people point at three positions on the floor, without and with a light spot there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array
from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets.plausible import FARTHEST_M, LONGEST_S, check_floor
from pointit_lab.evaluation.recordings.table_file import RecordingTable, check_text, read_table, truncate

Phase = Literal["open_loop_reach", "open_loop_hold", "feedback_reach", "feedback_hold"]
"""Phases in this order; the spot is visible only in the last two."""

NAME = "proximity_feedback"
PREFIX = "user_"
SAMPLE_HZ = 50.0
PHASES: tuple[Phase, ...] = get_args(Phase)

NEAREST_M = 0.1
"""Minimum distance of a target, since one at the feet has no direction."""

_SAME = ("target_x", "target_y", "trial_len_samples")
"""Columns that are constant within a trial."""


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """One phase of a trial."""

    times_s: Array
    """n, from the start of the person's first trial."""
    points_m: Array
    """n x 2: intersection of the ray with the floor in {H}, the feet at 0."""


@dataclass(frozen=True, kw_only=True)
class FloorTrial:
    """A person points at one position on the floor; their feet are at 0, they face along x."""

    subject: str
    number: int
    target_id: str
    target_m: tuple[float, float]
    start_s: float
    """Time from the start of the person's first trial, including rests."""
    phases: dict[Phase, Stretch]
    """Recorded phases."""


def read_floor_trials(folder: Path) -> list[FloorTrial]:
    """Return the trials of all people in `folder`, in order.

    Raises:
        ConfigError: If a file is damaged, or there is none.
    """
    paths = sorted(folder.glob(f"{PREFIX}*.csv"))
    if not paths:
        raise ConfigError(f"{folder}: has no files {PREFIX}*.csv")
    trials: list[FloorTrial] = []
    for path in paths:
        trials += _trials(path)
    return trials


def _trials(path: Path) -> Iterator[FloorTrial]:
    name = path.stem.removeprefix(PREFIX)
    subject = check_text(f"{path}, name of the 'subject'", name)
    columns = ("trial", *_SAME, "t", "x", "y")
    table = read_table(path, numbers=columns, texts=("target_id", "phase"))
    points_m = table.vectors("x", "y")
    check_floor(path, points_m, "columns 'x', 'y'")

    # trials follow each other; a number that comes again is a mistake
    numbers = table.numbers["trial"]
    changes = np.flatnonzero(np.diff(numbers)) + 1
    edges = [0, *changes.tolist(), len(table)]
    seen: set[int] = set()
    start_s = 0.0
    for first, end in pairwise(edges):
        number = int(numbers[first])
        if number != numbers[first] or number in seen:
            problem = f"{numbers[first]:g} is not an integer, or its rows are not contiguous"
            raise table.refuse(
                first, f"column 'trial': {problem}; number the trials, and keep the rows of each together"
            )
        seen.add(number)
        length_s = _length_s(table, first, end)
        stretches, recorded_s = _phases(table, points_m, range(first, end), start_s)
        if recorded_s > length_s + 1.0:
            samples = length_s * SAMPLE_HZ
            raise table.refuse(
                first,
                f"column 'trial_len_samples': {samples:g} samples last {length_s:g} s, but the "
                f"phases of the trial last {recorded_s:g} s by column 't'; is it in seconds?",
            )
        yield FloorTrial(
            subject=subject,
            number=number,
            target_id=table.texts["target_id"][first],
            target_m=_target_m(table, first),
            start_s=start_s,
            phases=stretches,
        )
        start_s += length_s


def _target_m(table: RecordingTable, row: int) -> tuple[float, float]:
    x_m = float(table.numbers["target_x"][row])
    y_m = float(table.numbers["target_y"][row])
    return x_m, y_m


def _length_s(table: RecordingTable, first: int, end: int) -> float:
    """Return the duration of the trial in rows `first` to `end`, s, after checking that all rows agree."""
    columns: dict[str, NDArray[Any]] = {}
    for name in _SAME:
        columns[name] = table.numbers[name][first:end]
    columns["target_id"] = np.array(table.texts["target_id"][first:end])
    for name, values in columns.items():
        others = np.flatnonzero(values != values[0])
        if len(others):
            other = int(others[0])
            expected = f"{values[0]}, as in the other rows of the trial"
            raise table.refuse(
                first + other, f"column {name!r}: {values[other]} was expected to be {expected}"
            )

    # so the first row has the values of all
    away_m = np.hypot(*_target_m(table, first))
    if not NEAREST_M <= away_m <= FARTHEST_M:
        expected = f"{NEAREST_M:g} to {FARTHEST_M:g} m were expected"
        raise table.refuse(
            first,
            f"columns 'target_x', 'target_y': the target is {away_m:g} m from the feet, and {expected}; "
            "is it in metres?",
        )
    samples = float(table.numbers["trial_len_samples"][first])
    max_samples = LONGEST_S * SAMPLE_HZ
    if not 0.0 < samples <= max_samples:
        raise table.refuse(
            first,
            f"column 'trial_len_samples': must be above 0 and at most {max_samples:g}, a day, "
            f"got {samples:g}",
        )
    return samples / SAMPLE_HZ


def _phases(
    table: RecordingTable, points_m: Array, trial: range, start_s: float
) -> tuple[dict[Phase, Stretch], float]:
    """Return the phases of a `trial` in order, and their total duration."""
    first = trial.start
    names = table.texts["phase"][first : trial.stop]
    _check_order(table, names, first)

    # each phase counts its seconds from 0, a sample after the one before
    stretches: dict[Phase, Stretch] = {}
    phase_start_s = start_s
    for phase in dict.fromkeys(names):
        is_phase = np.array(names) == phase
        rows = first + np.flatnonzero(is_phase)
        times = table.numbers["t"][rows]
        _check_seconds(table, phase, rows)
        stretch = Stretch(times_s=phase_start_s + times, points_m=points_m[rows])
        stretches[cast("Phase", phase)] = stretch
        phase_start_s += float(times[-1]) + 1.0 / SAMPLE_HZ
    return stretches, phase_start_s - start_s


def _check_order(table: RecordingTable, names: Sequence[str], first: int) -> None:
    """Check the `names` of phases in the rows from `first`.

    Raises:
        ConfigError: If one is unknown, or comes after a later one.
    """
    order = ", ".join(PHASES)
    last = 0
    for row, name in enumerate(names, start=first):
        if name not in PHASES:
            raise table.refuse(row, f"column 'phase': one of {order} was expected, got {truncate(name)}")
        rank = PHASES.index(name)
        if rank < last:
            raise table.refuse(
                row, f"column 'phase': {name} comes after {PHASES[last]}; keep the order {order}"
            )
        last = rank


def _check_seconds(table: RecordingTable, phase: str, rows: NDArray[np.intp]) -> None:
    """Check the times of a `phase`, in `rows`.

    Raises:
        ConfigError: If they do not increase, or one is negative.
    """
    times = table.numbers["t"][rows]
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if len(back):
        before = int(back[0])
        after = before + 1
        number = table.numbers["trial"][rows[0]]
        raise table.refuse(
            int(rows[after]),
            f"column 't' must increase within {phase} of trial {number:.0f}, got "
            f"{times[after]:g} after {times[before]:g}",
        )
    if times[0] < 0.0:
        expected = f"seconds since {phase} began were expected"
        raise table.refuse(int(rows[0]), f"column 't': {expected}, got {times[0]:g}")


def _length_s(table: RecordingTable, first: int, end: int) -> float:
    """Return the duration of the trial in rows `first` to `end`, s, after checking that all rows agree."""
    columns: dict[str, NDArray[Any]] = {name: table.numbers[name][first:end] for name in _SAME}
    columns["target_id"] = np.array(table.texts["target_id"][first:end])
    for name, values in columns.items():
        others = np.flatnonzero(values != values[0])
        if len(others):
            other = int(others[0])
            raise table.refuse(
                first + other,
                f"column {name!r}: {values[other]} was expected to be {values[0]}, as in the other rows "
                "of the trial",
            )

    # so the first row has the values of all
    target_m = np.hypot(table.numbers["target_x"][first], table.numbers["target_y"][first])
    if not NEAREST_M <= target_m <= FARTHEST_M:
        raise table.refuse(
            first,
            f"columns 'target_x', 'target_y': the target is {target_m:g} m from the feet, and {NEAREST_M:g} "
            f"to {FARTHEST_M:g} m were expected; is it in metres?",
        )
    samples = float(table.numbers["trial_len_samples"][first])
    if not 0.0 < samples <= LONGEST_S * SAMPLE_HZ:
        raise table.refuse(
            first,
            f"column 'trial_len_samples': must be above 0 and at most {LONGEST_S * SAMPLE_HZ:g}, a day, got "
            f"{samples:g}",
        )
    return samples / SAMPLE_HZ


def _phases(
    table: RecordingTable, points_m: Array, trial: range, start_s: float
) -> tuple[dict[Phase, Stretch], float]:
    """Return the phases of a `trial` in order, and their total duration."""
    first = trial.start
    names = table.texts["phase"][first : trial.stop]
    last = 0
    for i, name in enumerate(names):
        if name not in PHASES:
            raise table.refuse(
                first + i, f"column 'phase': one of {', '.join(PHASES)} was expected, got {truncate(name)}"
            )
        rank = PHASES.index(name)
        if rank < last:
            raise table.refuse(
                first + i,
                f"column 'phase': {name} comes after {PHASES[last]}; keep the order {', '.join(PHASES)}",
            )
        last = rank

    # each phase counts its seconds from 0, a sample after the one before
    stretches: dict[Phase, Stretch] = {}
    begins_s = start_s
    for phase in dict.fromkeys(names):
        is_phase = np.array(names) == phase
        rows = first + np.flatnonzero(is_phase)
        times = table.numbers["t"][rows]
        back = np.flatnonzero(np.diff(times) <= 0.0)
        if len(back):
            before = int(back[0])
            after = before + 1
            number = table.numbers["trial"][first]
            raise table.refuse(
                int(rows[after]),
                f"column 't' must increase within {phase} of trial {number:.0f}, got "
                f"{times[after]:g} after {times[before]:g}",
            )
        if times[0] < 0.0:
            raise table.refuse(
                int(rows[0]), f"column 't': seconds since {phase} began were expected, got {times[0]:g}"
            )
        stretch = Stretch(times_s=begins_s + times, points_m=points_m[rows])
        stretches[cast("Phase", phase)] = stretch
        begins_s += float(times[-1]) + 1.0 / SAMPLE_HZ
    return stretches, begins_s - start_s
