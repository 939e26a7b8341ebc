"""Rows of the selection evaluation: one per bench, condition and method, with people's results."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from itertools import chain, pairwise
from typing import Any

import numpy as np


@dataclass(frozen=True, kw_only=True)
class TimeSpread:
    """Spread of times, s."""

    median: float
    p90: float

    @classmethod
    def of(cls, times_s: Iterable[float]) -> "TimeSpread | None":
        """Return the spread of `times_s`, or None without times."""
        values = np.array(list(times_s), dtype=np.float64)
        if not len(values):
            return None
        median = float(np.median(values))
        p90 = float(np.quantile(values, 0.9))
        return cls(median=median, p90=p90)


@dataclass(frozen=True, kw_only=True)
class SelectionMetrics:
    """Performance of a person, simulated or not, in a condition; unknown values are None."""

    n: int
    """Number of runs, if a run ends once all targets are selected, else of targets."""
    time_s: TimeSpread | None
    """Time of a run until all targets stay selected; if packages pass by, of each from its entry."""
    between_s: TimeSpread | None = None
    """Time from one correct selection to the next."""
    wrong_rate: float | None = None
    """Share of all toggles that leave their package in the wrong state."""
    missed_rate: float | None = None
    """Share of targets not selected at the end."""

    def as_json(self) -> dict[str, Any]:
        """Return it as it stands in a JSON file."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class SelectionTrialRow:
    """One line of the table."""

    bench: str
    condition: str
    method: str
    figures: SelectionMetrics
    """Metrics of the simulated person."""
    human: dict[str, SelectionMetrics]
    """Metrics of people in the same condition, by their pointing device; may be empty."""

    def as_json(self) -> dict[str, Any]:
        """Return it as it stands in a JSON file."""
        human = {device: metrics.as_json() for device, metrics in self.human.items()}
        return {
            "bench": self.bench,
            "condition": self.condition,
            "method": self.method,
            **self.figures.as_json(),
            "human": human,
        }


@dataclass(kw_only=True)
class Score:
    """Actions of a person in one trial; filled while it runs."""

    targets: int
    """Number of packages to select."""
    missed: int = 0
    """Targets not selected at the end or when they left."""
    toggles: int = 0
    wrong: int = 0
    """Toggles that left their package in the wrong state."""
    right_s: list[float] = field(default_factory=list[float])
    """Times of the correct toggles of targets, from the start."""
    took_s: list[float] = field(default_factory=list[float])
    """Times that count, see `SelectionMetrics`."""
    simulated_s: float = 0.0
    frames: int = 0
    """Frames drawn for the simulated eyes."""

    def toggled(self, at_s: float, *, selected: bool, is_target: bool) -> None:
        """Count a toggle of a package to `selected` or not."""
        self.toggles += 1
        self.wrong += selected is not is_target
        if selected and is_target:
            self.right_s.append(at_s)


def figures_of(scores: Sequence[Score], *, per_package: bool) -> SelectionMetrics:
    """Return the metrics over `scores`; `per_package`: n counts packages, not runs."""
    targets = sum(score.targets for score in scores)
    toggles = sum(score.toggles for score in scores)
    wrong_rate = None
    if toggles:
        wrong = sum(score.wrong for score in scores)
        wrong_rate = wrong / toggles
    missed_rate = None
    if targets:
        missed = sum(score.missed for score in scores)
        missed_rate = missed / targets
    times_s = chain.from_iterable(score.took_s for score in scores)
    intervals_s = _intervals_s(scores)
    return SelectionMetrics(
        n=targets if per_package else len(scores),
        time_s=TimeSpread.of(times_s),
        between_s=TimeSpread.of(intervals_s),
        wrong_rate=wrong_rate,
        missed_rate=missed_rate,
    )


def _intervals_s(scores: Sequence[Score]) -> Iterator[float]:
    """Yield the times from each correct selection of a trial to the next."""
    for score in scores:
        for before_s, after_s in pairwise(sorted(score.right_s)):
            yield after_s - before_s
