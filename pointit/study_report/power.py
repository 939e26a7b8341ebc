"""Number of participants that find a stated effect, by studies drawn from a pilot's participants."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from pointit.errors import ConfigError
from pointit.geometry.array_types import Array
from pointit.study_report.comparisons import paired_values, participant_medians
from pointit.study_report.reading import Trials
from pointit.study_report.table import LEVEL, Table

ALPHA = 0.05
GOALS = (0.8, 0.9)


@dataclass(frozen=True, kw_only=True)
class Spread:
    """The spread of a pilot's participants about the means of two levels of a factor."""

    first: Array
    """Values at the first level less their mean, scaled to the variance of the population."""
    second: Array
    is_within: bool
    """True if `first` and `second` are of the same participants, in the same order."""
    mean: float
    """Mean at the first level."""
    difference: float
    """Mean at the second level less that at the first, in the pilot."""

    @property
    def test(self) -> str:
        """The test that is meant."""
        return "paired t-test, two-sided" if self.is_within else "Welch's t-test, two-sided"


def spread(trials: Trials, factor: str, first: str, second: str, measure: str = "selection_s") -> Spread:
    """Return the spread of the participants' medians of `measure` in a pilot.

    A sample's deviations are too small by the square root of n / (n - 1), which is corrected.

    Raises: ConfigError: If there is no such factor, level or measure, or fewer than four participants (of
        each level, if it is a factor between participants).
    """
    levels = trials.levels(factor)
    for level in (first, second):
        if level not in levels:
            raise ConfigError(f"{trials.folder}: {factor} has no level {level!r}, but {', '.join(levels)}")

    by_level = participant_medians(trials, measure, factor)
    is_within = trials.is_within(factor)
    first_people = by_level.get((first,), {})
    second_people = by_level.get((second,), {})
    first_values, second_values = paired_values(first_people, second_people, is_within=is_within)
    count = min(len(first_values), len(second_values))
    if count < 4:
        raise ConfigError(
            f"{trials.folder}: {count} participants with {first} and {second}; a pilot needs 4, better 12"
        )

    mean = float(first_values.mean())
    return Spread(
        first=_centred(first_values),
        second=_centred(second_values),
        is_within=is_within,
        mean=mean,
        difference=float(second_values.mean()) - mean,
    )


def _centred(values: Array) -> Array:
    """Return values less their mean, scaled to the variance of the population."""
    count = len(values)
    unbiased = np.sqrt(count / (count - 1))
    return np.asarray((values - values.mean()) * unbiased)


def significant(people: Spread, effect: float, count: int, runs: int, random: np.random.Generator) -> int:
    """Return the number of `runs` simulated studies that find `effect` with p < 0.05.

    `count` is the number of participants, of each group if groups differ. They are drawn with replacement.
    """
    freedom: Any
    if people.is_within:
        # Paired t-test: differences of the same people.
        differences = people.second - people.first
        drawn = differences[random.integers(len(differences), size=(runs, count))]
        mean = drawn.mean(axis=1)
        variance = drawn.var(axis=1, ddof=1) / count
        freedom = count - 1
    else:
        # Welch's t-test, with its degrees of freedom.
        shape = (runs, count)
        first = people.first[random.integers(len(people.first), size=shape)]
        second = people.second[random.integers(len(people.second), size=shape)]
        mean = second.mean(axis=1) - first.mean(axis=1)
        first_variance = first.var(axis=1, ddof=1)
        second_variance = second.var(axis=1, ddof=1)
        variances = np.array([first_variance, second_variance]) / count
        variance = variances.sum(axis=0)
        square_sum = np.maximum((variances**2).sum(axis=0), 1e-300)
        freedom = (count - 1) * variance**2 / square_sum

    # Without a spread, as if a small study draws one participant only, nothing is found.
    has_spread = variance > 0
    distance = np.abs(mean + effect)
    deviation = np.sqrt(variance)
    score = np.divide(distance, deviation, out=np.zeros(runs), where=has_spread)
    p = 2 * stats.t.sf(score, np.maximum(freedom, 1))
    return int(np.sum(p < ALPHA))


def power(
    people: Spread,
    effect: float,
    counts: Iterable[int],
    *,
    runs: int = 2000,
    seed: int = 0,
    tell: Callable[[int], object] = lambda _: None,
) -> Table:
    """Return the share of studies that find `effect`, for each number of participants, with its interval.

    Intervals are those of Clopper and Pearson (1934) for the number of runs. It ends two sizes after the
    share is certainly above the highest of `GOALS`. `tell` is called with each number of participants.
    """
    table = Table()
    above = 0
    for count in counts:
        tell(count)
        # Each size has random numbers of its own: its result does not depend on the sizes before.
        random = np.random.default_rng((seed, count))
        significant_runs = significant(people, effect, count, runs, random)
        limits = stats.binomtest(significant_runs, runs).proportion_ci(LEVEL)
        row = {"participants": count, "power": significant_runs / runs}
        table.append({**row, "low": float(limits.low), "high": float(limits.high)})
        above += int(limits.low >= GOALS[-1])
        if above > 2:
            break
    return table


def needed(table: Table, goal: float) -> tuple[int | None, int | None, int | None]:
    """Return the minimum number of participants for a power of `goal`, and its interval.

    The interval is from the first number whose power may be `goal` to the first whose power certainly is.
    None if no number in `table` suffices.
    """

    def first_reaching(column: str) -> int | None:
        for row in table:
            if row[column] >= goal:
                return int(row["participants"])
        return None

    return first_reaching("power"), first_reaching("high"), first_reaching("low")
