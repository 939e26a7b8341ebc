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
        oldest_ns = now_ns - round(MEMORY_S * NS_PER_S)
        while self._cursors and self._cursors[0].stamp_ns < oldest_ns:
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
    """Mean time from the middle of the word to the start of the stay. Negative if the arm is earlier."""
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
    """Time of its start, or minus infinity if it began before the first ray."""
    end_s: float
    way_rad: float
    """Angle from the previous stay, infinite if unknown: people's errors grow with the way."""
    weight: float = 1.0
    """Less than 1 if the arm left soon for a place nearby: people correct what they see."""

    def mean(self, vectors: Floats) -> Floats:
        """Return the mean of `vectors` (n x 3), one for each ray, over the rays of the stay."""
        return _mean_of_run(vectors, self.first, self.last)


def stays_of(times_s: Floats, directions: Floats, model: TimingModel) -> list[Stay]:
    """Return the stays, in order. If the arm moves all the time, that is its slowest moment."""
    # Runs of slow rays, cut where the speed changes and at gaps
    speeds = _speeds(times_s, directions)
    is_slow = speeds <= model.slow_radps
    has_changed = np.diff(is_slow.astype(int)) != 0
    has_gap = np.diff(times_s) > GAP_S
    cuts = np.flatnonzero(has_changed | has_gap) + 1
    slow_runs: list[tuple[int, int]] = []
    for first, end in pairwise([0, *cuts.tolist(), len(times_s)]):
        if is_slow[first]:
            slow_runs.append((first, end - 1))

    # Those that last, after those with about the same direction have become one
    merged_runs = _merged(slow_runs, times_s, directions)
    runs = [run for run in merged_runs if _lasts(run, times_s, model.shortest_s)]
    if not runs:
        slowest = int(np.argmin(speeds))
        runs = [(slowest, slowest)]

    # Stays. A short one that is followed by a near one was corrected
    stays: list[Stay] = []
    previous: Floats | None = None
    for first, last in runs:
        direction = _mean_of_run(directions, first, last)
        way = math.inf if previous is None else _angle(previous, direction)
        begin_s = -math.inf if first == 0 else float(times_s[first])
        end_s = float(times_s[last])
        if stays and way <= CORRECTED_RAD and _is_short(stays[-1], begin_s):
            stays[-1] = stays[-1]._replace(weight=CORRECTED)
        stays.append(Stay(first, last, begin_s, end_s, way))
        previous = direction
    return stays


def chances(stays: Sequence[Stay], words_s: Sequence[float], which: int, model: TimingModel) -> list[float]:
    """Return the probability of each stay to belong to word `which` of `words_s`, which are in order.

    What is missing to 1 is the probability that no stay does.
    """
    # Fit of the word itself, and of all words before and after it in their order (forward and backward)
    fits: list[list[float]] = []
    for at_s in words_s:
        fits.append([_fit(stay, at_s, model) for stay in stays])
    own_fits = fits[which]
    later_fits = [row[::-1] for row in fits[:which:-1]]
    forward = _messages(fits[:which], len(stays), model)
    backward = _messages(later_fits, len(stays), model)
    backward.reverse()
    weights: list[float] = []
    for fit, before, after in zip(own_fits, forward, backward, strict=True):
        weights.append(fit * before * after)

    # Normalize
    total = math.fsum(weights)
    seen = math.fsum(own_fits)
    if total <= 0.0:
        return [0.0] * len(stays)
    share_seen = seen / (seen + model.missed)
    return [share_seen * weight / total for weight in weights]


def _messages(rows: Sequence[Sequence[float]], count: int, model: TimingModel) -> list[float]:
    """Return the fit of the words before, for each stay that the next word may have."""
    weights_before = [1.0] * count
    for row in rows:
        own = [fit * weight for fit, weight in zip(row, weights_before, strict=True)]
        weights_before = []
        for index in range(count):
            earlier = math.fsum(own[:index])
            weights_before.append(model.missed + model.shared * own[index] + earlier)
    return weights_before


def _fit(stay: Stay, at_s: float, model: TimingModel) -> float:
    """Return the fit of a stay and a word at `at_s` by their times alone, about 0 to 1."""
    z = (stay.begin_s - at_s - model.lag_s) / model.lag_sigma_s
    arrives = math.exp(-0.5 * z * z)
    low_s = at_s + model.lag_s - model.lag_sigma_s
    high_s = at_s + model.lag_s + model.lag_sigma_s
    overlap_s = min(stay.end_s, high_s) - max(stay.begin_s, low_s)
    held = model.held * max(overlap_s, 0.0) / (high_s - low_s)
    return stay.weight * (arrives + held)


def _speeds(times_s: Floats, directions: Floats) -> Floats:
    """Return the angular speed at each ray, rad/s."""
    first = np.searchsorted(times_s, times_s - SPEED_S)
    last = np.searchsorted(times_s, times_s + SPEED_S, side="right") - 1
    steps = directions[last] - directions[first]
    half_chords = np.linalg.norm(steps, axis=1) / 2.0
    angles = 2.0 * np.arcsin(np.clip(half_chords, 0.0, 1.0))
    elapsed_s = times_s[last] - times_s[first]
    speeds: Floats = angles / np.maximum(elapsed_s, 0.02)
    return speeds


def _merged(runs: Sequence[tuple[int, int]], times_s: Floats, directions: Floats) -> list[tuple[int, int]]:
    """Merge each run into the previous one that is near in time and direction."""
    merged: list[tuple[int, int]] = []
    for first, last in runs:
        if merged:
            start, end = merged[-1]
            if times_s[first] - times_s[end] <= GAP_S:
                previous = _mean_of_run(directions, start, end)
                current = _mean_of_run(directions, first, last)
                if _angle(previous, current) <= APART_RAD:
                    merged[-1] = (start, last)
                    continue
        merged.append((first, last))
    return merged


def _mean_of_run(vectors: Floats, first: int, last: int) -> Floats:
    """Return the mean of the rows from `first` to `last`."""
    mean: Floats = vectors[first : last + 1].mean(axis=0)
    return mean


def _is_short(stay: Stay, next_s: float) -> bool:
    """Return True if a stay was short, and the next one began soon."""
    duration_s = stay.end_s - stay.begin_s
    gap_s = next_s - stay.end_s
    return max(duration_s, gap_s) <= CORRECTED_S


def _lasts(run: tuple[int, int], times_s: Floats, shortest_s: float) -> bool:
    """Return True if a run of rays is long enough for a stay."""
    first, last = run
    return bool(times_s[last] - times_s[first] >= shortest_s)


def _angle(a: Floats, b: Floats) -> float:
    """Return the angle between two directions, rad."""
    sine = np.linalg.norm(np.cross(a, b))
    return float(np.arctan2(sine, np.dot(a, b)))
