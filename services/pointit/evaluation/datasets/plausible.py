"""What recordings of people can be: who is beyond wrote other units, or is damaged."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointit.runtime.errors import ConfigError

Array = NDArray[np.float64]

LONGEST_S = 86_400.0
"""Nobody points for longer than a day."""

LONGEST_STEP_S = 0.5
"""The localizer takes longer ones for pauses: at least half of the steps of a recording are shorter."""

MOST_HZ = 1100.0
"""No sensor on an arm is faster than 1000 Hz, some clocks are a little."""

FARTHEST_M = 100.0
"""Nobody points at something farther off."""


def check_times(path: Path, times_s: Array, name: str = "column 't'") -> None:
    """Refuse times of samples that are not those of a recording in seconds.

    Args:
        path: for the sentence.
        times_s: n, at least one.
        name: of the column or array, for the sentence.

    Raises:
        ConfigError: they go backwards, last longer than a day, or are not as far apart as samples are.
    """
    steps_s = np.diff(times_s)
    back = np.flatnonzero(steps_s < 0.0)
    if len(back):
        i = int(back[0])
        raise ConfigError(
            f"{path}, {name}: time goes backwards, {times_s[i + 1]:g} after {times_s[i]:g}; sort the rows"
        )
    span_s = float(times_s[-1] - times_s[0])
    if span_s > LONGEST_S:
        raise ConfigError(
            f"{path}, {name}: the recording lasts {span_s:g} s and at most {LONGEST_S:g} s are read; "
            "is it in seconds?"
        )
    if len(steps_s) and np.median(steps_s) > LONGEST_STEP_S:
        raise ConfigError(
            f"{path}, {name}: the samples are {np.median(steps_s):g} s apart and at most "
            f"{LONGEST_STEP_S:g} s were expected; is it in seconds?"
        )
    if len(steps_s) >= 10 and len(steps_s) > MOST_HZ * span_s:
        raise ConfigError(
            f"{path}, {name}: {len(times_s)} samples lie within {span_s:g} s, more than {MOST_HZ:g} a "
            "second; is it in seconds?"
        )


def check_reach(
    path: Path, targets_m: Array, people_m: Array, what: str, lines: Sequence[int] | None = None
) -> None:
    """Refuse targets that are too far away for anybody to point at.

    Args:
        path: for the sentence.
        targets_m: n x k, k of 2 or 3.
        people_m: n x k, who points at them.
        what: the target and the person in it, with the names of their columns.
        lines: n, of the file, where they are known.

    Raises:
        ConfigError: names the first one.
    """
    away_m = np.linalg.norm(targets_m - people_m, axis=1)
    far = np.flatnonzero(~(away_m <= FARTHEST_M))
    if len(far):
        i = int(far[0])
        line = f", line {lines[i]}" if lines is not None else ""
        raise ConfigError(
            f"{path}{line}: {what} are {away_m[i]:g} m apart and at most {FARTHEST_M:g} m were expected; are "
            "they in metres, in one frame?"
        )


def check_floor(path: Path, points_m: Array, names: str) -> None:
    """Refuse points on the floor that are not in metres; single ones may be anywhere, near the horizon.

    Args:
        path: for the sentence.
        points_m: n x 2, from the feet.
        names: of the columns, for the sentence.

    Raises:
        ConfigError: most are too far away.
    """
    away_m = float(np.median(np.hypot(points_m[:, 0], points_m[:, 1]))) if len(points_m) else 0.0
    if away_m > FARTHEST_M:
        raise ConfigError(
            f"{path}, {names}: half of the points on the floor are farther than {away_m:g} m away, and at "
            f"most {FARTHEST_M:g} m were expected; are they in metres?"
        )
