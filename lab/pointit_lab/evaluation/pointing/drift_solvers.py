"""Predictors of a later hold's yaw from earlier anchors: the filter, and simpler baselines."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry import vector
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.filter import DriftFilter, DriftPose, DriftSettings, Fix
from pointit_lab.evaluation.pointing.drift_courses import EYE_M, HoldSequence

PLACE_SIGMA_M = 0.05
"""Sigma of the recorded people's position."""


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
        away_s = holds.holds[known_holds].at_s - holds.holds[0].at_s - known_s
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


def _rate_of_holds(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    last = holds.holds[anchors[-1]]
    rate = float(np.mean([hold.rate_radps for hold in holds.holds[:known_holds]]))
    return YawEstimate(last.yaw_rad + rate * (holds.holds[known_holds].at_s - last.at_s))


def _constant_rate(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    first, last = holds.holds[0], holds.holds[anchors[-1]]
    if first is last:
        return YawEstimate(last.yaw_rad)
    rate = math.remainder(last.yaw_rad - first.yaw_rad, math.tau) / (last.at_s - first.at_s)
    return YawEstimate(last.yaw_rad + rate * (holds.holds[known_holds].at_s - last.at_s))


def _filter(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    return filtered(holds, anchors, known_holds, DriftSettings(), rests=False)


def _filter_and_rests(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    return filtered(holds, anchors, known_holds, DriftSettings())


def _filter_and_landings(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    return filtered(holds, anchors[:1], known_holds, DriftSettings(), landings=True)


def _filter_and_first(holds: HoldSequence, anchors: Sequence[int], known_holds: int) -> YawEstimate:
    return filtered(holds, anchors[:1], known_holds, DriftSettings())


def filtered(
    holds: HoldSequence,
    anchors: Sequence[int],
    known_holds: int,
    settings: DriftSettings,
    *,
    rests: bool = True,
    landings: bool = False,
) -> YawEstimate:
    """Return the prediction of `DriftFilter` with these settings, with or without rests and landings.

    Landings are those of the holds between the first and the predicted one.
    """
    first = holds.holds[0]
    level = math.cos(vector.elevation(first.direction_h))
    drift = DriftFilter(
        Fix(
            x_m=0.0,
            y_m=0.0,
            yaw_rad=first.yaw_rad,
            covariance=np.diag([PLACE_SIGMA_M, PLACE_SIGMA_M, settings.anchor_sigma_rad / level]) ** 2,
            stamp_ns=round(first.at_s * NS_PER_S),
        ),
        settings,
    )
    for number, hold in enumerate(holds.holds[:known_holds]):
        if number in anchors[1:]:
            drift.update_anchor(
                round(hold.at_s * NS_PER_S),
                hold.target_m,
                (0.0, 0.0, EYE_M),
                hold.direction_h,
                spread_rad=hold.spread_rad,
                samples=hold.samples,
            )
        landing = hold.landing_mean
        if landings and number and landing is not None:
            drift.update_anchor(
                landing.stamp_ns,
                hold.target_m,
                landing.origin_m,
                landing.direction,
                spread_rad=landing.spread_rad,
                sigma_rad=landing.sigma_rad,
                samples=landing.samples,
            )
        rest = hold.rest
        if rests and rest is not None:
            drift.update_rest_rate(
                rest.stamp_ns, rest.yaw_rate_radps, rest.sigma_radps, is_raised=rest.is_raised
            )
    pose: DriftPose = drift.predict(round(holds.holds[known_holds].at_s * NS_PER_S))
    return YawEstimate(pose.yaw_rad, pose.yaw_sigma_rad)


SOLVERS: dict[str, Solver] = {
    "raw": _raw,
    "re-anchored": _re_anchored,
    "re-anchored, rate of holds": _rate_of_holds,
    "re-anchored, constant rate": _constant_rate,
    "pointit": _filter,
    "pointit, rests": _filter_and_rests,
    "pointit, first anchor, rests": _filter_and_first,
    "pointit, first anchor, rests, landings": _filter_and_landings,
}
"""Predictors by name; `raw` sets the yaw once at the start. Landings are anchors in place of later holds."""
