"""Plausibility limits for recordings of people: values beyond have other units, or are damaged."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pointit.geometry.array_types import Array
from pointit.runtime.errors import ConfigError

LONGEST_S = 86_400.0
"""Limit of a recording: one day."""

LONGEST_STEP_S = 0.5
"""Limit of the median step; the localizer treats longer ones as pauses."""

MAX_HZ = 1100.0
"""Limit of the sample rate: sensors on an arm reach 1000 Hz, and some clocks are slightly fast."""

FARTHEST_M = 100.0
"""Limit of the distance from person to target."""


def check_times(path: Path, times_s: Array, name: str = "column 't'") -> None:
    """Check that times of samples are those of a recording in seconds.

    Args:
        path: file, for the message.
        times_s: n, at least one.
        name: column or array, for the message.

    Raises:
        ConfigError: If they go backwards, last longer than a day, or have an implausible step.
    """
    source = f"{path}, {name}"
    steps_s = np.diff(times_s)
    back = np.flatnonzero(steps_s < 0.0)
    if len(back):
        i = int(back[0])
        before_s = times_s[i]
        after_s = times_s[i + 1]
        raise ConfigError(f"{source}: time goes backwards, {after_s:g} after {before_s:g}; sort the rows")

    # most often they are milliseconds or nanoseconds
    span_s = float(times_s[-1] - times_s[0])
    if span_s > LONGEST_S:
        limit = f"at most {LONGEST_S:g} s are read"
        raise ConfigError(f"{source}: the recording lasts {span_s:g} s and {limit}; is it in seconds?")
    if not len(steps_s):
        return
    step_s = np.median(steps_s)
    if step_s > LONGEST_STEP_S:
        limit = f"at most {LONGEST_STEP_S:g} s were expected"
        raise ConfigError(f"{source}: the samples are {step_s:g} s apart and {limit}; is it in seconds?")

    # a few samples may come together by chance
    max_steps = MAX_HZ * span_s
    if len(steps_s) >= 10 and len(steps_s) > max_steps:
        samples = f"{len(times_s)} samples lie within {span_s:g} s"
        raise ConfigError(f"{source}: {samples}, more than {MAX_HZ:g} a second; is it in seconds?")


def check_reach(
    path: Path, targets_m: Array, people_m: Array, quantity: str, lines: Sequence[int] | None = None
) -> None:
    """Check that targets are close enough for a person to point at.

    Args:
        path: file, for the message.
        targets_m: n x k, k of 2 or 3.
        people_m: n x k, positions of the people who point at them.
        quantity: target and person, with the names of their columns.
        lines: n, lines of the file, if known.

    Raises:
        ConfigError: If one is too far; names the first.
    """
    away_m = np.linalg.norm(targets_m - people_m, axis=1)
    far = np.flatnonzero(~(away_m <= FARTHEST_M))  # so NaN is far, too
    if not len(far):
        return
    i = int(far[0])
    line = "" if lines is None else f", line {lines[i]}"
    problem = f"{quantity} are {away_m[i]:g} m apart and at most {FARTHEST_M:g} m were expected"
    raise ConfigError(f"{path}{line}: {problem}; are they in metres, in one frame?")


def check_floor(path: Path, points_m: Array, names: str) -> None:
    """Check that points on the floor are in metres; single ones may be anywhere, near the horizon.

    Args:
        path: file, for the message.
        points_m: n x 2, from the feet.
        names: columns, for the message.

    Raises:
        ConfigError: If most are too far away.
    """
    if not len(points_m):
        return
    distances_m = np.hypot(points_m[:, 0], points_m[:, 1])
    away_m = float(np.median(distances_m))
    if away_m > FARTHEST_M:
        problem = f"half of the points on the floor are farther than {away_m:g} m away"
        raise ConfigError(
            f"{path}, {names}: {problem}, and at most {FARTHEST_M:g} m were expected; are they in metres?"
        )
