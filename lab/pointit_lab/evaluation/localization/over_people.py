"""Errors over people: how they differ from person to person, and whether one method is better for people.

Of each person the median error counts once, however long they were recorded. Errors are positive and skewed,
so their logarithms are averaged: the result is a geometric mean with a 95 % interval of Student's t.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from pointit_lab.evaluation.recordings.row import ALL, Row
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
    medians = _log_medians(rows)
    over_people: list[OverPeople] = []
    for (condition, solver, unit), logs in medians.items():
        if len(logs) < MIN_PEOPLE:
            continue
        person_logs = list(logs.values())
        over = OverPeople(
            condition=condition,
            solver=solver,
            people=len(logs),
            unit=unit,
            error=_interval(person_logs),
            error_without_one=_without_one(person_logs),
        )

        # differences of logarithms are ratios, within a person
        reference_logs: dict[str, float] = {}
        if solver != reference:
            reference_logs = medians.get((condition, reference, unit), {})
        both = [person for person in logs if person in reference_logs]
        differences = [logs[person] - reference_logs[person] for person in both]
        if len(differences) >= MIN_PEOPLE:
            ratio = _interval(differences)
            over = replace(over, ratio=ratio, without_one=_without_one(differences))
        over_people.append(over)
    return over_people


def _log_medians(rows: Iterable[Row]) -> dict[tuple[str, str, str], dict[str, float]]:
    """Return the logarithms of each person's median error, by condition, solver and unit."""
    medians = defaultdict[tuple[str, str, str], dict[str, float]](dict)
    for row in rows:
        if row.subject == ALL:
            continue
        for unit, spread in (("m", row.position_m), ("°", row.angle_deg)):
            if spread is not None:
                by_person = medians[row.condition, row.solver, unit]
                by_person[row.subject] = math.log(max(spread.median, MIN_P))
    return dict(medians)


def _interval(logs: Sequence[float]) -> Interval:
    mean = float(np.mean(logs))
    count = len(logs)
    upper = 0.5 + CONFIDENCE / 2.0
    quantile = stats.t.ppf(upper, count - 1)
    deviation = np.std(logs, ddof=1)
    reach = float(quantile * deviation / math.sqrt(count))
    # the exponential of more than 700 overflows
    high = math.exp(min(mean + reach, 700.0))
    low = math.exp(mean - reach)
    return Interval(value=math.exp(mean), low=low, high=high)


def _without_one(logs: Sequence[float]) -> tuple[float, float]:
    total = sum(logs)
    others = len(logs) - 1
    means = [math.exp((total - own) / others) for own in logs]
    return min(means), max(means)
