"""Targets of the rows of honesty, and limits that they must not fall behind."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from importlib import resources

from pointit.evaluation.honesty.row import EVERY, HonestyRow

LIMITS_FILE = "limits.csv"
"""Limits of rows over all durations, so that a change that makes one worse is noticed."""

FEWEST = 5
"""Taken poses below which no share is compared: one pose would decide."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Range of each figure of a row."""

    taken_least: float = 0.0
    within_least: float = 0.90
    within_most: float = 0.98
    """Share of true errors within 2 sigma, of place and yaw."""
    yaw_least: float = 0.90
    yaw_most: float = 0.98
    square_least: float = 0.6
    square_most: float = 1.6
    wrong_most: float = 0.01

    def broken_by(self, row: HonestyRow) -> list[str]:
        """Return the figures of `row` out of range, in words."""
        broken: list[str] = []
        if row.taken < self.taken_least:
            broken.append(f"taken {100.0 * row.taken:.0f} %")
        if row.taken * row.n < FEWEST:
            return broken
        for name, value, least, most in (
            ("2 sigma of the place", row.within_2_sigma, self.within_least, self.within_most),
            ("2 sigma of the yaw", row.yaw_within_2_sigma, self.yaw_least, self.yaw_most),
            ("confidently wrong", None if row.wrong is None else row.wrong.value, 0.0, self.wrong_most),
        ):
            if value is not None and not least <= value <= most:
                broken.append(f"{name} {100.0 * value:.1f} %")
        if row.square is not None and not self.square_least <= row.square <= self.square_most:
            broken.append(f"squared error {row.square:.2f}")
        return broken


TARGETS = Limits()
"""Targets of every row."""


def missed(rows: Iterable[HonestyRow]) -> list[tuple[HonestyRow, list[str]]]:
    """Return the rows over all durations that miss the targets, each with what it misses."""
    found = [(row, TARGETS.broken_by(row)) for row in rows if row.duration == EVERY]
    return [(row, broken) for row, broken in found if broken]


def regressions(rows: Sequence[HonestyRow]) -> list[str]:
    """Return a sentence on each row over all durations that is out of its limits, or has none."""
    limits = stated()
    told: list[str] = []
    for row in rows:
        if row.duration != EVERY:
            continue
        own = limits.get((row.set, row.condition))
        broken = ["no limits are stated"] if own is None else own.broken_by(row)
        if broken:
            told.append(f"{row.set}, {row.condition}: {', '.join(broken)}")
    return told


def stated() -> dict[tuple[str, str], Limits]:
    """Return the limits of `LIMITS_FILE` by set and condition."""
    text = resources.files(__package__ or "").joinpath(LIMITS_FILE).read_text(encoding="utf-8")
    names = [each.name for each in fields(Limits)]
    return {
        (line["set"], line["condition"]): Limits(**{name: float(line[name]) for name in names})
        for line in csv.DictReader(text.splitlines())
    }
