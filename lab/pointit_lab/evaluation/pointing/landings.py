"""Landings as anchors for people whose yaw does not drift: `vr_arm_pointing`, whose arms are tracked exactly.

Each person points `SERIES` times, 8 s apart, in the recorded order. Their pose is that of the first
`LOCALIZED` pointings and does not change, or each further pointing corrects it as a landing. The error is
that of the next pointing's azimuth. Nobody sees a cursor, so the end of an act stands for its landing.
"""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.filter import DriftFilter, DriftSettings, Fix
from pointit.services.localizer.tracking.landing import SIGMA_RAD
from pointit_lab.evaluation.datasets.vr_arm_pointing import FILE, NAME, RecordedActs, read_acts
from pointit_lab.evaluation.localization.trial import Array
from pointit_lab.evaluation.pointing.drift_solvers import PLACE_SIGMA_M
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row

SERIES = 15
LOCALIZED = 4
PERIOD_NS = 8 * NS_PER_S
CONDITION = f"no drift, {SERIES - LOCALIZED} pointings after {LOCALIZED}"
SOLVERS = ("raw", "landings")


def landing_rows(data: Path) -> list[Row]:
    """Return rows for each person and for all; none if there are no recordings.

    Raises:
        ConfigError: If the recording is damaged.
    """
    path = data / NAME / FILE
    people = {acts.subject: list(_errors(acts)) for acts in read_acts(path)} if path.is_file() else {}
    rows = [*people.items(), (ALL, [each for errors in people.values() for each in errors])]
    return [
        Row(
            set=NAME,
            subject=subject,
            condition=CONDITION,
            solver=solver,
            n=len(errors),
            yaw_deg=MetricSpread.of(math.degrees(each[index]) for each in errors),
        )
        for subject, errors in rows
        if errors
        for index, solver in enumerate(SOLVERS)
    ]


def _errors(acts: RecordedActs) -> Iterator[tuple[float, float]]:
    """Yield the azimuth errors of pointings, rad, without and with landings."""
    ways = acts.targets_m[:, :2] - acts.heads_m
    azimuths = np.arctan2(acts.directions[:, 1], acts.directions[:, 0])
    yaws = np.arctan2(ways[:, 1], ways[:, 0]) - azimuths
    for begin in range(0, len(yaws) - LOCALIZED, SERIES):
        first = yaws[begin : begin + LOCALIZED]
        fixed_rad = float(first[0] + np.median(np.remainder(first - first[0] + math.pi, math.tau) - math.pi))
        drift = _drift_filter(acts.heads_m[begin : begin + SERIES].mean(axis=0).tolist(), fixed_rad)
        for number, index in enumerate(range(begin + LOCALIZED, min(begin + SERIES, len(yaws)))):
            stamp_ns = (number + 1) * PERIOD_NS
            tracked_rad = drift.predict(stamp_ns).yaw_rad
            truth_rad = float(yaws[index])
            yield (
                math.remainder(fixed_rad - truth_rad, math.tau),
                math.remainder(tracked_rad - truth_rad, math.tau),
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
