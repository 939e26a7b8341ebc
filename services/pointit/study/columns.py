"""Columns of trials.csv: names, units, meanings."""

import datetime as dt
from typing import Literal, get_args

Outcome = Literal["hit", "wrong", "timeout", "skipped"]
OUTCOMES = get_args(Outcome)

COLUMNS: tuple[tuple[str, str, str], ...] = (
    ("participant", "", "pseudonym"),
    ("block", "", "number of the block, from 1"),
    ("trial", "", "number of the trial in the participant's plan, from 1"),
    ("attempt", "", "number of the attempt at this trial, from 1; the last one counts"),
    ("practice", "", "1: practice, not to be analysed; 0: data"),
    ("task", "", "kind of task"),
    ("seed", "", "seed of the target's place"),
    ("pointit_version", "", "version of PointIt"),
    ("target", "", "name of the target"),
    ("outcome", "", "hit, wrong (something else was selected), timeout or skipped"),
    ("reason", "", "why it was skipped, or is wrong; begins with `repeated` if the attempt does not count"),
    ("began_utc", "", "time at which the target was shown, ISO 8601, UTC"),
    ("first_hover_s", "s", "from showing the target to the first hover of it"),
    ("selection_s", "s", "from showing the target to the end by the participant"),
    ("corrections", "", "number of times that the pointer left the target before the end"),
    ("path_length_deg", "deg", "way of the ray's direction in the room, in steps of 0.5 deg or more"),
    ("error_m", "m", "from the target's centre to the selected point"),
    ("error_deg", "deg", "from the target's centre to the ray at the end, at the eyes"),
    (
        "target_distance_m",
        "m",
        "from the last target's centre to this one's; of the first in a block from the cursor at the start",
    ),
    ("target_width_m", "m", "extent of the target"),
    ("target_distance_deg", "deg", "the same as an angle at the eyes"),
    ("target_width_deg", "deg", "extent of the target, at the eyes"),
    *((f"target_{axis}_m", "m", f"{axis} of the target's centre at the end, in the room") for axis in "xyz"),
    *(
        (f"selected_{axis}_m", "m", f"{axis} of the cursor at the end, or of the ray by the target")
        for axis in "xyz"
    ),
)
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
