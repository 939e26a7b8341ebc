"""Predictors of a later hold's yaw from earlier anchors, and their errors beside plain re-anchoring."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry import vector
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.filter import DriftFilter, DriftPose, DriftSettings, Fix
from pointit_lab.evaluation.pointing.drift_courses import EYE_M, HoldSequence
from pointit_lab.evaluation.selection.difference import Interval

PLACE_SIGMA_M = 0.05
"""Sigma of the recorded people's position."""

PLAIN = "re-anchored"
"""Solver whose yaw is that of the last anchor."""

RESAMPLED = 1000
"""Number of bootstrap samples; people are drawn, with all their trials (Efron 1979)."""

MIN_PEOPLE = 3
"""Smallest number of people for an interval."""


@dataclass(frozen=True)
class YawEstimate:
    """Prediction of a later hold's yaw."""

    yaw_rad: float
    sigma_rad: float | None = None


@dataclass(frozen=True)
class DriftTrial:
    """A later hold's yaw is to be predicted."""

    course: HoldSequence
    anchors: tuple[int, ...]
    """Indices of the anchors, including 0."""
    told: int
    """Index of the hold to predict."""

    def error_rad(self, estimate: YawEstimate) -> float:
        """Return the error of a prediction."""
        return math.remainder(estimate.yaw_rad - self.course.holds[self.told].yaw_rad, math.tau)


def predictable(
    sequences: Sequence[HoldSequence], anchors_s: Sequence[float], known_s: float
) -> list[DriftTrial]:
    """Return the trials of sequences that have a hold near `known_s` and the anchors before it.

    Args:
        sequences: sequences.
        anchors_s: times of the anchors after the first hold.
        known_s: time of the hold to predict.
    """
    trials: list[DriftTrial] = []
    for holds in sequences:
        known_holds = holds.nearest(known_s)
        anchors = tuple(sorted({holds.nearest(at_s) for at_s in anchors_s}))
        known_hold = holds.holds[known_holds]
        away_s = known_hold.at_s - holds.holds[0].at_s - known_s
        if anchors[-1] < known_holds and abs(away_s) <= 0.25 * known_s:
            trials.append(DriftTrial(holds, anchors, known_holds))
    return trials


Solver = Callable[[HoldSequence, Sequence[int], int], YawEstimate]
"""Arguments: course, indices of the anchors (including 0, none the last), index of the hold to predict."""


def _raw(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    del anchors, known_holds
    return YawEstimate(holds.holds[0].yaw_rad)


def _re_anchored(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    del known_holds
    return YawEstimate(holds.holds[anchors[-1]].yaw_rad)


def _filter(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    return filtered(holds, anchors, known_holds, DriftSettings(), rests=False)


def _filter_and_rests(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    return filtered(holds, anchors, known_holds, DriftSettings())


def filtered(
    holds: HoldSequence,
    anchors: Sequence[int],
    known_holds: int,
    settings: DriftSettings,
    *,
    rests: bool = True,
) -> YawEstimate:
    """Return the prediction of `DriftFilter` with these settings, with or without rests."""
    # the first hold fixes the yaw; an azimuth is less certain if the ray is steep
    first = holds.holds[0]
    level = math.cos(vector.elevation(first.direction_h))
    sigmas = [PLACE_SIGMA_M, PLACE_SIGMA_M, settings.anchor_sigma_rad / level]
    fix = Fix(
        x_m=0.0,
        y_m=0.0,
        yaw_rad=first.yaw_rad,
        covariance=np.diag(sigmas) ** 2,
        stamp_ns=round(first.at_s * NS_PER_S),
    )
    drift = DriftFilter(fix, settings)
    eyes_m = (0.0, 0.0, EYE_M)

    # what is known before the hold to predict: its own rest is not
    for number, hold in enumerate(holds.holds[:known_holds]):
        if number in anchors[1:]:
            at_ns = round(hold.at_s * NS_PER_S)
            drift.update_anchor(
                at_ns,
                hold.target_m,
                eyes_m,
                hold.direction_h,
                spread_rad=hold.spread_rad,
            )
        rest = hold.rest
        if rests and rest is not None:
            drift.update_rest_rate(
                rest.stamp_ns, rest.yaw_rate_radps, rest.sigma_radps, is_raised=rest.is_raised
            )
    predicted_s = holds.holds[known_holds].at_s
    pose: DriftPose = drift.predict(round(predicted_s * NS_PER_S))
    return YawEstimate(pose.yaw_rad, pose.yaw_sigma_rad)


SOLVERS: dict[str, Solver] = {
    "raw": _raw,
    "re-anchored": _re_anchored,
    "pointit": _filter,
    "pointit, rests": _filter_and_rests,
}
"""Predictors by name; `raw` sets the yaw once at the start."""


def ratios(
    people: Sequence[str], errors: Sequence[float], plain: Sequence[float]
) -> tuple[Interval, Interval] | None:
    """Return the ratios of median and of p90 with 95 % intervals, or None of fewer than `MIN_PEOPLE`.

    Args:
        people: n names, who each trial is of.
        errors: n yaw errors.
        plain: n yaw errors of `PLAIN` in the same trials.
    """
    names = list(dict.fromkeys(people))
    if len(names) < MIN_PEOPLE:
        return None
    # absolute errors, 2 x people x their trials, filled up with NaN
    sizes = np.abs(np.array([errors, plain], dtype=np.float64))
    trials = [np.flatnonzero(np.array(people) == name) for name in names]
    most_trials = max(map(len, trials))
    grid = np.full((2, len(names), most_trials), np.nan)
    for row, own_trials in enumerate(trials):
        grid[:, row, : len(own_trials)] = sizes[:, own_trials]

    # whole people are drawn: the trials of one are not independent
    drawn = np.random.default_rng(0).integers(len(names), size=(RESAMPLED, len(names)))
    resampled = np.sort(grid[:, drawn].reshape(2, RESAMPLED, -1))  # nan last
    last = np.isfinite(resampled).sum(axis=2, keepdims=True) - 1

    # quantiles of the drawn people, each with their own number of trials
    intervals: list[Interval] = []
    for share in (0.5, 0.9):
        ours, others = np.quantile(sizes, share, axis=1)
        below, rest = np.divmod(share * last, 1.0)  # as `np.nanquantile` does, which takes a row at a time
        lower_index = np.minimum(below.astype(np.int64), last)
        upper_index = np.minimum(below.astype(np.int64) + 1, last)
        lower = np.take_along_axis(resampled, lower_index, axis=2)[:, :, 0]
        upper = np.take_along_axis(resampled, upper_index, axis=2)[:, :, 0]
        quantiles = lower + rest[:, :, 0] * (upper - lower)
        low, high = np.quantile(quantiles[0] / quantiles[1], (0.025, 0.975))
        intervals.append(Interval(value=float(ours / others), low=float(low), high=float(high)))
    return intervals[0], intervals[1]
