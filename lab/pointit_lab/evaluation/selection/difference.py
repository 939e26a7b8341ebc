"""Paired differences between selection methods, with confidence intervals, and the resulting claims."""

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
        for interval, less, more in (
            (self.errors, "errs less", "errs more"),
            (self.time_s, "is faster", "is slower"),
        ):
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
    by_condition: dict[Condition, dict[str, Sequence[Score]]] = {}
    for (condition, method), scores in groups.items():
        if len(scores) >= FEWEST:
            scores_by_method = by_condition.setdefault(condition, {})
            scores_by_method[method] = scores
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
        differences.append(
            Difference(
                bench=condition.bench,
                condition=condition.name,
                method=method,
                other=other,
                trials=len(mine),
                errors=errors,
                time_s=time_s,
            )
        )
    return differences


def _sums(scores: Sequence[Score]) -> Array:
    """Return n x 4: errors, targets, times, number of times of each trial."""
    sums: list[tuple[float, ...]] = []
    for score in scores:
        errors = score.wrong + score.missed
        sums.append((errors, score.targets, sum(score.took_s), len(score.took_s)))
    return np.array(sums, dtype=np.float64)


def _intervals(mine: Array, others: Array, tail: float) -> tuple[Interval, Interval | None]:
    # a resample in chunks, which bounds the memory, with enough draws beyond each tail
    count = len(mine)
    rng = np.random.default_rng(count)
    chunks = max(2, int(np.ceil(TAIL / tail / CHUNK)))
    shares = np.full(count, 1.0 / count)
    drawn_chunks: list[Array] = []
    for _ in range(chunks):
        weights = rng.multinomial(count, shares, CHUNK)
        drawn_chunks.append(_differences(weights, mine, others))
    drawn = np.concatenate(drawn_chunks)

    values = _differences(np.ones((1, count)), mine, others)[0].tolist()
    intervals: list[Interval] = []
    for value, resampled in zip(values, drawn.T, strict=True):
        low = float(np.quantile(resampled, tail))
        high = float(np.quantile(resampled, 1.0 - tail))
        intervals.append(Interval(value=value, low=low, high=high))
    has_times = bool(np.isfinite(drawn).all())
    return intervals[0], intervals[1] if has_times else None


def _differences(weights: NDArray[np.integer] | Array, mine: Array, others: Array) -> Array:
    """Return k x 2, of k resamples: differences of the share of errors and of the mean time."""
    a = weights @ mine
    b = weights @ others
    # a resample may have no time at all
    with np.errstate(divide="ignore", invalid="ignore"):
        own_errors = a[:, 0] / a[:, 1]
        own_times_s = a[:, 2] / a[:, 3]
        other_errors = b[:, 0] / b[:, 1]
        other_times_s = b[:, 2] / b[:, 3]
        return np.stack([own_errors - other_errors, own_times_s - other_times_s], axis=1)
