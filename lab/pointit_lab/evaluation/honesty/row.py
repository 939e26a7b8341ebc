"""Rows of the table of honesty, and what they should be."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from pointit_lab.evaluation.recordings.row import MetricSpread
from pointit_lab.evaluation.selection.difference import Interval

EVERY = "all"
"""Duration of the row over all durations, or numbers of lamps."""

FAR_M = 1.0
"""Error above which a pose is far off, however uncertain it says it is."""

WRONG_M = 0.5
"""Error above which a pose beyond 2 sigma is confidently wrong."""

MEDIAN_SQUARE = float(stats.chi2.median(2))
"""Median squared Mahalanobis distance of a place from the stated normal distribution."""

UNIT_S = 10.0
"""Length of the stretch of a recording whose windows count as one independent trial, that of the longest."""

WITHIN_SQUARE = float(stats.chi2.ppf(stats.chi2.cdf(2.0**2, 1), 2))
"""Its bound of 2 sigma: 95.45 % are within, as of one normal variable (6.18, in two dimensions)."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """Verdict on one trial."""

    set: str
    condition: str
    """Name of the injection."""
    duration: str
    """`2 s`, `3 lamps`."""
    subject: str
    taken: bool
    unit: str = ""
    """Name of the trials with which it is counted as one independent trial. Empty: those of its person."""
    error_m: float = 0.0
    square: float = 0.0
    """Squared Mahalanobis distance of the true place, over its nominal median."""
    in_place: bool = True
    """True if the place is within 2 sigma: in the ellipse of `WITHIN_SQUARE`."""
    in_yaw: bool | None = None
    """True if the yaw is within 2 sigma. None if the true one is unknown."""
    miss_m: float | None = None
    """Rms miss of the cursor at the targets pointed at. None if the true yaw is unknown."""
    miss_sigma_m: float | None = None
    """The same, as the covariance of the pose states it."""
    right: float | None = None
    """Share of eight things 3 m away all round that the person selects. None if the true yaw is unknown."""

    @property
    def is_wrong(self) -> bool:
        """Return True if the pose is confidently wrong."""
        return self.taken and not self.in_place and self.error_m > WRONG_M


@dataclass(frozen=True, kw_only=True)
class HonestyRow:
    """One line: a set under one condition. Figures of taken poses are None if none was taken."""

    set: str
    condition: str
    duration: str
    n: int
    taken: float
    """Share of trials whose pose the localizer takes."""
    error_m: MetricSpread | None
    within_2_sigma: float | None
    yaw_within_2_sigma: float | None
    square: float | None
    """Median squared Mahalanobis distance of the place, over its nominal median."""
    wrong: Interval | None
    """Share of the taken poses beyond 2 sigma and `WRONG_M`, with a 95 % interval (Wilson) as if trials were
    independent: windows of a recording overlap, and people have several."""
    far: Interval | None = None
    """Share of the taken poses more than `FAR_M` off, with the same interval."""
    miss_m: float | None = None
    """Median miss of the cursor at the targets pointed at, None if true yaws are unknown."""
    miss_sigma_m: float | None = None
    """Median of what is stated of it."""
    right: float | None = None
    """Mean share of eight things 3 m away all round that are selected, None if true yaws are unknown."""
    independent: int = 0
    """Number of independent trials with a taken pose: simulated people, stretches of `UNIT_S` of a recording,
    or recorded people who pointed at lamps."""
    provable: float | None = None
    """Share of wrong poses that as many independent trials without one exclude, with 95 % confidence."""
    without_one: tuple[float, float] | None = None
    """Least and greatest share within 2 sigma if any one person is left out."""
    wrong_without_one: tuple[float, float] | None = None
    """The same of `wrong`."""

    def as_json(self) -> dict[str, Any]:
        """Return the row for a JSON file."""
        return asdict(self)


def rows_of(judged: Iterable[Judged]) -> list[HonestyRow]:
    """Return a row for each set, condition and duration, each after the row over all durations."""
    groups = defaultdict[tuple[str, str, str], list[Judged]](list)
    for verdict in judged:
        for duration in (EVERY, verdict.duration):
            groups[verdict.set, verdict.condition, duration].append(verdict)
    rows = [_row(*names, group) for names, group in groups.items()]

    # a stable sort by first appearance keeps the durations of a set and condition together
    keys = dict.fromkeys((row.set, row.condition) for row in rows)
    ranks = {key: rank for rank, key in enumerate(keys)}
    return sorted(rows, key=lambda row: ranks[row.set, row.condition])


def pooled_rows(judged: Iterable[Judged], simulated: Collection[str]) -> list[HonestyRow]:
    """Return a row for each kind of people and condition, over all sets and durations.

    A row of one set has too few trials to show 1 %.

    Args:
        judged: verdicts.
        simulated: sets of simulated people. The others are recorded.
    """
    groups = defaultdict[tuple[str, str], list[Judged]](list)
    for verdict in judged:
        kind = "simulated people" if verdict.set in simulated else "recorded people"
        # people of different sets may have the same name
        subject = f"{verdict.set} {verdict.subject}"
        unit = verdict.unit
        if unit:
            unit = f"{verdict.set} {unit}"
        pooled = replace(verdict, subject=subject, unit=unit)
        groups[kind, verdict.condition].append(pooled)
    # by kind alone: conditions stay in the order of the injections
    keys = sorted(groups, key=lambda key: key[0])
    return [_row(kind, condition, EVERY, groups[kind, condition]) for kind, condition in keys]


def _row(name: str, condition: str, duration: str, group: Sequence[Judged]) -> HonestyRow:
    taken = [verdict for verdict in group if verdict.taken]
    # some values are unknown for some poses: over those that have one
    yaws = _known(verdict.in_yaw for verdict in taken)
    misses_m = _known(verdict.miss_m for verdict in taken)
    stated_misses_m = _known(verdict.miss_sigma_m for verdict in taken)
    right_shares = _known(verdict.right for verdict in taken)
    places = [verdict.in_place for verdict in taken]
    squares = [verdict.square for verdict in taken]
    row = HonestyRow(
        set=name,
        condition=condition,
        duration=duration,
        n=len(group),
        taken=len(taken) / len(group),
        error_m=MetricSpread.of(verdict.error_m for verdict in taken),
        within_2_sigma=_mean(places),
        yaw_within_2_sigma=_mean(yaws),
        square=_median(squares),
        wrong=None,
        miss_m=_median(misses_m),
        miss_sigma_m=_median(stated_misses_m),
        right=_mean(right_shares),
    )
    # shares of no pose at all have no interval
    return _with_intervals(row, taken) if taken else row


def _with_intervals(row: HonestyRow, taken: Sequence[Judged]) -> HonestyRow:
    """Return `row` with the shares of wrong poses, and their uncertainty; `taken` is not empty."""
    wrong_count = sum(verdict.is_wrong for verdict in taken)
    far_count = sum(verdict.error_m > FAR_M for verdict in taken)
    units = {verdict.unit or verdict.subject for verdict in taken}
    return replace(
        row,
        wrong=_share(wrong_count, len(taken)),
        far=_share(far_count, len(taken)),
        independent=len(units),
        # the share p of which n trials show none with probability 5 %: (1 - p)^n = 0.05
        provable=1.0 - 0.05 ** (1.0 / len(units)),
        without_one=_without_one(taken, lambda verdict: verdict.in_place),
        wrong_without_one=_without_one(taken, lambda verdict: verdict.is_wrong),
    )


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _share(hits: int, count: int) -> Interval:
    """Return `hits` of `count` with its 95 % interval."""
    ends = stats.binomtest(hits, count).proportion_ci(method="wilson")
    low = float(ends.low)
    high = float(ends.high)
    return Interval(value=hits / count, low=low, high=high)


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _without_one(judged: Sequence[Judged], hits: Callable[[Judged], bool]) -> tuple[float, float] | None:
    """Return the range of the share of `hits` without one person; None of fewer than three people."""
    by_person = defaultdict[str, list[bool]](list)
    for verdict in judged:
        by_person[verdict.subject].append(hits(verdict))
    if len(by_person) < 3:
        return None
    shares: list[float] = []
    for person in by_person:
        others = [own for subject, own in by_person.items() if subject != person]
        shares.append(float(np.mean(np.concatenate(others))))
    return min(shares), max(shares)
