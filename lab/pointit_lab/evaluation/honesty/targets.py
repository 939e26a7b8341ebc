"""Targets of the rows of honesty, and limits that they must not fall behind."""

import csv
import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from importlib import resources

from pointit_lab.evaluation.honesty.row import EVERY, HonestyRow

LIMITS_FILE = "limits.csv"
"""Limits of rows over all durations, so that a change that makes one worse is noticed."""

FEWEST = 5
"""Taken poses below which no share is compared: one pose would decide."""

KNOWN_MISS = 0.10
"""Share of confidently wrong poses above which a limit is a known miss. To take less is better then."""

TAKEN_SLACK = 0.06
"""Difference of the share of taken poses from its limit. The limits of other shares permit one pose more."""

SQUARE_SLACK = 1.3
"""Factor between the squared error of a row and its limit."""

STEP = 0.01
"""Step of limits."""


@dataclass(frozen=True, kw_only=True)
class HonestyLimits:
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
        taken_percent = 100.0 * row.taken
        if row.taken < self.taken_least:
            broken.append(f"taken {taken_percent:.0f} %")
        if row.taken * row.n < FEWEST:
            return broken
        wrong = None if row.wrong is None else row.wrong.value
        ranges = (
            ("2 sigma of the place", row.within_2_sigma, self.within_least, self.within_most),
            ("2 sigma of the yaw", row.yaw_within_2_sigma, self.yaw_least, self.yaw_most),
            ("confidently wrong", wrong, 0.0, self.wrong_most),
        )
        for name, share, least, most in ranges:
            if share is not None and not least <= share <= most:
                percent = 100.0 * share
                broken.append(f"{name} {percent:.1f} %")
        if row.square is None:
            return broken
        if not self.square_least <= row.square <= self.square_most:
            broken.append(f"squared error {row.square:.2f}")
        return broken

    def tightened(self, other: "HonestyLimits") -> "HonestyLimits":
        """Return the range within both."""
        limits: dict[str, float] = {}
        for field in fields(self):
            own: float = getattr(self, field.name)
            others: float = getattr(other, field.name)
            if field.name.endswith("least"):
                limits[field.name] = max(own, others)
            else:
                limits[field.name] = min(own, others)
        return HonestyLimits(**limits)


TARGETS = HonestyLimits()
"""Targets of every row."""


def missed(rows: Iterable[HonestyRow]) -> list[tuple[HonestyRow, list[str]]]:
    """Return the rows over all durations that miss the targets, each with what it misses."""
    missing: list[tuple[HonestyRow, list[str]]] = []
    for row in rows:
        if row.duration != EVERY:
            continue
        broken = TARGETS.broken_by(row)
        if broken:
            missing.append((row, broken))
    return missing


def limits_of(row: HonestyRow) -> HonestyLimits:
    """Return limits that `row` keeps with some slack, nowhere within the targets."""
    count = round(row.taken * row.n)
    if count < FEWEST:
        return TARGETS
    if row.wrong is None or row.square is None:
        return TARGETS
    if row.within_2_sigma is None:
        return TARGETS
    place = row.within_2_sigma
    yaw = place if row.yaw_within_2_sigma is None else row.yaw_within_2_sigma

    # a row that is often wrong may take less, without limit
    taken_least = 0.0
    if row.wrong.value <= KNOWN_MISS:
        taken_least = _least_share(row.taken - TAKEN_SLACK)

    # shares permit one pose more on either side
    pose_share = 1.0 / count
    least_square = _down(row.square / SQUARE_SLACK)
    most_square = _up(row.square * SQUARE_SLACK)
    own = HonestyLimits(
        taken_least=taken_least,
        within_least=_least_share(place - pose_share),
        within_most=_most_share(place + pose_share),
        yaw_least=_least_share(yaw - pose_share),
        yaw_most=_most_share(yaw + pose_share),
        square_least=least_square,
        square_most=most_square,
        wrong_most=_most_share(row.wrong.value + pose_share),
    )
    return replace(
        own,
        within_least=min(own.within_least, TARGETS.within_least),
        within_most=max(own.within_most, TARGETS.within_most),
        yaw_least=min(own.yaw_least, TARGETS.yaw_least),
        yaw_most=max(own.yaw_most, TARGETS.yaw_most),
        square_least=min(own.square_least, TARGETS.square_least),
        square_most=max(own.square_most, TARGETS.square_most),
        wrong_most=max(own.wrong_most, TARGETS.wrong_most),
    )


def _least_share(share: float) -> float:
    return max(_down(share), 0.0)


def _most_share(share: float) -> float:
    return min(_up(share), 1.0)


def _down(value: float) -> float:
    steps = math.floor(value / STEP)
    return round(STEP * steps, 2)


def _up(value: float) -> float:
    steps = math.ceil(value / STEP)
    return round(STEP * steps, 2)


def regressions(rows: Sequence[HonestyRow], asked: Collection[tuple[str, str]] = ()) -> list[str]:
    """Return a sentence on each row over all durations that is out of its limits, has none, or is missing.

    Args:
        rows: judged ones.
        asked: sets and conditions that should be among them, as far as limits are stated.
    """
    limits = stated()
    judged = {(row.set, row.condition) for row in rows}
    reports: list[str] = []
    for key in limits:
        if key in asked and key not in judged:
            reports.append(f"{', '.join(key)}: no trial")
    for row in rows:
        if row.duration != EVERY:
            continue
        own_limits = limits.get((row.set, row.condition))
        broken = ["no limits are stated"]
        if own_limits is not None:
            broken = own_limits.broken_by(row)
        if broken:
            reasons = ", ".join(broken)
            reports.append(f"{row.set}, {row.condition}: {reasons}")
    return reports


def stated() -> dict[tuple[str, str], HonestyLimits]:
    """Return the limits of `LIMITS_FILE` by set and condition."""
    package = resources.files(__package__ or "")
    text = package.joinpath(LIMITS_FILE).read_text(encoding="utf-8")
    names = [field.name for field in fields(HonestyLimits)]
    limits: dict[tuple[str, str], HonestyLimits] = {}
    for line in csv.DictReader(text.splitlines()):
        values = {name: float(line[name]) for name in names}
        key = (line["set"], line["condition"])
        limits[key] = HonestyLimits(**values)
    return limits
