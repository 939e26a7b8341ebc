"""Paired differences between selection methods, with confidence intervals, and the resulting claims."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array
from pointit_lab.evaluation.selection.condition import Condition
from pointit_lab.evaluation.selection.row import Score

Groups = Mapping[tuple[Condition, str], Sequence[Score]]
"""Scores by condition and method, of the same trials in the same order."""

FEWEST = 20
"""Trials, each with its own seed, below which no difference is reported."""
SIGNIFICANCE = 0.05
"""Probability that any of a run's intervals misses the true difference."""
TAIL = 20
"""Minimum number of resamples beyond each end of an interval."""
CHUNK = 2000
"""Resamples drawn at once."""


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A difference and its confidence interval."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Return True if the difference is significant."""
        return self.low > 0.0 or self.high < 0.0


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Difference of `method` minus `other` in the same trials."""

    bench: str
    condition: str
    method: str
    other: str
    trials: int
    errors: Interval
    """Wrong toggles and missed packages, as a share of the packages that should be selected."""
    time_s: Interval | None
    """Mean time, see `SelectionMetrics`, or None if too few trials have one."""

    @property
    def claims(self) -> list[str]:
        """Return the significant differences in words."""
        sentences: list[str] = []
        claims = ((self.errors, "errs less", "errs more"), (self.time_s, "is faster", "is slower"))
        for interval, less, more in claims:
            if interval is not None and interval.excludes_zero:
                claim = less if interval.value < 0.0 else more
                sentences.append(f"{self.method} {claim}")
        return sentences

    def as_json(self) -> dict[str, Any]:
        """Return the difference for a JSON file."""
        return {**asdict(self), "claims": self.claims}


def differences_of(groups: Groups) -> list[Difference]:
    """Return the differences between every two methods in each condition.

    Bootstrap percentile intervals over trials (Efron & Tibshirani 1993, ch. 13), with the same trials for
    both methods. All intervals of a run hold together with probability 1 - `SIGNIFICANCE` (Bonferroni).
    Conditions with fewer than `FEWEST` trials are left out.
    """
    by_condition = defaultdict[Condition, dict[str, Sequence[Score]]](dict)
    for (condition, method), scores in groups.items():
        if len(scores) >= FEWEST:
            by_condition[condition][method] = scores
    pairs: list[tuple[Condition, tuple[str, str]]] = []
    for condition, scores_by_method in by_condition.items():
        for pair in combinations(scores_by_method, 2):
            pairs.append((condition, pair))

    # two intervals a pair, each with two tails
    intervals = max(1, 2 * len(pairs))
    tail = SIGNIFICANCE / (2.0 * intervals)
    differences: list[Difference] = []
    for condition, (other, method) in pairs:
        scores_by_method = by_condition[condition]
        mine = _sums(scores_by_method[method])
        others = _sums(scores_by_method[other])
        errors, time_s = _intervals(mine, others, tail)
        difference = Difference(
            bench=condition.bench,
            condition=condition.name,
            method=method,
            other=other,
            trials=len(mine),
            errors=errors,
            time_s=time_s,
        )
        differences.append(difference)
    return differences


def _sums(scores: Sequence[Score]) -> Array:
    """Return n x 4: errors, targets, times, number of times of each trial."""
    sums: list[tuple[float, ...]] = []
    for score in scores:
        errors = score.wrong + score.missed
        total_s = sum(score.took_s)
        sums.append((errors, score.targets, total_s, len(score.took_s)))
    return np.array(sums, dtype=np.float64)


def _intervals(mine: Array, others: Array, tail: float) -> tuple[Interval, Interval | None]:
    """Return the intervals of `_differences`. That of the times is None if a resample has no time."""
    drawn = _resampled(mine, others, tail)
    # the values are those of each trial once
    once = np.ones((1, len(mine)))
    values = _differences(once, mine, others)[0]
    intervals: list[Interval] = []
    for value, resampled in zip(values.tolist(), drawn.T, strict=True):
        low = float(np.quantile(resampled, tail))
        high = float(np.quantile(resampled, 1.0 - tail))
        intervals.append(Interval(value=value, low=low, high=high))
    errors, time_s = intervals
    has_times = bool(np.isfinite(drawn).all())
    return errors, time_s if has_times else None


def _resampled(mine: Array, others: Array, tail: float) -> Array:
    """Return the differences of k resamples, k x 2, with enough draws beyond each tail."""
    count = len(mine)
    rng = np.random.default_rng(count)
    draws = TAIL / tail
    shares = np.full(count, 1.0 / count)
    # in chunks, which bounds the memory
    chunks = max(2, int(np.ceil(draws / CHUNK)))
    drawn_chunks: list[Array] = []
    for _ in range(chunks):
        weights = rng.multinomial(count, shares, CHUNK)
        drawn_chunks.append(_differences(weights, mine, others))
    return np.concatenate(drawn_chunks)


def _differences(weights: NDArray[np.integer] | Array, mine: Array, others: Array) -> Array:
    """Return k x 2, of k resamples: differences of the share of errors and of the mean time."""
    own_sums = weights @ mine
    other_sums = weights @ others
    # a resample may have no time at all
    with np.errstate(divide="ignore", invalid="ignore"):
        return _rates(own_sums) - _rates(other_sums)


def _rates(sums: Array) -> Array:
    """Return k x 2: errors for each target, and the mean time, of k rows of `_sums`."""
    errors, targets, total_s, times = sums.T
    return np.stack([errors / targets, total_s / times], axis=1)
