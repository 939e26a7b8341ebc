"""From solved trials to rows of the table."""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pointit_lab.evaluation.localization.trial import LocalizationTrial
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row, arranged

WRONG_M = 1.0
"""Position error above which a pose is wrong."""

SURE_M = 0.5
"""Stated sigma below which a wrong pose misleads."""


UNTIL = "until taken"
"""Condition of the row over starts: of each, the shortest window whose pose is taken."""

LONG_S = 10.0
"""Length of the longest window that a start must have to count."""


@dataclass(frozen=True, kw_only=True)
class Key:
    """Group of an outcome."""

    set: str
    subject: str
    condition: str

    @classmethod
    def of(cls, trial: LocalizationTrial) -> "Key":
        """Return the group of the outcomes of `trial`."""
        return cls(set=trial.set, subject=trial.subject, condition=trial.condition)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Outcome of a solver on one trial."""

    key: Key
    solver: str
    solve_ms: float = math.nan
    """Processor time; NaN if unknown."""
    refused: str = ""
    """Reason of a refusal, or `""`."""
    position_m: float = math.nan
    """Horizontal error; after a refusal, of the best fit, if there is one."""
    yaw_deg: float = math.nan
    """Signed error; NaN if the truth is unknown."""
    position_sigma_m: float = math.nan
    """Stated sigma along the worse direction; NaN without one."""
    yaw_sigma_deg: float = math.nan
    is_sure: bool = True
    """True if the localizer would accept the pose with the stated sigma."""
    taken_m: float | None = None
    """Error of the pose that the running localizer takes, infinite without one. None of other solvers."""
    recording: str = ""
    start_s: float = 0.0
    """Recording of following, and start of the window in it."""
    bound_m: float = math.nan


def rows_of(outcomes: Sequence[Outcome]) -> list[Row]:
    """Return a row for each set, condition, subject and solver, and for all subjects of a set together."""
    groups = defaultdict[tuple[str, str, str, str], list[Outcome]](list)
    for outcome in outcomes:
        key = outcome.key
        for subject in (ALL, key.subject):
            groups[key.set, key.condition, subject, outcome.solver].append(outcome)
    return arranged(_row(*names, group) for names, group in groups.items())


def until_taken_rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """Return rows of people who follow a robot, over the starts of windows of several lengths."""
    starts = defaultdict[tuple[str, str, str], list[Outcome]](list)
    for outcome in outcomes:
        key = outcome.key
        if outcome.recording and outcome.taken_m is not None:
            for subject in (ALL, key.subject):
                starts[key.set, subject, outcome.solver].append(outcome)
    rows: list[Row] = []
    for names, group in starts.items():
        rows += _until_taken(*names, group)
    return rows


def _until_taken(name: str, subject: str, solver: str, outcomes: Sequence[Outcome]) -> Iterator[Row]:
    """Yield the row over the starts from which there are windows of `LONG_S`; each counts once."""
    # length and error of the windows by their start
    by_start = defaultdict[tuple[str, float], list[tuple[float, float]]](list)
    for outcome in outcomes:
        if outcome.taken_m is None:
            continue
        seconds, *_ = outcome.key.condition.split()
        window = (float(seconds), outcome.taken_m)
        by_start[outcome.recording, outcome.start_s].append(window)

    # the shortest window that is taken; both are infinite if none is
    first_taken: list[tuple[float, float]] = []
    for windows in by_start.values():
        longest_s, _ = max(windows)
        if longest_s < LONG_S:
            continue
        taken_windows = [window for window in windows if math.isfinite(window[1])]
        first_taken.append(min(taken_windows, default=(math.inf, math.inf)))
    if not first_taken:
        return

    # the median is infinite if most are never taken
    lengths_s = [length_s for length_s, _ in first_taken]
    errors_m = _finite(taken_m for _, taken_m in first_taken)
    until_s = float(np.median(lengths_s))
    yield Row(
        set=name,
        subject=subject,
        condition=UNTIL,
        solver=solver,
        n=len(first_taken),
        taken=len(errors_m) / len(first_taken),
        taken_m=MetricSpread.of(errors_m),
        until_taken_s=until_s if math.isfinite(until_s) else None,
    )


def _row(name: str, condition: str, subject: str, solver: str, outcomes: Sequence[Outcome]) -> Row:
    accepted = [outcome for outcome in outcomes if not outcome.refused]
    errors_m = np.array([outcome.position_m for outcome in accepted])
    all_errors_m = _finite(outcome.position_m for outcome in outcomes)
    yaw_errors_deg = _finite(outcome.yaw_deg for outcome in accepted)
    times_ms = _finite(outcome.solve_ms for outcome in outcomes)
    bounds_m = _finite(outcome.bound_m for outcome in accepted)
    bound_m = None
    if bounds_m:
        bound_m = float(np.median(bounds_m))
    row = Row(
        set=name,
        subject=subject,
        condition=condition,
        solver=solver,
        n=len(outcomes),
        position_m=MetricSpread.of(errors_m),
        every_m=MetricSpread.of(all_errors_m),
        yaw_deg=MetricSpread.of(yaw_errors_deg),
        share_above_1m=_share(errors_m > WRONG_M),
        refused=len(outcomes) - len(accepted),
        solve_ms=MetricSpread.of(times_ms),
        bound_m=bound_m,
    )
    row = _with_taken(row, outcomes)

    # what is stated: only of a solver that states a sigma of every pose
    states_sigmas = all(math.isfinite(outcome.position_sigma_m) for outcome in accepted)
    if accepted and states_sigmas:
        return _with_sigmas(row, accepted)
    return row


def _with_taken(row: Row, outcomes: Sequence[Outcome]) -> Row:
    """Return `row` with the figures of the poses that the running localizer takes."""
    # infinite where it refuses
    errors = [outcome.taken_m for outcome in outcomes if outcome.taken_m is not None]
    errors_m = np.array(errors)
    is_taken = np.isfinite(errors_m)
    taken_m = errors_m[is_taken]
    return replace(
        row,
        taken=_share(is_taken),
        taken_m=MetricSpread.of(taken_m),
        taken_above_1m=_share(taken_m > WRONG_M),
    )


def _with_sigmas(row: Row, accepted: Sequence[Outcome]) -> Row:
    """Return `row` with the figures of the stated standard deviations; `accepted` is not empty."""
    errors_m = np.array([outcome.position_m for outcome in accepted])
    sigmas_m = np.array([outcome.position_sigma_m for outcome in accepted])
    misleads = (errors_m > WRONG_M) & (sigmas_m < SURE_M)

    # of the yaw: only if the truth is known in all
    yaw_errors_deg = np.array([outcome.yaw_deg for outcome in accepted])
    yaw_sigmas_deg = np.array([outcome.yaw_sigma_deg for outcome in accepted])
    yaw_within_2_sigma = None
    if np.all(np.isfinite(yaw_errors_deg)):
        within = np.abs(yaw_errors_deg) <= 2.0 * yaw_sigmas_deg
        yaw_within_2_sigma = _share(within)
    return replace(
        row,
        misled=_share(misleads),
        within_2_sigma=_share(errors_m <= 2.0 * sigmas_m),
        yaw_within_2_sigma=yaw_within_2_sigma,
        unsure=sum(not outcome.is_sure for outcome in accepted),
    )


def _finite(values: Iterable[float]) -> list[float]:
    return [value for value in values if math.isfinite(value)]


def _share(hits: NDArray[np.bool_]) -> float | None:
    return float(np.mean(hits)) if len(hits) else None
