"""Predictors of a later hold's yaw from earlier anchors, and their errors beside plain re-anchoring."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
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
        actual = self.course.holds[self.told]
        return math.remainder(estimate.yaw_rad - actual.yaw_rad, math.tau)


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
    for sequence in sequences:
        predicted = sequence.nearest(known_s)
        nearest = {sequence.nearest(at_s) for at_s in anchors_s}
        anchors = tuple(sorted(nearest))
        since_first_s = sequence.holds[predicted].at_s - sequence.holds[0].at_s
        away_s = since_first_s - known_s
        is_near = abs(away_s) <= 0.25 * known_s
        if anchors[-1] < predicted and is_near:
            trials.append(DriftTrial(sequence, anchors, predicted))
    return trials


Solver = Callable[[HoldSequence, Sequence[int], int], YawEstimate]
"""Arguments: course, indices of the anchors (including 0, none the last), index of the hold to predict."""


def _raw(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    del anchors, known_holds
    return YawEstimate(holds.holds[0].yaw_rad)


def _re_anchored(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    del known_holds
    last = holds.holds[anchors[-1]]
    return YawEstimate(last.yaw_rad)


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
        stamp_ns=_ns(first.at_s),
    )
    drift = DriftFilter(fix, settings)
    eyes_m = (0.0, 0.0, EYE_M)

    # what is known before the hold to predict: its own rest is not
    for number, hold in enumerate(holds.holds[:known_holds]):
        if number in anchors[1:]:
            drift.update_anchor(
                _ns(hold.at_s), hold.target_m, eyes_m, hold.direction_h, spread_rad=hold.spread_rad
            )
        rest = hold.rest
        if rests and rest is not None:
            drift.update_rest_rate(
                rest.stamp_ns, rest.yaw_rate_radps, rest.sigma_radps, is_raised=rest.is_raised
            )
    predicted = holds.holds[known_holds]
    pose: DriftPose = drift.predict(_ns(predicted.at_s))
    return YawEstimate(pose.yaw_rad, pose.yaw_sigma_rad)


def _ns(at_s: float) -> int:
    return round(at_s * NS_PER_S)


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
    grid = _by_person(sizes, people)

    # whole people are drawn: the trials of one are not independent
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(names), size=(RESAMPLED, len(names)))
    samples = grid[:, drawn].reshape(2, RESAMPLED, -1)
    resampled = np.sort(samples)  # nan last

    # quantiles of the drawn people, each with their own number of trials
    intervals: list[Interval] = []
    for share in (0.5, 0.9):
        ours, others = np.quantile(sizes, share, axis=1)
        our_quantiles, other_quantiles = _quantiles(resampled, share)
        low, high = np.quantile(our_quantiles / other_quantiles, (0.025, 0.975))
        interval = Interval(value=float(ours / others), low=float(low), high=float(high))
        intervals.append(interval)
    return intervals[0], intervals[1]


def _by_person(sizes: Array, people: Sequence[str]) -> Array:
    """Return `sizes` (2 x n) as 2 x people x most trials of one, filled up with NaN."""
    names = dict.fromkeys(people)
    own_trials = [np.flatnonzero(np.array(people) == name) for name in names]
    most_trials = max(map(len, own_trials))
    grid = np.full((2, len(names), most_trials), np.nan)
    for person, trials in enumerate(own_trials):
        grid[:, person, : len(trials)] = sizes[:, trials]
    return grid


def _quantiles(values: Array, share: float) -> Array:
    """Return the quantile of each row (2 x m) of `values` (2 x m x n, sorted, NaN last) by interpolation.

    `np.nanquantile` does the same, but takes a row at a time.
    """
    last = np.isfinite(values).sum(axis=2, keepdims=True) - 1
    below, rest = np.divmod(share * last, 1.0)
    index = below.astype(np.int64)
    lower_index = np.minimum(index, last)
    upper_index = np.minimum(index + 1, last)
    lower = np.take_along_axis(values, lower_index, axis=2)
    upper = np.take_along_axis(values, upper_index, axis=2)
    quantiles = lower + rest * (upper - lower)
    return quantiles[:, :, 0]
