"""Yaw error of simulated people after three minutes of drift, with one anchor per minute."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pointit.geometry import vector
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.filter import DriftFilter
from pointit.services.localizer.drift.rest_detection import RestDetector
from pointit_lab.evaluation.pointing.drifting_person import DriftingPerson, DriftPersonModel
from pointit_lab.evaluation.recordings.row import ALL, Row, Spread

NAME = "simulated_drift"
ANCHORS_S = (60.0, 120.0)
"""Times of anchors after the localization at 0 s."""

TOLD_S = 180.0

TURNED = "3 min, 1 anchor/min, IMU turned"
"""Condition in which the IMU is turned on the arm between the two anchors; the bound is without the turn."""

WRONG_ANCHOR = "3 min, 1 anchor/min, wrong anchor"
"""Condition in which people point beside the lamp at the second anchor, as high; the bound is without it."""

BESIDE_RAD = math.radians(40.0)
"""By how much in both."""

NORMAL_MEDIAN, NORMAL_P90 = 0.6745, 1.6449
"""Quantiles of the absolute value of a standard normal variable."""

Outcome = dict[str, tuple[float, float | None]]
"""Error and stated sigma by solver, rad."""


def simulated_rows(people: int, ways: DriftPersonModel | None = None) -> list[Row]:
    """Return the rows of `people` simulated people, the same ones each time."""
    ways = ways if ways is not None else DriftPersonModel()
    rows: list[Row] = []
    after_s = (*ANCHORS_S, TOLD_S)
    for condition, anchors_s, how, beside_rad in (
        ("3 min, 1 anchor/min", ANCHORS_S, ways, 0.0),
        ("3 min, 1 anchor/min, after it", after_s, ways, 0.0),
        (
            "3 min, 1 anchor/min, 5° scatter",
            ANCHORS_S,
            replace(ways, azimuth_sigma_rad=math.radians(5.0)),
            0.0,
        ),
        (TURNED, ANCHORS_S, replace(ways, turned_rad=BESIDE_RAD), 0.0),
        (f"{TURNED}, after it", after_s, replace(ways, turned_rad=BESIDE_RAD), 0.0),
        (WRONG_ANCHOR, ANCHORS_S, ways, BESIDE_RAD),
        (f"{WRONG_ANCHOR}, after it", after_s, ways, BESIDE_RAD),
    ):
        outcomes = [outcome(seed, how, anchors_s, beside_rad) for seed in range(people)]
        for solver in outcomes[0]:
            mine = [one[solver] for one in outcomes]
            inside = [abs(error) <= 2.0 * sigma for error, sigma in mine if sigma is not None]
            rows.append(
                Row(
                    set=NAME,
                    subject=ALL,
                    condition=condition,
                    solver=solver,
                    n=people,
                    yaw_deg=Spread.of(math.degrees(error) for error, _ in mine),
                    yaw_within_2_sigma=float(np.mean(inside)) if inside else None,
                )
            )
        rows.append(normal_row(NAME, condition, "bound", people, bound_rad(how, anchors_s)))
    return rows


def outcome(seed: int, ways: DriftPersonModel, anchors_s: Sequence[float], jump_rad: float = 0.0) -> Outcome:
    """Return the yaw error of each solver at `TOLD_S`.

    Args:
        seed: seed of the person.
        ways: model of people and IMUs.
        anchors_s: times at which they point at a lamp.
        jump_rad: error of the second anchor.
    """
    person = DriftingPerson(seed, ways, TOLD_S)
    fix = person.fix()
    plain, rested = DriftFilter(fix), DriftFilter(fix)
    told = [(0.0, fix.yaw_rad)]
    for number, at_s in enumerate(anchors_s):
        stillness = RestDetector()
        samples = person.rest(at_s - ways.rest_s - 1.0)
        for rest in (*(stillness.add(*sample) for sample in samples), stillness.end()):
            if rest is not None:
                rested.update_rest_rate(
                    rest.stamp_ns, rest.yaw_rate_radps, rest.sigma_radps, is_raised=rest.is_raised
                )
        target, direction = person.pointing(at_s, jump_rad if number == 1 else 0.0)
        for drift in (plain, rested):
            drift.update_anchor(
                round(at_s * NS_PER_S), target, (0.0, 0.0, ways.eye_m), direction,
                spread_rad=ways.hold_yaw_sigma_rad, samples=50,
            )  # fmt: skip
        seen = vector.azimuth((target[0] - fix.x_m, target[1] - fix.y_m, 0.0))
        told.append((at_s, seen - vector.azimuth(direction)))
    (first_s, first), (last_s, last) = told[0], told[-1]
    pose, better = (drift.predict(round(TOLD_S * NS_PER_S)) for drift in (plain, rested))
    truth = person.yaw_rad(TOLD_S)
    rate = math.remainder(last - first, math.tau) / (last_s - first_s)
    return {
        "raw": (_wrap(first - truth), None),
        "re-anchored": (_wrap(last - truth), None),
        "re-anchored, constant rate": (_wrap(last + rate * (TOLD_S - last_s) - truth), None),
        "pointit": (_wrap(pose.yaw_rad - truth), pose.yaw_sigma_rad),
        "pointit, rests": (_wrap(better.yaw_rad - truth), better.yaw_sigma_rad),
    }


def bound_rad(ways: DriftPersonModel, anchors_s: Sequence[float]) -> float:
    """Return one sigma of the best estimate of the yaw at `TOLD_S` without rests (Cramér and Rao).

    For a constant rate with the prior of IMUs, and anchors with independent errors. Rate walk, bent arms
    and an unknown position would increase it.
    """
    information = np.diag([1.0 / ways.start_sigma_rad**2, 1.0 / ways.rate_sigma_radps**2])
    for at_s in anchors_s:
        slope = np.array([1.0, at_s])
        information += np.outer(slope, slope) / ways.azimuth_sigma_rad**2
    slope = np.array([1.0, TOLD_S])
    return math.sqrt(float(slope @ np.linalg.solve(information, slope)))


def normal_row(name: str, condition: str, solver: str, n: int, sigma_rad: float) -> Row:
    """Return the row of errors that are normal with `sigma_rad`."""
    sigma = math.degrees(sigma_rad)
    return Row(
        set=name,
        subject=ALL,
        condition=condition,
        solver=solver,
        n=n,
        yaw_deg=Spread(median=NORMAL_MEDIAN * sigma, p90=NORMAL_P90 * sigma, rms=sigma),
    )


def _wrap(angle_rad: float) -> float:
    return math.remainder(angle_rad, math.tau)
