"""Plausibility of recorded times and positions, which tells a likely unit if the columns state none."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pointit.maps.column_units import LENGTHS_M, TIMES_S

Array = NDArray[np.float64]

MIN_PERIOD_S, MAX_PERIOD_S = 0.0004, 0.25
"""Limits of the median time between samples: 2500 Hz and 4 Hz."""

MAX_HEAD_M = 3.0
"""Maximum height of a head over the floor."""

MAX_DISTANCE_M = 100.0
"""Maximum median distance from the origin, and between robot and head."""

MAX_SPEEDS_MPS = {"robot": 30.0, "head": 10.0, "points": math.inf}
"""Maximum speed, which 90 % of the steps keep to, by body. A point on the floor may have any speed."""

_PERIOD_S, _HEAD_M, _DISTANCE_M = 0.02, 1.6, 2.5
"""Usual values, by which the likeliest unit is chosen."""


def round_figures_beyond(value: float, limit: float, figures: int = 4) -> str:
    """Return `value` with as many significant figures, at least `figures`, as show its side of `limit`."""
    while figures < 17 and (float(f"{value:.{figures}g}") - limit) * (value - limit) <= 0.0 != value - limit:
        figures += 1
    return f"{value:.{figures}g}"


def period_problem(times: Array) -> str:
    """Return an error message if `times` (n, rising) are likely not in seconds, else `""`."""
    if len(times) < 3:
        return ""
    period_s = float(np.median(np.diff(times)))
    if MIN_PERIOD_S <= period_s <= MAX_PERIOD_S:
        return ""
    likely = _likely_unit(period_s, _PERIOD_S, {unit: TIMES_S[unit] for unit in ("ms", "us", "ns", "min")})
    in_unit_s = period_s * TIMES_S[likely]
    is_plausible = MIN_PERIOD_S <= in_unit_s <= MAX_PERIOD_S
    shown = round_figures_beyond(period_s, MAX_PERIOD_S if period_s > MAX_PERIOD_S else MIN_PERIOD_S)
    unit = f"it is likely in {likely} ({1.0 / in_unit_s:.4g} Hz): name the column t_{likely}, or t_s"
    return (
        f"samples are {shown} s apart, plausible are {MIN_PERIOD_S:g} to {MAX_PERIOD_S:g} s; "
        f"{unit if is_plausible else 'write seconds, and name the column t_s'} if it is in seconds"
    )


def position_problems(times_s: Array, bodies: Mapping[str, Array]) -> dict[str, tuple[str, str]]:
    """Return the problem and the likely unit of bodies whose positions are likely not in metres, by body.

    Args:
        times_s: n, rising.
        bodies: n x 3 or n x 2 by body (`robot`, `head`, `points` on the floor), NaN where they are lost.
    """
    problems: dict[str, tuple[str, str]] = {}
    for name, positions in bodies.items():
        others = [each for other, each in bodies.items() if other != name and each.shape == positions.shape]
        distances = [np.linalg.norm(positions, axis=1)]
        distances += [np.linalg.norm(positions - other, axis=1) for other in others]
        distance_m = min(
            (float(np.median(each[np.isfinite(each)])) for each in distances if _any(each)), default=0.0
        )
        height_m = abs(float(np.nanmedian(positions[:, 2]))) if name == "head" else 0.0
        speed_mps = _speed_mps(times_s, positions)
        if height_m > MAX_HEAD_M:
            reason = (
                f"the head is {round_figures_beyond(height_m, MAX_HEAD_M)} m above the floor, limit "
                f"{MAX_HEAD_M:g} m"
            )
        elif speed_mps > (limit_mps := MAX_SPEEDS_MPS[name]):
            shown = round_figures_beyond(speed_mps, limit_mps)
            reason = f"the {name} moves at {shown} m/s, limit {limit_mps:g} m/s"
        elif distance_m > MAX_DISTANCE_M:
            reason = (
                f"distances are {round_figures_beyond(distance_m, MAX_DISTANCE_M)} m, limit "
                f"{MAX_DISTANCE_M:g} m"
            )
        else:
            continue
        units, usual_m = (
            (("mm", "cm", "in", "ft"), _HEAD_M) if name == "head" else (("mm", "cm"), _DISTANCE_M)
        )
        value_m = height_m or distance_m
        problems[name] = reason, _likely_unit(value_m, usual_m, {unit: LENGTHS_M[unit] for unit in units})
    return problems


def _any(values: Array) -> bool:
    return bool(np.isfinite(values).any())


def _speed_mps(times_s: Array, positions: Array) -> float:
    """Return the speed to which 90 % of the steps keep."""
    is_known = np.isfinite(positions).all(axis=1)
    if is_known.sum() < 3:
        return 0.0
    steps = np.linalg.norm(np.diff(positions[is_known], axis=0), axis=1)
    return float(np.percentile(steps / np.diff(times_s[is_known]), 90))


def _likely_unit(value: float, usual: float, units: Mapping[str, float]) -> str:
    return min(units, key=lambda unit: abs(math.log(max(value * units[unit], 1e-12) / usual)))
