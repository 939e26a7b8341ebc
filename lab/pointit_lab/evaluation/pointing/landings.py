"""Landings of people whose yaw does not drift (`vr_arm_pointing`: arms are tracked exactly), and elevations.

Each person points `SERIES` times, 8 s apart, in the recorded order. Their pose is that of the first
`LOCALIZED` pointings and does not change, or each further pointing corrects it as a landing. The error is
that of the next pointing's azimuth. Nobody sees a cursor, so the end of an act stands for its landing.

The pitch error is that of the next landing, with the mean of the last landings as bias, from 0 on, as the
localizer learns it; also of `proximity_feedback`, whose people point at the floor.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.filter import DriftFilter, DriftSettings, Fix
from pointit.services.localizer.tracking import MAX_ERROR_RAD, MAX_LANDINGS, SIGMA_RAD
from pointit_lab.evaluation.datasets import proximity_feedback
from pointit_lab.evaluation.datasets.proximity_feedback import read_floor_trials
from pointit_lab.evaluation.datasets.vr_arm_pointing import FILE, NAME, RecordedActs, read_acts
from pointit_lab.evaluation.localization.trial import Array
from pointit_lab.evaluation.pointing.drift_courses import EYE_M, HoldSequence, courses
from pointit_lab.evaluation.pointing.drift_solvers import PLACE_SIGMA_M
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row

SERIES = 15
LOCALIZED = 4
PERIOD_NS = 8 * NS_PER_S
CONDITION = f"no drift, {SERIES - LOCALIZED} pointings after {LOCALIZED}"
SOLVERS = ("raw", "landings")
ReachErrors = tuple[float, float, float, float]
"""Errors of a pointing: of the yaw without and with landings, then of the elevation, rad. NaN if unknown."""


def landing_rows(data: Path) -> list[Row]:
    """Return rows for each person and for all. A set without recordings has none.

    Raises:
        ConfigError: If a recording is damaged.
    """
    path, floor = data / NAME / FILE, data / proximity_feedback.NAME
    rows: list[Row] = []
    if path.is_file():
        rows += _rows(NAME, CONDITION, {acts.subject: list(_errors(acts)) for acts in read_acts(path)})
    if floor.is_dir():
        holds: dict[str, list[float]] = {}
        for course in courses(read_floor_trials(floor)):
            holds.setdefault(course.subject, []).extend(_landing_errors(course))
        people = {
            subject: [(math.nan, math.nan, *both) for both in _pitch_errors(errors)]
            for subject, errors in holds.items()
        }
        rows += _rows(proximity_feedback.NAME, "landings in their order", people)
    return rows


def _rows(name: str, condition: str, people: Mapping[str, list[ReachErrors]]) -> list[Row]:
    groups = [*people.items(), (ALL, [each for errors in people.values() for each in errors])]
    return [
        Row(
            set=name,
            subject=subject,
            condition=condition,
            solver=solver,
            n=len(errors),
            yaw_deg=MetricSpread.of(
                math.degrees(each[index]) for each in errors if each[index] == each[index]
            ),
            pitch_deg=MetricSpread.of(math.degrees(each[2 + index]) for each in errors),
        )
        for subject, errors in groups
        if errors
        for index, solver in enumerate(SOLVERS)
    ]


def _landing_errors(sequence: HoldSequence) -> Iterator[float]:
    """Yield how far landings are above their targets on the floor, rad; only those that are pointings."""
    for hold in sequence.holds:
        if (landing := hold.landing_mean) is not None:
            target_rad = math.atan2(-EYE_M, math.hypot(*hold.target_m[:2]))
            error_rad = vector.elevation(landing.direction) - target_rad
            if abs(error_rad) <= MAX_ERROR_RAD:
                yield error_rad


def _pitch_errors(errors: Iterable[float]) -> Iterator[tuple[float, float]]:
    """Yield each elevation error, rad, and what is left of it with the bias learned from those before."""
    bias_rad = 0.0
    for number, error_rad in enumerate(errors, 2):
        yield error_rad, error_rad - bias_rad
        if abs(error_rad - bias_rad) <= MAX_ERROR_RAD:
            bias_rad += (error_rad - bias_rad) / min(number, MAX_LANDINGS)


def _errors(acts: RecordedActs) -> Iterator[ReachErrors]:
    """Yield the errors of pointings."""
    ways = acts.targets_m[:, :2] - acts.heads_m
    azimuths = np.arctan2(acts.directions[:, 1], acts.directions[:, 0])
    away_m, below_m = np.hypot(ways[:, 0], ways[:, 1]), acts.origins_m[:, 2] - acts.targets_m[:, 2]
    rises = np.arcsin(acts.directions[:, 2]) + np.arctan2(below_m, away_m)
    yaws = np.arctan2(ways[:, 1], ways[:, 0]) - azimuths
    for begin in range(0, len(yaws) - LOCALIZED, SERIES):
        first = yaws[begin : begin + LOCALIZED]
        fixed_rad = float(first[0] + np.median(np.remainder(first - first[0] + math.pi, math.tau) - math.pi))
        drift = _drift_filter(acts.heads_m[begin : begin + SERIES].mean(axis=0).tolist(), fixed_rad)
        indices = range(begin + LOCALIZED, min(begin + SERIES, len(yaws)))
        pitches = list(_pitch_errors(rises[indices]))
        for number, index in enumerate(indices):
            stamp_ns = (number + 1) * PERIOD_NS
            tracked_rad = drift.predict(stamp_ns).yaw_rad
            truth_rad = float(yaws[index])
            yield (
                math.remainder(fixed_rad - truth_rad, math.tau),
                math.remainder(tracked_rad - truth_rad, math.tau),
                *pitches[number],
            )
            target_m, origin_m, direction = (
                _vector(each[index]) for each in (acts.targets_m, acts.origins_m, acts.directions)
            )
            drift.update_anchor(stamp_ns, target_m, origin_m, direction, sigma_rad=SIGMA_RAD)


def _vector(row: Array) -> Vec3:
    x, y, z = row.tolist()
    return x, y, z


def _drift_filter(position_m: list[float], yaw_rad: float) -> DriftFilter:
    settings = DriftSettings()
    sigmas = np.array([PLACE_SIGMA_M, PLACE_SIGMA_M, settings.anchor_sigma_rad])
    x_m, y_m = position_m
    fix = Fix(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, covariance=np.diag(sigmas**2), stamp_ns=0)
    return DriftFilter(fix, settings)
