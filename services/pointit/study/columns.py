"""Columns of trials.csv: names, units, meanings. Rows that count."""

import csv
import datetime as dt
import io
import math
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
ADDED = ("announced", "stepped", "confirmed")
"""Columns that tables of earlier versions lack, in which they are not known."""
NUMBERS = ("corrections", *ADDED, *(name for name, unit, _ in COLUMNS if unit))
"""Columns of numbers that may be empty, which means not known."""
MAY_BE_EMPTY = ("target", "reason", "began_utc", "condition")
"""Columns of texts that may be empty."""
NOT_KNOWN = frozenset(("", "na", "n/a", "#n/a", "nan", "<na>", "<missing>", "null", "none", "."))
"""Values that are not known, in lower case, as the study and programs for statistics write them."""
MAX_ERROR_APART_M = 0.01
"""Maximum difference between the column `error_m` and the distance of its two points, m."""
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


def parse_time(text: str) -> str:
    """Return the time in `text` with a zone. Raises ValueError if it is none."""
    try:
        time = dt.datetime.fromisoformat(text)
    except ValueError:
        time = None
    if time is None or ":" not in text:
        raise ValueError(f"began_utc is {text!r}, not a time such as 2026-01-31T10:00:00.5+00:00")
    return text if time.tzinfo else f"{text}+00:00"


def check_error(row: Mapping[str, str]) -> None:
    """Check the columns that state the same length twice: spreadsheets take 1.333 for 1333 or a date.

    Raises: ValueError: If they differ.
    """
    points = [row.get(f"{point}_{axis}_m", "") for point in ("target", "selected") for axis in "xyz"]
    if not row.get("error_m") or not all(points):
        return
    x, y, z, *selected = map(float, points)
    error_m, apart_m = float(row["error_m"]), math.dist((x, y, z), selected)
    if abs(error_m - apart_m) > max(MAX_ERROR_APART_M, 1e-3 * apart_m):
        raise ValueError(f"error_m is {error_m:g}, but target and selected point are {apart_m:g} m apart")
