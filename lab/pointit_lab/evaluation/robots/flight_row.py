"""Rows of the evaluation of robots: flights of simulated and of recorded people, by condition."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from pointit_lab.evaluation.datasets import hri_landing
from pointit_lab.evaluation.robots.flight import FlightScore
from pointit_lab.evaluation.robots.flight_setup import Bench, FlightCondition
from pointit_lab.evaluation.selection.difference import SIGNIFICANCE

SIMULATED = "simulated"


@dataclass(frozen=True, kw_only=True)
class FlightQuantiles:
    """Median with its confidence interval, and 90th percentile."""

    median: float
    low: float
    high: float
    p90: float

    @classmethod
    def of(cls, values: Sequence[float | None]) -> "FlightQuantiles | None":
        """Return those of the `values` that are known, or None if there are none.

        The interval is between order statistics and assumes no distribution (binomial, at least 95 %).
        """
        known = np.sort(np.array([value for value in values if value is not None], dtype=np.float64))
        count = len(known)
        if not count:
            return None
        rank = max(int(stats.binom.ppf(SIGNIFICANCE / 2.0, count, 0.5)) - 1, 0)
        return cls(
            median=float(np.median(known)),
            low=float(known[rank]),
            high=float(known[count - 1 - rank]),
            p90=float(np.quantile(known, 0.9)),
        )


@dataclass(frozen=True, kw_only=True)
class FlightRow:
    """One line of the table."""

    bench: Bench
    condition: str
    who: str
    """`simulated`, or the recorded people's device."""
    n: int
    """Number of flights."""
    people: int
    failed: int
    """Flights that had not ended after the time limit."""
    error_m: FlightQuantiles | None
    """Distance from the spot at the end."""
    ordered_error_m: FlightQuantiles | None
    """Distance from the spot as the landing is ordered: all that is recorded of people."""
    time_s: FlightQuantiles | None
    """Time of steering."""
    detour: FlightQuantiles | None
    """Flown way, divided by the distance of start and spot."""
    taking_s: FlightQuantiles | None = None
    """Time of taking the robot before."""

    def as_json(self) -> dict[str, Any]:
        """Return the row for a JSON file."""
        return asdict(self)


def flight_row(condition: FlightCondition, scores: Sequence[FlightScore]) -> FlightRow:
    """Return the row of simulated people, one a score."""
    return FlightRow(
        bench=condition.bench,
        condition=condition.name,
        who=SIMULATED,
        n=len(scores),
        people=len(scores),
        failed=sum(score.error_m is None for score in scores),
        error_m=FlightQuantiles.of([score.error_m for score in scores]),
        ordered_error_m=FlightQuantiles.of([score.ordered_error_m for score in scores]),
        time_s=FlightQuantiles.of([score.time_s for score in scores]),
        detour=FlightQuantiles.of([score.detour for score in scores]),
        taking_s=FlightQuantiles.of([score.taking_s for score in scores]),
    )


def recorded_rows(folder: Path) -> list[FlightRow]:
    """Return the rows of the people recorded in `folder`, by pointing and with a joystick.

    Raises:
        ConfigError: If a file is missing or damaged.
    """
    moves = hri_landing.read_moves(folder)
    rows: list[FlightRow] = []
    for mode in ("pointing", "joystick"):
        flown = [move for move in moves if move.mode == mode]
        if flown:
            rows.append(
                FlightRow(
                    bench="landing",
                    condition="recorded",
                    who=f"people, {mode}",
                    n=len(flown),
                    people=len({move.subject for move in flown}),
                    failed=0,
                    error_m=None,
                    ordered_error_m=FlightQuantiles.of([move.error_m for move in flown]),
                    time_s=FlightQuantiles.of([move.time_s for move in flown]),
                    detour=FlightQuantiles.of([move.detour for move in flown]),
                )
            )
    return rows
