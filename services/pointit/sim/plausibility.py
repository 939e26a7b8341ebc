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
"""Usual values: the unit that comes nearest is named first."""
_HEAD_RANGE_M, _DISTANCE_RANGE_M = (0.8, 2.5), (0.03, 20.0)
"""Usual heights of a head and distances in a room. A unit with which they are others is not named."""
_TICK_S = 1e-7
"""Tick of .NET and Windows."""
_MIN_EPOCH_US = 8e14
"""Microseconds since 1970 of the year 1995. Ticks of a stopwatch are below."""
_MAX_FRAME = 1e9
"""Maximum number of a frame."""
_EPOCH_TICKS = ((6.29e17, 6.63e17), (1.24e17, 1.57e17))
"""Ticks since the year 1 and since 1601 of the years from 1995 to 2100."""


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
    shown = round_figures_beyond(period_s, MAX_PERIOD_S if period_s > MAX_PERIOD_S else MIN_PERIOD_S)
    return (
        f"samples are {shown} s apart, plausible are {MIN_PERIOD_S:g} to {MAX_PERIOD_S:g} s; "
        f"{_period_remedy(times, period_s)}"
    )


def _period_remedy(times: Array, period_s: float) -> str:
    """Return the likely meaning of `times`, whose median step is `period_s` if they were in seconds."""
    if any(low <= times[0] <= high for low, high in _EPOCH_TICKS):
        return (
            f"they are likely ticks of 100 ns ({1.0 / (period_s * _TICK_S):.3g} Hz): divide them by 1e7, and "
            "name the column t_s"
        )
    if period_s == 1.0 and times[-1] < _MAX_FRAME and (times == np.floor(times)).all():
        return (
            "they are likely frame numbers: divide them by the frame rate and name the column t_s, or name "
            "it t_ms if it is in ms (1000 Hz)"
        )
    names = ("ms", "us", "ns", "min", "hours", "days")
    limits = (MIN_PERIOD_S, MAX_PERIOD_S)
    units = _likely_units(period_s, _PERIOD_S, limits, {unit: TIMES_S[unit] for unit in names})
    if not units:
        return "write seconds, or name the column t_s if it is in seconds"
    texts = [f"{unit} ({1.0 / (period_s * TIMES_S[unit]):.4g} Hz)" for unit in units]
    if MIN_PERIOD_S <= (ticks_s := period_s * _TICK_S) <= MAX_PERIOD_S and abs(times[0]) < _MIN_EPOCH_US:
        texts.append(f"ticks of 100 ns ({1.0 / ticks_s:.4g} Hz)")
    return f"it is likely in {' or '.join(texts)}: name the column t_{units[0]}, or t_s if it is in seconds"


def position_problems(times_s: Array, bodies: Mapping[str, Array]) -> dict[str, tuple[str, list[str]]]:
    """Return the problem and the likely units of bodies whose positions are likely not in metres, by body.

    There are several units if each explains the positions, and none if none does.

    Args:
        times_s: n, rising.
        bodies: n x 3 or n x 2 by body (`robot`, `head`, `points` on the floor), NaN where they are lost.
    """
    problems: dict[str, tuple[str, list[str]]] = {}
    for name in sorted(bodies, key=lambda name: name != "head"):  # the head's height tells its unit
        positions = bodies[name]
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
        of_head = problems.get("head", ("", list[str]()))[1]
        names = of_head if len(of_head) == 1 else ["mm", "cm"]
        units = _likely_units(
            distance_m, _DISTANCE_M, _DISTANCE_RANGE_M, {each: LENGTHS_M[each] for each in names}
        )
        if name == "head":
            lengths_m = {unit: LENGTHS_M[unit] for unit in ("mm", "cm", "in", "ft")}
            units = _likely_units(height_m, _HEAD_M, _HEAD_RANGE_M, lengths_m) or units
        problems[name] = reason, units
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


def _likely_units(
    value: float, usual: float, limits: tuple[float, float], units: Mapping[str, float]
) -> list[str]:
    """Return those of `units` in which `value` is within `limits`, the nearest to `usual` first."""
    fitting = [unit for unit, size in units.items() if limits[0] <= value * size <= limits[1]]
    return sorted(fitting, key=lambda unit: abs(math.log(value * units[unit] / usual)))
