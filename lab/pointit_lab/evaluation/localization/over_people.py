"""Errors over people: how they differ from person to person, and whether one method is better for people.

Of each person the median error counts once, however long they were recorded. Errors are positive and skewed,
so their logarithms are averaged: the result is a geometric mean with a 95 % interval of Student's t.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import stats

from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row
from pointit_lab.evaluation.selection.difference import Interval

CONFIDENCE = 0.95

MIN_PEOPLE = 3
"""Smallest number of people for an interval."""

MIN_P = 1e-4
"""Smallest error (m or degrees) in a logarithm."""


@dataclass(frozen=True, kw_only=True)
class OverPeople:
    """A method in one condition, over at least `MIN_PEOPLE`."""

    condition: str
    solver: str
    people: int
    unit: str
    """`m`, or `°` of an angle."""
    error: Interval
    """Geometric mean of the people's median errors."""
    ratio: Interval | None = None
    """That error as a multiple of the reference method's, of the same people. None if it is the reference."""
    without_one: tuple[float, float] | None = None
    """Least and greatest ratio if any one person is left out."""
    error_without_one: tuple[float, float] | None = None
    """Least and greatest error if any one person is left out."""

    def as_json(self) -> dict[str, Any]:
        """Return the row for a JSON file."""
        return asdict(self)


def over_people(rows: Iterable[Row], reference: str) -> list[OverPeople]:
    """Return the errors over people of each condition and method with at least `MIN_PEOPLE`.

    Args:
        rows: of one set, with a row for each person.
        reference: the method with which others are compared, in the people that both have.
    """
    medians: dict[tuple[str, str, str], dict[str, float]] = {}
    for row in rows:
        for unit, spread in (("m", row.position_m), ("°", row.angle_deg)):
            if row.subject != ALL and isinstance(spread, MetricSpread):
                of = medians.setdefault((row.condition, row.solver, unit), {})
                of[row.subject] = math.log(max(spread.median, MIN_P))
    over_people: list[OverPeople] = []
    for (condition, solver, unit), logs in medians.items():
        if len(logs) < MIN_PEOPLE:
            continue
        others = {} if solver == reference else medians.get((condition, reference, unit), {})
        differences = [logs[person] - others[person] for person in logs if person in others]
        is_compared = len(differences) >= MIN_PEOPLE
        over_people.append(
            OverPeople(
                condition=condition,
                solver=solver,
                people=len(logs),
                unit=unit,
                error=_interval(list(logs.values())),
                error_without_one=_without_one(list(logs.values())),
                ratio=_interval(differences) if is_compared else None,
                without_one=_without_one(differences) if is_compared else None,
            )
        )
    return over_people


def _interval(logs: Sequence[float]) -> Interval:
    mean = float(np.mean(logs))
    count = len(logs)
    reach = float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, count - 1) * np.std(logs, ddof=1) / math.sqrt(count))
    return Interval(value=math.exp(mean), low=math.exp(mean - reach), high=math.exp(min(mean + reach, 700.0)))


def _without_one(logs: Sequence[float]) -> tuple[float, float]:
    total = sum(logs)
    count = len(logs)
    means = [math.exp((total - each) / (count - 1)) for each in logs]
    return min(means), max(means)
