"""Number of participants that find a stated effect, by studies drawn from a pilot's participants."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from pointit.errors import ConfigError
from pointit.geometry.array_types import Array
from pointit.study_report.comparisons import participant_medians
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
    found = participant_medians(trials, measure, factor)
    one = found.get((first,), {})
    other = found.get((second,), {})
    is_within = trials.is_within(factor)
    if is_within:
        both = sorted(one.keys() & other.keys())
        one, other = ({name: each[name] for name in both} for each in (one, other))
    if (count := min(len(one), len(other))) < 4:
        raise ConfigError(
            f"{trials.folder}: {count} participants with {first} and {second}; a pilot needs 4, better 12"
        )
    values = [np.array([*each.values()]) for each in (one, other)]
    mean = float(values[0].mean())
    centred = [(each - each.mean()) * np.sqrt(len(each) / (len(each) - 1)) for each in values]
    return Spread(
        first=centred[0],
        second=centred[1],
        is_within=is_within,
        mean=mean,
        difference=float(values[1].mean()) - mean,
    )


def significant(people: Spread, effect: float, count: int, runs: int, random: np.random.Generator) -> int:
    """Return the number of `runs` simulated studies that find `effect` with p < 0.05.

    `count` is the number of participants, of each group if groups differ. They are drawn with replacement.
    """
    if people.is_within:
        drawn = (people.second - people.first)[random.integers(len(people.first), size=(runs, count))]
        mean = drawn.mean(axis=1)
        variance = drawn.var(axis=1, ddof=1) / count
        freedom: Any = count - 1
    else:
        groups = [
            each[random.integers(len(each), size=(runs, count))] for each in (people.first, people.second)
        ]
        mean = groups[1].mean(axis=1) - groups[0].mean(axis=1)
        parts = np.array([each.var(axis=1, ddof=1) / count for each in groups])
        variance = parts.sum(axis=0)
        freedom = (count - 1) * variance**2 / np.maximum((parts**2).sum(axis=0), 1e-300)
    spread_there = variance > 0  # none if a small study draws one participant only
    score = np.divide(np.abs(mean + effect), np.sqrt(variance), out=np.zeros(runs), where=spread_there)
    return int(np.sum(2 * stats.t.sf(score, np.maximum(freedom, 1)) < ALPHA))


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
        found = significant(people, effect, count, runs, np.random.default_rng((seed, count)))
        limits = stats.binomtest(found, runs).proportion_ci(LEVEL)
        row = {"participants": count, "power": found / runs}
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
        return next((row["participants"] for row in table if row[column] >= goal), None)

    return first_reaching("power"), first_reaching("high"), first_reaching("low")
