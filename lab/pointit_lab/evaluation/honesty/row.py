"""Rows of the table of honesty, and what they should be."""

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
    groups: dict[tuple[str, str, str], list[Judged]] = {}
    for each in judged:
        for duration in (EVERY, each.duration):
            groups.setdefault((each.set, each.condition, duration), []).append(each)
    rows = [_row(*names, group) for names, group in groups.items()]
    ranks = {key: rank for rank, key in enumerate(dict.fromkeys((row.set, row.condition) for row in rows))}
    return sorted(rows, key=lambda row: ranks[row.set, row.condition])


def pooled_rows(judged: Iterable[Judged], simulated: Collection[str]) -> list[HonestyRow]:
    """Return a row for each kind of people and condition, over all sets and durations.

    A row of one set has too few trials to show 1 %.

    Args:
        judged: verdicts.
        simulated: sets of simulated people. The others are recorded.
    """
    groups: dict[tuple[str, str], list[Judged]] = {}
    for each in judged:
        kind = "simulated people" if each.set in simulated else "recorded people"
        # people of different sets may have the same name
        subject = f"{each.set} {each.subject}"
        unit = each.unit and f"{each.set} {each.unit}"
        groups.setdefault((kind, each.condition), []).append(replace(each, subject=subject, unit=unit))
    return [
        _row(kind, condition, EVERY, groups[kind, condition])
        for kind, condition in sorted(groups, key=lambda key: key[0])
    ]


def _row(name: str, condition: str, duration: str, group: Sequence[Judged]) -> HonestyRow:
    judged = [each for each in group if each.taken]
    independent = len({each.unit or each.subject for each in judged})
    yaws = [each.in_yaw for each in judged if each.in_yaw is not None]
    return HonestyRow(
        set=name,
        condition=condition,
        duration=duration,
        n=len(group),
        taken=len(judged) / len(group),
        error_m=MetricSpread.of(each.error_m for each in judged),
        within_2_sigma=_mean([each.in_place for each in judged]),
        yaw_within_2_sigma=_mean(yaws),
        square=_median([each.square for each in judged]),
        wrong=_share(sum(each.is_wrong for each in judged), len(judged)) if judged else None,
        far=_share(sum(each.error_m > FAR_M for each in judged), len(judged)) if judged else None,
        miss_m=_median([each.miss_m for each in judged if each.miss_m is not None]),
        miss_sigma_m=_median([each.miss_sigma_m for each in judged if each.miss_sigma_m is not None]),
        right=_mean([each.right for each in judged if each.right is not None]),
        independent=independent,
        provable=1.0 - 0.05 ** (1.0 / independent) if independent else None,
        without_one=_without_one(judged, lambda each: each.in_place),
        wrong_without_one=_without_one(judged, lambda each: each.is_wrong),
    )


def _share(hits: int, count: int) -> Interval:
    """Return `hits` of `count` with its 95 % interval."""
    ends = stats.binomtest(hits, count).proportion_ci(method="wilson")
    return Interval(value=hits / count, low=float(ends.low), high=float(ends.high))


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _without_one(judged: Sequence[Judged], hits: Callable[[Judged], bool]) -> tuple[float, float] | None:
    """Return the range of the share of `hits` without one person; None of fewer than three people."""
    people = {each.subject for each in judged}
    if len(people) < 3:
        return None
    shares = [np.mean([hits(each) for each in judged if each.subject != one]) for one in people]
    return float(min(shares)), float(max(shares))
