"""Columns of trials.csv: names, units, meanings. Rows that count."""

import csv
import datetime as dt
import io
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import Literal, get_args

Outcome = Literal["hit", "wrong", "timeout", "skipped"]
OUTCOMES = get_args(Outcome)

_TEXT = (resources.files("pointit.study") / "texts" / "columns.csv").read_text(encoding="utf-8")
COLUMNS = tuple((name, unit, meaning) for name, unit, meaning in csv.reader(io.StringIO(_TEXT)))[1:]
"""Name, unit, meaning. A column of each factor, its level, stands after `practice`."""

FIXED = frozenset(name for name, _, _ in COLUMNS)
COUNTS = ("block", "trial", "attempt", "practice")
"""Columns of whole numbers, which are never empty."""
NUMBERS = ("corrections", *(name for name, unit, _ in COLUMNS if unit))
"""Columns of numbers that may be empty, which means not known."""
FACTORS_AFTER = "practice"
REPEATED = "repeated"
"""First word of the reason of an attempt that does not count."""


def columns_of(factors: list[str]) -> list[tuple[str, str, str]]:
    """Return all columns of a study with these factors, in their order."""
    at = [name for name, _, _ in COLUMNS].index(FACTORS_AFTER) + 1
    levels = [(name, "", "level of this factor") for name in factors]
    return [*COLUMNS[:at], *levels, *COLUMNS[at:]]


def utc(stamp_ns: int) -> str:
    """Return a time as ISO 8601, UTC, to the microsecond."""
    return dt.datetime.fromtimestamp(stamp_ns / 1e9, dt.UTC).isoformat(timespec="microseconds")


def counts(row: Mapping[str, str]) -> bool:
    """Return True if an attempt counts, so that its trial is done."""
    return not row["reason"].startswith(REPEATED)


def done_trials(rows: Iterable[Mapping[str, str]]) -> set[int]:
    """Return the numbers of the trials that are done."""
    return {int(row["trial"]) for row in rows if counts(row)}
