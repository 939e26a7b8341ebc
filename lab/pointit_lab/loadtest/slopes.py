"""Slopes of CPU time and memory per person and per host, and what they make of a core; pure.

Measurements of several numbers of people, and of several numbers of hosts, are explained by least squares:
so much for the site, so much for each person (at the rate of the samples that could be sent), so much for
each host. The errors are 95 % confidence
intervals by Student's t with the residuals' standard deviation, so they cover scatter, not a curve.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pointit_lab.loadtest.load_result import MIN_SENT, LoadResult, Usage

CONFIDENCE = 0.95
FIXED = "fixed"
PER_PERSON = "per_person"
PER_HOST = "per_host"
CORE = 100.0
"""A core, in percent of a core."""


@dataclass(frozen=True, kw_only=True)
class LoadSlope:
    """An estimate with the half-width of its confidence interval."""

    value: float
    error: float | None
    """None with as many measurements as unknowns: it is not known then."""

    def __str__(self) -> str:
        """Return it with the digits that its error permits."""
        if self.error is None:
            return f"{self.value:.3g} ± ?"
        if not self.error:
            return f"{self.value:.3g} ± 0"
        magnitude = math.floor(math.log10(self.error))
        digits = max(0, 1 - magnitude)
        return f"{self.value:.{digits}f} ± {self.error:.{digits}f}"


def fit(unknowns: Mapping[str, Sequence[float]], values: Sequence[float]) -> dict[str, LoadSlope]:
    """Return the coefficients of `unknowns` in a linear model of `values`, by least squares.

    Unknowns that cannot be told from the ones before them are left out: that of hosts if their number never
    changed. Empty with fewer values than unknowns.
    """
    # A column that raises the rank is independent of those before it.
    columns: dict[str, Sequence[float]] = {}
    for name, column in unknowns.items():
        extended = np.column_stack([*columns.values(), column])
        if np.linalg.matrix_rank(extended) > len(columns):
            columns[name] = column
    enough = max(2, len(columns))
    if len(values) < enough:
        return {}
    from scipy.stats import t as student  # noqa: PLC0415 - takes half a second

    design = np.column_stack(list(columns.values()))
    measured = np.asarray(values)
    solution = np.linalg.lstsq(design, measured)[0]

    # The residuals say something about the errors only if there are more values than unknowns.
    degrees_of_freedom = len(values) - len(columns)
    errors: list[float | None] = [None] * len(columns)
    if degrees_of_freedom:
        residuals = measured - design @ solution
        variance = float(np.sum(residuals**2)) / degrees_of_freedom
        covariance = variance * np.linalg.inv(design.T @ design)
        upper = (1 + CONFIDENCE) / 2
        quantile = float(student.ppf(upper, degrees_of_freedom))
        errors = [math.sqrt(diagonal) * quantile for diagonal in np.diag(covariance)]

    slopes: dict[str, LoadSlope] = {}
    for name, value, error in zip(columns, solution, errors, strict=True):
        slopes[name] = LoadSlope(value=float(value), error=error)
    return slopes


@dataclass(frozen=True, kw_only=True)
class PartSlopes:
    """Costs of a part of a load test."""

    part: str
    points: int
    """Number of measurements."""
    cpu_percent: Mapping[str, LoadSlope]
    """Percent of a core, fixed, per person and per host."""
    memory_mb: Mapping[str, LoadSlope]

    @property
    def people_a_core(self) -> tuple[float, float | None, float | None] | None:
        """Return the people whose cost alone, without the fixed part, is a core: value, least, most.

        None if the slope is not above zero. The least and the most are None if the error of the slope is not
        known, the most also if its interval includes zero.
        """
        cpu = self.cpu_percent[PER_PERSON]
        if cpu.value <= 0:
            return None
        if cpu.error is None:
            return CORE / cpu.value, None, None
        low = cpu.value - cpu.error
        high = cpu.value + cpu.error
        most = CORE / low if low > 0 else None
        return CORE / cpu.value, CORE / high, most

    def row(self) -> dict[str, Any]:
        """Return a row of the table."""
        # All columns are there, also those of unknowns that were left out: the rows are one table.
        row: dict[str, Any] = {"part": self.part, "points": self.points}
        for kind, slopes in (("cpu_percent", self.cpu_percent), ("memory_mb", self.memory_mb)):
            for name in (FIXED, PER_PERSON, PER_HOST):
                column = f"{kind}_{name}"
                row[column] = None
                if name in slopes:
                    row[column] = str(slopes[name])

        people_a_core = self.people_a_core
        row["people_a_core"] = None
        if people_a_core is not None:
            value, least, most = people_a_core
            interval = f"[{_whole(least)}, {_whole(most)}]"
            row["people_a_core"] = f"{value:.0f} {interval}"
        return row

    def record(self) -> dict[str, Any]:
        """Return all values, for programs."""
        return {**asdict(self), "people_a_core": self.people_a_core}


def _whole(value: float | None) -> str:
    return "?" if value is None else f"{value:.0f}"


def _people(usages: Sequence[Usage]) -> list[Usage]:
    return [usage for usage in usages if re.match(r"people|users|all", usage.name)]


def _cpu(usages: Sequence[Usage]) -> float:
    return sum(usage.cpu for usage in usages)


def _memory_mb(usages: Sequence[Usage]) -> float:
    return sum(usage.memory_mb for usage in usages)


def _site(usages: Sequence[Usage]) -> list[Usage]:
    return [usage for usage in usages if usage.name == "site"]


def _routers(usages: Sequence[Usage]) -> list[Usage]:
    return [usage for usage in usages if usage.name.startswith("router")]


PARTS: Mapping[str, Callable[[Sequence[Usage]], Sequence[Usage]]] = {
    "all processes": lambda usages: usages,
    "people": _people,
    "site": _site,
    "all routers": _routers,
    "root router": lambda usages: _routers(usages)[:1],
}
"""Parts of a load test, chosen from its processes. The first router is the root of the tree."""


def slopes(results: Sequence[LoadResult]) -> list[PartSlopes]:
    """Return the costs of each part. Empty if these measurements cannot tell them.

    Those of a machine that was too busy to send all samples are left out: late samples share wake-ups.
    """
    results = [result for result in results if result.sent_share >= MIN_SENT]
    # people by what was sent: the cost is that of samples
    people = [result.sent / (result.rate_hz * result.duration_s) for result in results]
    hosts = [float(result.hosts) for result in results]
    fixed = [1.0] * len(results)
    unknowns = {FIXED: fixed, PER_PERSON: people, PER_HOST: hosts}
    slopes: list[PartSlopes] = []
    for name, choose in PARTS.items():
        parts = [choose(result.processes) for result in results]
        if not all(parts):
            continue
        cpu = fit(unknowns, [_cpu(part) * CORE for part in parts])
        memory = fit(unknowns, [_memory_mb(part) for part in parts])
        if PER_PERSON in cpu:
            part_slopes = PartSlopes(part=name, points=len(results), cpu_percent=cpu, memory_mb=memory)
            slopes.append(part_slopes)
    return slopes
