"""Memory of one person's pointing: cursors of the last seconds, and stays of the arm."""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pointit.schemas import NS_PER_S, Cursor

Floats: TypeAlias = NDArray[np.float64]

MEMORY_S = 10.0
"""Time for which cursors are kept, s. They are never written to a file or published."""
MAX_CURSORS = 4096
"""Limit of cursors that are kept, whatever their rate."""
SPEED_S = 0.06
"""Time on both sides over which the speed is measured, s."""
GAP_S = 0.3
"""Time without rays that ends a stay, s."""
CORRECTED_S = 0.4
"""Longest stay before a correction, and longest time until the next stay, s."""
CORRECTED_RAD = math.radians(8.0)
"""Largest correction."""
CORRECTED = 0.2
"""Weight of a stay that was corrected."""
APART_RAD = math.radians(4.0)
"""Angle between two stays in succession below which they are one."""


class PointingMemory:
    """Cursors with a ray, in the order of their stamps, none older than `MEMORY_S`."""

    def __init__(self) -> None:
        self._cursors: deque[Cursor] = deque(maxlen=MAX_CURSORS)

    def add(self, cursor: Cursor) -> None:
        """Keep `cursor`. One that is older than the last is ignored, unless the clock was set back."""
        cursors = self._cursors
        if cursors and cursor.stamp_ns < cursors[-1].stamp_ns:
            if cursors[-1].stamp_ns - cursor.stamp_ns < NS_PER_S:
                return
            cursors.clear()
        if cursor.origin_m is not None and cursor.direction is not None:
            cursors.append(cursor)
        self.forget(cursor.stamp_ns)

    def forget(self, now_ns: int) -> None:
        """Remove what is too old at `now_ns`."""
        while self._cursors and self._cursors[0].stamp_ns < now_ns - round(MEMORY_S * NS_PER_S):
            self._cursors.popleft()

    def between(self, first_ns: int, last_ns: int) -> list[Cursor]:
        """Return the cursors from `first_ns` to `last_ns`."""
        cursors = list(self._cursors)
        first = bisect_left(cursors, first_ns, key=lambda cursor: cursor.stamp_ns)
        last = bisect_left(cursors, last_ns + 1, key=lambda cursor: cursor.stamp_ns)
        return cursors[first:last]


@dataclass(frozen=True, kw_only=True)
class TimingModel:
    """Times of gestures about words; fitted on other simulated people than `pointit evaluate` reports."""

    lag_s: float = -0.15
    """Mean time from the middle of the word to the begin of the stay; negative: the arm is earlier."""
    lag_sigma_s: float = 0.45
    """Standard deviation of that, of people (0.3), recognisers (0.2) and where a stay begins."""
    slow_radps: float = math.radians(10.0)
    """Angular speed below which the arm stays."""
    shortest_s: float = 0.06
    """Shortest stay."""
    held: float = 0.1
    """Weight of staying during the word, beside 1 for arriving at its usual time."""
    missed: float = 0.005
    """Weight of a gesture that was not seen."""
    shared: float = 0.02
    """Weight of one stay for two words, beside two stays in their order."""


class Stay(NamedTuple):
    """A run of rays during which the arm hardly moved."""

    first: int
    last: int
    """Index of its first and last ray."""
    begin_s: float
    """Time of its beginning, or minus infinity if it began before the first ray."""
    end_s: float
    way_rad: float
    """Angle from the stay before, infinite if unknown: people's errors grow with the way."""
    weight: float = 1.0
    """Less than 1 if the arm left soon for a place nearby: people correct what they see."""


def stays_of(times_s: Floats, directions: Floats, model: TimingModel) -> list[Stay]:
    """Return the stays, in order; of rays that only move the slowest moment, if any."""
    speeds = _speeds(times_s, directions)
    is_slow = speeds <= model.slow_radps
    cuts = np.flatnonzero((np.diff(is_slow.astype(int)) != 0) | (np.diff(times_s) > GAP_S)) + 1
    runs = [(a, b - 1) for a, b in pairwise([0, *cuts.tolist(), len(times_s)]) if is_slow[a]]
    runs = [run for run in _merged(runs, times_s, directions) if _lasts(run, times_s, model.shortest_s)]
    if not runs:
        slowest = int(np.argmin(speeds))
        runs = [(slowest, slowest)]
    stays: list[Stay] = []
    before: Floats | None = None
    for first, last in runs:
        direction = directions[first : last + 1].mean(axis=0)
        way = math.inf if before is None else _angle(before, direction)
        begin_s = -math.inf if first == 0 else float(times_s[first])
        if stays and way <= CORRECTED_RAD and _is_short(stays[-1], begin_s):
            stays[-1] = stays[-1]._replace(weight=CORRECTED)
        stays.append(Stay(first, last, begin_s, float(times_s[last]), way))
        before = direction
    return stays


def chances(stays: Sequence[Stay], words_s: Sequence[float], which: int, model: TimingModel) -> list[float]:
    """Return the probability of each stay to belong to word `which` of `words_s`, which are in order.

    What is missing to 1 is the probability that no stay does.
    """
    fits = [[_fit(stay, at_s, model) for stay in stays] for at_s in words_s]
    before = _messages(fits[:which], len(stays), model)
    after = _messages([row[::-1] for row in fits[:which:-1]], len(stays), model)[::-1]
    weights = [fit * b * a for fit, b, a in zip(fits[which], before, after, strict=True)]
    total = math.fsum(weights)
    seen = math.fsum(fits[which])
    if total <= 0.0:
        return [0.0] * len(stays)
    return [seen / (seen + model.missed) * weight / total for weight in weights]


def _messages(rows: Sequence[Sequence[float]], count: int, model: TimingModel) -> list[float]:
    """Return the fit of the words before, for each stay that the next word may have."""
    weights_before = [1.0] * count
    for row in rows:
        mine = [fit * each for fit, each in zip(row, weights_before, strict=True)]
        weights_before = [
            model.missed + model.shared * mine[index] + math.fsum(mine[:index]) for index in range(count)
        ]
    return weights_before


def _fit(stay: Stay, at_s: float, model: TimingModel) -> float:
    """Return the fit of a stay and a word at `at_s` by their times alone, about 0 to 1."""
    z = (stay.begin_s - at_s - model.lag_s) / model.lag_sigma_s
    arrives = math.exp(-0.5 * z * z)
    low_s = at_s + model.lag_s - model.lag_sigma_s
    high_s = at_s + model.lag_s + model.lag_sigma_s
    overlap_s = min(stay.end_s, high_s) - max(stay.begin_s, low_s)
    return stay.weight * (arrives + model.held * max(overlap_s, 0.0) / (high_s - low_s))


def _speeds(times_s: Floats, directions: Floats) -> Floats:
    """Return the angular speed at each ray, rad/s."""
    first = np.searchsorted(times_s, times_s - SPEED_S)
    last = np.searchsorted(times_s, times_s + SPEED_S, side="right") - 1
    chords = np.linalg.norm(directions[last] - directions[first], axis=1)
    angles = 2.0 * np.arcsin(np.clip(chords / 2.0, 0.0, 1.0))
    speeds: Floats = angles / np.maximum(times_s[last] - times_s[first], 0.02)
    return speeds


def _merged(runs: Sequence[tuple[int, int]], times_s: Floats, directions: Floats) -> list[tuple[int, int]]:
    merged: list[tuple[int, int]] = []
    for first, last in runs:
        if merged and times_s[first] - times_s[merged[-1][1]] <= GAP_S:
            start, end = merged[-1]
            apart = _angle(
                directions[start : end + 1].mean(axis=0), directions[first : last + 1].mean(axis=0)
            )
            if apart <= APART_RAD:
                merged[-1] = (start, last)
                continue
        merged.append((first, last))
    return merged


def _is_short(stay: Stay, next_s: float) -> bool:
    return max(stay.end_s - stay.begin_s, next_s - stay.end_s) <= CORRECTED_S


def _lasts(run: tuple[int, int], times_s: Floats, shortest_s: float) -> bool:
    return bool(times_s[run[1]] - times_s[run[0]] >= shortest_s)


def _angle(a: Floats, b: Floats) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))
