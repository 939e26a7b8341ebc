"""Pointings at known places: samples of holds, their means in blocks, and the latency of the targets."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array

GAP_S = 0.5
"""Longer pauses between two samples do not count as pointing."""

BLOCK_S = 0.15
"""Half of the correlation time of the tremor in a hold (pointing.md §7): one measurement each."""

MAX_BLOCKS = 64
"""Largest number of blocks: longer pointing makes longer blocks, since more add no information."""

JUMP_M = 0.3
"""Distance between two samples of a target beyond which they belong to two targets."""

STILL_M = 0.05
"""Largest movement of a target at rest."""

SHORTEST_S = 1e-3
"""Shortest time between two blocks for a velocity."""

LEAP_RAD = math.radians(20.0)
"""Largest turn of a ray between samples of one block."""


@dataclass(frozen=True)
class Pointings:
    """Rays and what they were pointed at, one row a sample, in order of time."""

    stamps_s: Array
    """n."""
    origins_m: Array
    """n x 3, {H}."""
    directions: Array
    """n x 3, unit, {H}."""
    targets_m: Array
    """n x 3, {W}."""

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.stamps_s)

    @property
    def span_s(self) -> float:
        """Return the time spent pointing without pauses."""
        steps = np.diff(self.stamps_s)
        return float(np.sum(steps[(steps > 0.0) & (steps <= GAP_S)]))

    def only(self, kept: NDArray[np.bool_]) -> "Pointings":
        """Return the samples selected by `kept` (n)."""
        return Pointings(
            self.stamps_s[kept], self.origins_m[kept], self.directions[kept], self.targets_m[kept]
        )


@dataclass(frozen=True)
class Blocks:
    """Means of samples, one row a block, and properties of the samples."""

    pointings: Pointings
    """m rows; directions have norm 1."""
    samples: Array
    """m: number of samples in each block."""
    hold: Array
    """m: index of the block's hold, a stretch without a pause at one target. At rest, all at a target are
    one: a lamp that is mistaken for another, or wrong in the map, is so at each visit."""
    held_s: Array
    """Duration of each stretch."""
    velocities_mps: Array
    """m x 3: of the targets, {W}."""
    is_still: bool
    """True if no target moved while it was pointed at."""


def blocks(pointings: Pointings) -> Blocks:
    """Return `pointings` in blocks; needs at least one sample and stamps that never fall."""
    # Holds: stretches without a pause at one target
    stamps_s = pointings.stamps_s
    targets = pointings.targets_m
    begins = _begins(pointings)
    hold = np.cumsum(begins) - 1
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(stamps_s)) - 1
    held_s = stamps_s[last] - stamps_s[first]

    # A block ends with its hold, after its time, or where the ray leaps
    block_s = max(BLOCK_S, float(held_s.sum()) / MAX_BLOCKS)
    since_first_s = stamps_s - stamps_s[first][hold]
    block_number = np.floor(since_first_s / block_s)
    is_next_block = block_number[1:] > block_number[:-1]
    previous = pointings.directions[:-1]
    turn_cosines = np.einsum("ij,ij->i", pointings.directions[1:], previous)
    begins[1:] |= is_next_block | (turn_cosines < math.cos(LEAP_RAD))
    block_starts = np.flatnonzero(begins)
    bounds = np.append(block_starts, len(stamps_s))
    samples = np.diff(bounds).astype(np.float64)

    def mean(values: Array) -> Array:
        sums = np.add.reduceat(values, block_starts, axis=0)
        return np.asarray(sums / samples[:, None], dtype=np.float64)

    directions = mean(pointings.directions)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    means_m = mean(targets)
    means = Pointings(stamps_s[block_starts], mean(pointings.origins_m), directions, means_m)
    mean_stamps_s = mean(stamps_s[:, None])
    velocities_mps = _velocities(mean_stamps_s, means_m, hold[block_starts])

    # At rest, all holds at a target are one
    moved_m = np.abs(targets - targets[first][hold])
    is_still = bool(moved_m.max() <= STILL_M)
    if is_still:
        hold = _lamp_numbers(targets[first])[hold]
    block_hold = hold[block_starts].astype(np.float64)
    return Blocks(means, samples, block_hold, held_s, velocities_mps, is_still=is_still)


def lamp_numbers(pointings: Pointings) -> NDArray[np.intp]:
    """Return the number (n) of the target of each sample, from 0, in the order of the first holds there."""
    begins = _begins(pointings)
    hold = np.cumsum(begins) - 1
    return _lamp_numbers(pointings.targets_m[begins]).take(hold)


def _lamp_numbers(targets_m: Array) -> NDArray[np.intp]:
    """Return the number of the target of each hold, of targets `targets_m` (holds x 3)."""
    number_of_place: dict[tuple[float, ...], int] = {}
    numbers: list[int] = []
    for place in np.round(targets_m / STILL_M).tolist():
        number = number_of_place.setdefault(tuple(place), len(number_of_place))
        numbers.append(number)
    return np.array(numbers, dtype=np.intp)


def _begins(pointings: Pointings) -> NDArray[np.bool_]:
    """Return True (n) for the first sample of each hold."""
    begins = np.ones(len(pointings), dtype=np.bool_)
    steps_m = np.abs(np.diff(pointings.targets_m, axis=0))
    jumps = (steps_m > JUMP_M).any(axis=1)
    begins[1:] = (np.diff(pointings.stamps_s) > GAP_S) | jumps
    return begins


def in_time(pointings: Pointings, latency_s: float, means: Blocks | None = None) -> Pointings:
    """Return `pointings` (of these `means`) with targets where they were when reported `latency_s` late."""
    if latency_s == 0.0 or not len(pointings):
        return pointings
    means = means or blocks(pointings)
    counts = means.samples.astype(np.intp)
    moves_m = latency_s * np.repeat(means.velocities_mps, counts, axis=0)
    return replace(pointings, targets_m=pointings.targets_m + moves_m)


def _velocities(times_s: Array, places_m: Array, hold: NDArray[np.intp]) -> Array:
    """Return central differences of `places_m` (m x 3), one-sided at the ends of a hold."""
    index = np.arange(len(hold))
    after = np.minimum(index + 1, index[-1])
    after = np.where(hold[after] == hold, after, index)
    before = np.maximum(index - 1, 0)
    before = np.where(hold[before] == hold, before, index)
    steps_s = np.maximum(times_s[after] - times_s[before], SHORTEST_S)
    steps_m = places_m[after] - places_m[before]
    return np.asarray(steps_m / steps_s, dtype=np.float64)
