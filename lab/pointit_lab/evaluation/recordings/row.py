"""Rows of an evaluation: one per set of recordings, subject, condition and solver."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np

from pointit_lab.evaluation.selection.difference import Interval

Name = TypeVar("Name", str, tuple[str, str])

ALL = "all"
"""Subject of the row over all of a set."""


@dataclass(frozen=True, kw_only=True)
class MetricSpread:
    """Spread of errors, all in one unit."""

    median: float
    p90: float
    rms: float

    @classmethod
    def of(cls, values: Iterable[float]) -> "MetricSpread | None":
        """Return the spread of the absolute `values`, or None without values."""
        sizes = np.abs(np.array(list(values), dtype=np.float64))
        if not len(sizes):
            return None
        median = float(np.median(sizes))
        p90 = float(np.quantile(sizes, 0.9))
        mean_square = float(np.mean(sizes * sizes))
        return cls(median=median, p90=p90, rms=math.sqrt(mean_square))


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the table; values that do not apply are None."""

    set: str
    subject: str
    condition: str
    """`2 s`, `3 targets`, `1 anchor`."""
    solver: str
    n: int
    """Number of trials, including refused ones."""
    position_m: MetricSpread | None = None
    """Position errors of the accepted poses."""
    every_m: MetricSpread | None = None
    """Position errors of all trials; of refused ones, of the best fit."""
    yaw_deg: MetricSpread | None = None
    pitch_deg: MetricSpread | None = None
    angle_deg: MetricSpread | None = None
    """Angle between ray and target."""
    share_above_1m: float | None = None
    misled: float | None = None
    """Share of stated poses that were off by more than 1 m with a sigma below 0.5 m."""
    within_2_sigma: float | None = None
    """Share of true errors of the position within the stated 2 sigma."""
    yaw_within_2_sigma: float | None = None
    times_plain: tuple[Interval, Interval] | None = None
    """Median and p90 of the yaw errors as multiples of those of plain re-anchoring, over people."""
    refused: int | None = None
    """Trials without a pose."""
    taken: float | None = None
    """Share of the trials whose pose the running localizer takes."""
    taken_m: MetricSpread | None = None
    """Position errors of the taken poses."""
    taken_above_1m: float | None = None
    """Share of the taken poses that are more than 1 m off."""
    until_taken_s: float | None = None
    """Median of the shortest window whose pose is taken, over all starts. None if most are never."""
    unsure: int | None = None
    """Trials whose stated sigma exceeds the localizer's limit; their errors count."""
    solve_ms: MetricSpread | None = None
    bound_m: float | None = None
    """Median position error of an ideal solver of the trials with a pose (`cramer_rao`)."""

    def as_json(self) -> dict[str, Any]:
        """Return the row for a JSON file."""
        return asdict(self)


def arranged(rows: Iterable[Row]) -> list[Row]:
    """Return `rows` sorted by first appearance of set, condition and subject, with all subjects first."""
    all_rows = list(rows)
    sets = _ranks(row.set for row in all_rows)
    conditions = _ranks((row.set, row.condition) for row in all_rows)
    subjects = _ranks((row.set, row.subject) for row in all_rows)

    def rank(row: Row) -> tuple[int, int, bool, int]:
        condition = conditions[row.set, row.condition]
        subject = subjects[row.set, row.subject]
        return sets[row.set], condition, row.subject != ALL, subject

    return sorted(all_rows, key=rank)


def _ranks(names: Iterable[Name]) -> dict[Name, int]:
    """Return the rank of each of `names` by its first appearance."""
    distinct = dict.fromkeys(names)
    return {name: rank for rank, name in enumerate(distinct)}


def document(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the document for `--json FILE`."""
    return {"rows": [row.as_json() for row in rows]}
