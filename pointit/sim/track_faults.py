"""Faults of a recorded track, jumps and constants of lost markers, and plausibility of times and positions.

A body moves on from row to row. A position that occurs again and again, exactly equal and far from the rows
around it, is a constant for "lost". A row that is far from those around it, which are near to each other, is
a jump of one row. Other jumps change the course: markers that are swapped or set off.
"""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

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


Mask = NDArray[np.bool_]

MIN_ROWS = 6
"""Number of known rows from which jumps are looked for."""
MIN_JUMP, MIN_TURN = 0.05, 0.25
"""Minimum length of a jump, m, and chord of one of a quaternion: 0.5 rad."""
_MIN_SPEED = 2.5
"""Minimum speed of a jump, units/s."""
_SPEED_RATIO = 5.0
"""Minimum ratio of a jump's speed to the usual one."""
_IMPROBABLE = 20.0
"""Distance from all other rows from which a constant is improbable, m."""
_NEARBY_STEPS = 5
"""Number of steps before and behind a jump that show the usual speed."""
_MAX_JUMPS = 6
"""Number of jumps that is noted, even if there are no other steps."""
_MAX_CONSTANTS = 8
"""Number of the most frequent positions that are examined."""


class TrackFaults(NamedTuple):
    """Rows of a track with faults, each n."""

    constant: Mask
    """Rows with a constant for "lost"."""
    one_row: Mask
    """Rows that jump away for one row."""
    course: Mask
    """Rows behind a jump to another course."""

    def sentences(self, vectors: Array) -> Iterator[tuple[Mask, str, str]]:
        """Yield the rows, the problem and the remedy of each kind of fault in `vectors`."""
        if self.constant.any():
            values = np.unique(vectors[self.constant], axis=0)[:3].tolist()
            text = " or ".join(", ".join(f"{value:.6g}" for value in each) for each in values)
            problem = f"{text}, far from the rows around,"
            yield self.constant, problem, "taken as lost and left out, leave lost cells empty"
        if self.one_row.any():
            yield self.one_row, "jumps away for one row", "left out, filter or correct the recording"
        if self.course.any():
            remedy = "used as it is, look for swapped or shifted markers, and correct or empty these rows"
            yield self.course, "jumps to another course", remedy


class _Track:
    """The known rows of a track."""

    def __init__(self, times_s: Array, vectors: Array, is_known: Mask, *, is_turn: bool) -> None:
        self.rows = np.flatnonzero(is_known)
        self.times_s, self.vectors = times_s[self.rows], vectors[self.rows]
        self.is_turn = is_turn
        self._min_jump = MIN_TURN if is_turn else MIN_JUMP
        periods_s = np.diff(self.times_s)
        self._period_s = float(np.median(periods_s)) if len(periods_s) else 1.0

    def distances(self, first: NDArray[np.intp], second: NDArray[np.intp]) -> Array:
        """Return the distances between rows; `q` and `-q` are the same rotation."""
        before, after = self.vectors[first], self.vectors[second]
        apart = np.linalg.norm(after - before, axis=1)
        turned = np.linalg.norm(after + before, axis=1) if self.is_turn else apart
        return np.asarray(np.minimum(apart, turned), dtype=np.float64)

    def are_far(self, first: NDArray[np.intp], second: NDArray[np.intp], usual_speed: Array) -> Mask:
        """Return True for pairs of rows that are farther apart than `usual_speed`, units/s, explains."""
        seconds = np.maximum(self.times_s[second] - self.times_s[first], self._period_s)
        limit = np.maximum(self._min_jump + _SPEED_RATIO * usual_speed * seconds, _MIN_SPEED * seconds)
        return self.distances(first, second) > limit

    def jumps(self) -> Mask:
        """Return True for each row behind a jump."""
        count = len(self.rows)
        is_jump = np.zeros(count, dtype=bool)
        if count < MIN_ROWS:
            return is_jump
        every = np.arange(count)
        speeds = self.distances(every[:-1], every[1:]) / np.maximum(np.diff(self.times_s), self._period_s)
        likely = np.flatnonzero(self.are_far(every[:-1], every[1:], np.zeros(count - 1)))
        padded = np.pad(speeds, _NEARBY_STEPS, constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(padded, _NEARBY_STEPS)
        before, after = _medians(windows[likely]), _medians(windows[likely + _NEARBY_STEPS + 1])
        usual = np.maximum(before, after)
        is_jump[likely[self.are_far(likely, likely + 1, usual)] + 1] = True
        return is_jump


def find_track_faults(times_s: Array, vectors: Array, *, is_turn: bool, has_course: bool) -> TrackFaults:
    """Return the faults of a track.

    Args:
        times_s: n, rising.
        vectors: n x k, positions or quaternions, NaN where they are lost.
        is_turn: True for quaternions.
        has_course: True if the body moves on from row to row; else only constants are looked for.
    """
    is_known = np.asarray(np.isfinite(vectors).all(axis=1), dtype=bool)
    constant = np.zeros(len(vectors), dtype=bool)
    one_row, course = constant.copy(), constant.copy()
    while (more := _constant(_Track(times_s, vectors, is_known, is_turn=is_turn))) is not None:
        constant[more] = True
        is_known = is_known & ~constant
    if has_course:
        track = _Track(times_s, vectors, is_known, is_turn=is_turn)
        one_row[track.rows[_single(track)]] = True
        track = _Track(times_s, vectors, is_known & ~one_row, is_turn=is_turn)
        is_jump = track.jumps()
        steps = np.count_nonzero(np.diff(track.vectors, axis=0).any(axis=1))
        if is_jump.sum() <= max(_MAX_JUMPS, steps / 3.0):  # else a slow tracker holds its last position
            course[track.rows[is_jump]] = True
    return TrackFaults(constant, one_row, course)


def _medians(windows: Array) -> Array:
    """Return the medians of rows, 0 of those without numbers."""
    has_number = np.isfinite(windows).any(axis=1)
    medians = np.zeros(len(windows))
    medians[has_number] = np.nanmedian(windows[has_number], axis=1)
    return medians


def _single(track: _Track) -> NDArray[np.intp]:
    """Return the indices of rows of `track` that jump away and back at once."""
    is_jump = track.jumps()
    away = np.flatnonzero(is_jump[1:-1] & is_jump[2:]) + 1
    if not len(away):
        return away
    is_back = track.distances(away - 1, away + 1) < 0.5 * np.minimum(
        track.distances(away - 1, away), track.distances(away, away + 1)
    )
    return away[is_back]


def _constant(track: _Track) -> NDArray[np.intp] | None:
    """Return the rows of the next constant for "lost", None if there is none."""
    if len(track.rows) < MIN_ROWS:
        return None
    values, inverse, counts = np.unique(track.vectors, axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.reshape(-1)
    repeated = [at for at in np.argsort(-counts, kind="stable")[:_MAX_CONSTANTS].tolist() if counts[at] > 1]
    repeated.sort(key=lambda at: (not _is_one_number(values[at]), counts[at]))
    for at in repeated:
        is_value = inverse == at
        if _is_lost(track, is_value, is_one_number=_is_one_number(values[at]) and not track.is_turn):
            return np.asarray(track.rows[is_value], dtype=np.intp)
    return None


def _is_one_number(value: Array) -> bool:
    return bool((value == value[0]).all())


def _is_lost(track: _Track, is_value: Mask, *, is_one_number: bool) -> bool:
    """Return True if the rows `is_value`, which are equal, are far from the other rows around them.

    A plausible position is a constant for "lost" only if the body is behind it where it was before: some
    trackers repeat a position until they see the body.
    """
    others = np.flatnonzero(~is_value)
    if len(others) < 3:
        return False
    begins = np.flatnonzero(is_value & ~np.roll(is_value, 1) & (np.arange(len(is_value)) > 0))
    ends = np.flatnonzero(~is_value & np.roll(is_value, 1) & (np.arange(len(is_value)) > 0))
    before, after = np.concatenate([begins - 1, ends - 1]), np.concatenate([begins, ends])
    steps = track.distances(others[:-1], others[1:]) / np.diff(track.times_s[others])
    usual = np.full(len(before), np.percentile(steps, 95) * 2.0 / _SPEED_RATIO)
    if not track.are_far(before, after, usual).all():
        return False
    if is_one_number or track.distances(before, after).min() > _IMPROBABLE:
        return True
    behind = np.searchsorted(ends, begins)
    first, last = begins[behind < len(ends)] - 1, ends[behind[behind < len(ends)]]
    away = np.minimum(track.distances(first, first + 1), track.distances(last - 1, last))
    is_back = len(last) > 0 and bool((track.distances(first, last) < 0.5 * away).all())
    is_rare = is_value.sum() < len(others) or (steps > 0.0).mean() > 0.5  # a body may stand still
    return bool(is_back and is_rare and (is_value.sum() > 2 or len(begins) > 1))
