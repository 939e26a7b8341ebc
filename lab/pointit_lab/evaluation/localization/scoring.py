"""From solved trials to rows of the table."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

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
    groups: dict[tuple[str, str, str, str], list[Outcome]] = {}
    for outcome in outcomes:
        key = outcome.key
        for subject in (ALL, key.subject):
            groups.setdefault((key.set, key.condition, subject, outcome.solver), []).append(outcome)
    return arranged(_row(*names, group) for names, group in groups.items())


def until_taken_rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """Return rows of people who follow a robot, over the starts of windows of several lengths."""
    starts: dict[tuple[str, str, str], list[Outcome]] = {}
    for outcome in outcomes:
        if outcome.recording and outcome.taken_m is not None:
            for subject in (ALL, outcome.key.subject):
                starts.setdefault((outcome.key.set, subject, outcome.solver), []).append(outcome)
    return [row for names, group in starts.items() for row in _until_taken(*names, group)]


def _until_taken(name: str, subject: str, solver: str, outcomes: Sequence[Outcome]) -> Iterator[Row]:
    """Yield the row over the starts from which there are windows of `LONG_S`; each counts once."""
    by_start: dict[tuple[str, float], list[tuple[float, float]]] = {}
    for outcome in outcomes:
        length_s = float(outcome.key.condition.split()[0])
        taken_m = outcome.taken_m
        if taken_m is not None:
            by_start.setdefault((outcome.recording, outcome.start_s), []).append((length_s, taken_m))
    long = [of_start for of_start in by_start.values() if max(of_start)[0] >= LONG_S]
    if not long:
        return
    first = [
        min((each for each in of_start if math.isfinite(each[1])), default=(math.inf, math.inf))
        for of_start in long
    ]
    until_s = float(np.median([length_s for length_s, _ in first]))
    found = [taken_m for _, taken_m in first if math.isfinite(taken_m)]
    yield Row(
        set=name,
        subject=subject,
        condition=UNTIL,
        solver=solver,
        n=len(first),
        taken=len(found) / len(first),
        taken_m=MetricSpread.of(found),
        until_taken_s=until_s if math.isfinite(until_s) else None,
    )


def _row(name: str, condition: str, subject: str, solver: str, outcomes: Sequence[Outcome]) -> Row:
    accepted = [outcome for outcome in outcomes if not outcome.refused]
    errors = np.array([outcome.position_m for outcome in accepted])
    everything = np.array([outcome.position_m for outcome in outcomes])
    sigmas = np.array([outcome.position_sigma_m for outcome in accepted])
    turned = np.array([outcome.yaw_deg for outcome in accepted])
    yaw_sigmas = np.array([outcome.yaw_sigma_deg for outcome in accepted])
    bounds = [outcome.bound_m for outcome in accepted if math.isfinite(outcome.bound_m)]
    takes = np.array([outcome.taken_m for outcome in outcomes if outcome.taken_m is not None])
    taken_m = takes[np.isfinite(takes)]
    states = len(accepted) > 0 and bool(np.all(np.isfinite(sigmas)))
    return Row(
        set=name,
        subject=subject,
        condition=condition,
        solver=solver,
        n=len(outcomes),
        position_m=MetricSpread.of(errors),
        every_m=MetricSpread.of(everything[np.isfinite(everything)]),
        yaw_deg=MetricSpread.of(turned[np.isfinite(turned)]),
        share_above_1m=_share(errors > WRONG_M),
        misled=float(np.sum((errors > WRONG_M) & (sigmas < SURE_M))) / len(accepted) if states else None,
        within_2_sigma=_share(errors <= 2.0 * sigmas) if states else None,
        yaw_within_2_sigma=_share(np.abs(turned) <= 2.0 * yaw_sigmas)
        if states and np.all(np.isfinite(turned))
        else None,
        refused=len(outcomes) - len(accepted),
        taken=_share(np.isfinite(takes)),
        taken_m=MetricSpread.of(taken_m),
        taken_above_1m=_share(taken_m > WRONG_M),
        unsure=sum(not outcome.is_sure for outcome in accepted) if states else None,
        solve_ms=MetricSpread.of(outcome.solve_ms for outcome in outcomes if math.isfinite(outcome.solve_ms)),
        bound_m=float(np.median(bounds)) if bounds else None,
    )


def _share(hits: NDArray[np.bool_]) -> float | None:
    return float(np.mean(hits)) if len(hits) else None
