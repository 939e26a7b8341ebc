"""Innovation slopes: how far a pointing or a rest shows the drift of the IMU.

The innovation is what a measurement adds to the state: the azimuth of the target minus that of the ray. It
tells the yaw if it grows by 1 with the yaw's error, here the innovation of the same trial's hold without a
cursor. People who steer a cursor onto the target keep it at 0, whatever the drift. A rest tells the rate if
its rate grows by 1 with that of the yaw between the holds beside it. `yaw °` is the scatter about the line
(of a rest: °/s), which is Theil's and Sen's, since IMUs jump.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import theilslopes

from pointit_lab.evaluation.datasets import proximity_feedback
from pointit_lab.evaluation.datasets.proximity_feedback import FloorTrial, Phase, Stretch
from pointit_lab.evaluation.pointing.drift_courses import HoldSequence
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row

Array = NDArray[np.float64]

SMOOTH_S = 0.18
"""Length of the moving average of azimuths."""
REACH_RADPS = math.radians(20.0)
"""Slowest peak of a reach."""
PEAK_S = 0.5
"""Time in which a reach peaks after it has begun."""
STOPPED = 0.2
"""Share of its peak speed below which a reach has ended."""

POINTED: tuple[tuple[str, Phase], ...] = (
    ("first stop without a cursor", "open_loop_reach"),
    ("first stop with a cursor", "feedback_reach"),
    ("hold with a cursor", "feedback_hold"),
)
"""Kinds of pointing, and the phase that has them."""
RESTED = "rest"


def innovation_rows(trials: Sequence[FloorTrial], sequences: Sequence[HoldSequence]) -> list[Row]:
    """Return a row for each kind of measurement, over all people.

    Args:
        trials: of all people.
        sequences: the same as sequences of holds.
    """
    rows: list[Row] = []
    for condition, phase in POINTED:
        both = [
            (_innovation_rad(trial, trial.phases["open_loop_hold"]), _innovation_rad(trial, stretch, phase))
            for trial in trials
            if "open_loop_hold" in trial.phases and (stretch := trial.phases.get(phase)) is not None
        ]
        rows += _slope_row(condition, both)
    return rows + _slope_row(RESTED, _rests(sequences))


def _slope_row(condition: str, both: Sequence[tuple[float, float]]) -> list[Row]:
    if len(both) < 3:
        return []
    true, seen = np.array(both).T
    slope, intercept, lower, upper = theilslopes(seen, true)
    return [
        Row(
            set=proximity_feedback.NAME,
            subject=ALL,
            condition=condition,
            solver="innovation",
            n=len(both),
            slope=float(slope),
            slope_sigma=0.25 * float(upper - lower),
            yaw_deg=MetricSpread.of(np.degrees(seen - intercept - slope * true)),
        )
    ]


def _innovation_rad(trial: FloorTrial, stretch: Stretch, phase: Phase = "open_loop_hold") -> float:
    """Return the target's azimuth minus the ray's: the median of a hold, or where a reach first stops."""
    azimuths = np.unwrap(np.arctan2(stretch.points_m[:, 1], stretch.points_m[:, 0]))
    azimuth = float(np.median(azimuths))
    if phase.endswith("reach"):
        azimuth = _first_stop_rad(stretch.times_s, azimuths)
    x, y = trial.target_m
    return math.remainder(math.atan2(y, x) - azimuth, math.tau)


def _first_stop_rad(times_s: Array, azimuths: Array) -> float:
    """Return the azimuth at which the first reach ends; the first azimuth if there is none."""
    step_s = float(np.median(np.diff(times_s)))
    count = max(1, round(SMOOTH_S / step_s)) | 1
    padded = np.pad(azimuths, count // 2, "edge")
    smooth = np.convolve(padded, np.full(count, 1.0 / count), "valid")
    speed = np.abs(np.gradient(smooth, step_s))
    fast = np.flatnonzero(speed > REACH_RADPS)
    if not len(fast):
        return float(smooth[0])
    begun = int(fast[0])
    peak = begun + int(np.argmax(speed[begun : begun + round(PEAK_S / step_s)]))
    return float(smooth[peak + int(np.argmax(speed[peak:] < STOPPED * speed[peak]))])


def _rests(sequences: Sequence[HoldSequence]) -> list[tuple[float, float]]:
    """Return rates of the yaw between two holds and of the rests in them, rad/s."""
    found: list[tuple[float, float]] = []
    for run in sequences:
        for before, after in pairwise(run.holds):
            turned = math.remainder(after.yaw_rad - before.yaw_rad, math.tau)
            rate = turned / (after.at_s - before.at_s)
            found += [(rate, rest.yaw_rate_radps) for rest in (before.rest, after.rest) if rest]
    return found
