"""What the evaluation of selecting tells: one row per bench, condition and method, people beside it."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, kw_only=True)
class TimeSpread:
    """How long it took, s."""

    median: float
    p90: float

    @classmethod
    def of(cls, times_s: Iterable[float]) -> "TimeSpread | None":
        """Return the spread of `times_s`, or none of none."""
        values = np.array(list(times_s), dtype=np.float64)
        if not len(values):
            return None
        return cls(median=float(np.median(values)), p90=float(np.quantile(values, 0.9)))


@dataclass(frozen=True, kw_only=True)
class SelectionMetrics:
    """What somebody, simulated or not, was worth in a condition; what is not known is none."""

    n: int
    """Runs where they end once all is selected, else packages that should be selected."""
    time_s: TimeSpread | None
    """Of a run until all is selected to stay so; where packages pass by, of each from its entry on."""
    between_s: TimeSpread | None = None
    """From one right selection to the next."""
    wrong_rate: float | None = None
    """Of all toggles, those that leave their package as it should not be."""
    missed_rate: float | None = None
    """Of what should be selected, what was not at the end."""

    def as_json(self) -> dict[str, Any]:
        """Return it as it stands in a JSON file."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class SelectionRow:
    """One line of the table."""

    bench: str
    condition: str
    method: str
    figures: SelectionMetrics
    """Of the simulated person."""
    human: dict[str, SelectionMetrics]
    """Of people in the same condition, by what they did it with; empty: there are none."""

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
