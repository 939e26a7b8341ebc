"""Rows of the selection evaluation: one per bench, condition and method, with people's results."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
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
        return cls(median=float(np.median(values)), p90=float(np.quantile(values, 0.9)))


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
        figures = self.figures.as_json()
        return {
            "bench": self.bench,
            "condition": self.condition,
            "method": self.method,
            **figures,
            "human": {name: human.as_json() for name, human in self.human.items()},
        }
