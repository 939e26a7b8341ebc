"""Rate at which one of two robots is identified, by simulated people and by recorded ones (pointing.md §4).

The robot is followed for some seconds beside another one. With a pose, the live identification of the service
`goal` decides; without, the fit of the localizer, as in the published comparison.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from scipy import stats

from pointit.schemas import NS_PER_S, PointingRay, UserPose
from pointit.services.goal.robot_choice import RobotIdentifier
from pointit.services.localizer.estimation.estimator import Pointings, SolverSettings, solve
from pointit.services.localizer.moving_target import MEANT as MEANT_FROM
from pointit.services.localizer.moving_target import rank_by_posterior
from pointit_lab.evaluation.localization.trial import LocalizationTrial
from pointit_lab.evaluation.recordings.row import ALL
from pointit_lab.evaluation.robots.simulated_follower import RATE_HZ, Array, Course, SimulatedFollower
from pointit_lab.evaluation.selection.difference import Interval

Method = Literal["with a pose", "without a pose"]

SECONDS = (2.0, 3.0)
"""Evaluated durations."""

POSITION_SIGMA_M = 0.15
YAW_SIGMA_RAD = math.radians(4.0)
"""Errors of the pose that is given to the identification, drawn and stated."""

NEAREST_M, FARTHEST_M, APART_M = 1.5, 4.0, 1.0
"""Distances of simulated robots from the person, and the smallest between two on the floor."""

RADIUS_M, TURN_RADPS = 0.7, 0.7
"""Circle of a simulated robot that moves."""

REPORT_HZ = 10.0
"""Rate of a robot's reports."""

BEGIN_NS = 1000 * NS_PER_S

INTENDED, OTHER = "meant", "other"


@dataclass(frozen=True, kw_only=True)
class IdentificationResult:
    """Result of one pointing at one of two robots."""

    set: str
    subject: str
    condition: str
    method: Method
    probability: float
    """That the robot that is pointed at is meant, as one of the two is."""
    is_right: bool
    """It is the likeliest one."""
    chosen: Literal["right", "wrong", "none"]
    """Result with the required certainty."""


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Rates of one condition, with 95 % intervals (Wilson)."""

    set: str
    subject: str
    condition: str
    method: Method
    n: int
    right: Interval
    """The robot pointed at is the likeliest."""
    chosen: Interval
    """It is chosen, with the required certainty."""
    wrong: Interval
    """The other one is."""

    def as_json(self) -> dict[str, Any]:
        """Return the row for a JSON file."""
        return asdict(self)


def simulated_results(seeds: Iterable[int], seconds: Sequence[float] = SECONDS) -> list[IdentificationResult]:
    """Return the results of simulated people, one a seed and condition, of robots at rest and moving."""
    return [
        _simulated(seed, duration_s, moves=moves)
        for seed in seeds
        for duration_s in seconds
        for moves in (False, True)
    ]


def recorded_results(
    trials: Sequence[LocalizationTrial], seconds: Sequence[float] = SECONDS
) -> list[IdentificationResult]:
    """Return the results of recorded people, whose true robot flies beside that of another recording.

    Windows do not overlap, and the other robot is that of the same time in another person's recording, or in
    another recording if the set has one person. Nothing is fitted to the recordings.
    """
    results: list[IdentificationResult] = []
    for duration_s in seconds:
        name = f"{duration_s:g} s"
        alike = _apart([trial for trial in trials if trial.condition == name], duration_s)
        for number, trial in enumerate(alike):
            others = [each for each in alike if each.set == trial.set and each.subject != trial.subject]
            others = others or [each for each in alike if each.set == trial.set and each is not trial]
            if not others or trial.yaw_rad is None:
                continue
            rng = np.random.default_rng([number, round(10 * duration_s)])
            other = others[int(rng.integers(len(others)))].pointings
            decoy = _resampled(other, trial.pointings)
            results.append(_with_pose(trial, trial.yaw_rad, decoy, rng))
            results.append(_without_pose(trial, decoy))
    return results


def rates(results: Sequence[IdentificationResult]) -> list[Rate]:
    """Return the rates of each set, condition and method: of everybody, then of each person."""
    groups: dict[tuple[str, str, str, Method], list[IdentificationResult]] = {}
    for result in results:
        for subject in (ALL, result.subject):
            key = (result.set, subject, result.condition, result.method)
            groups.setdefault(key, []).append(result)
    return [
        Rate(
            set=key[0],
            subject=key[1],
            condition=key[2],
            method=key[3],
            n=len(group),
            right=share(sum(each.is_right for each in group), len(group)),
            chosen=share(sum(each.chosen == "right" for each in group), len(group)),
            wrong=share(sum(each.chosen == "wrong" for each in group), len(group)),
        )
        for key, group in groups.items()
    ]


def share(hits: int, count: int) -> Interval:
    """Return `hits` of `count` with its 95 % interval."""
    ends = stats.binomtest(hits, count).proportion_ci(method="wilson")
    return Interval(value=hits / count, low=float(ends.low), high=float(ends.high))


def _simulated(seed: int, duration_s: float, *, moves: bool) -> IdentificationResult:
    rng = np.random.default_rng([seed, round(10 * duration_s), moves])
    follower = SimulatedFollower.drawn(rng)
    courses = _courses(follower, rng, moves=moves)
    times_s = np.arange(0.0, duration_s + 0.5 / RATE_HZ, 1.0 / RATE_HZ)
    directions = follower.directions(courses[0], times_s, rng)
    origins = np.tile([0.0, 0.0, follower.eyes_m], (len(times_s), 1))
    pointings = Pointings(times_s, origins, directions, courses[0](times_s))
    trial = LocalizationTrial(
        set="simulated",
        subject=f"seed {seed}",
        condition=f"{duration_s:g} s, {'moving' if moves else 'at rest'}",
        pointings=pointings,
        eye_height_m=follower.eyes_m,
        x_m=follower.x_m,
        y_m=follower.y_m,
        yaw_rad=follower.yaw_rad,
    )
    return _with_pose(trial, follower.yaw_rad, courses[1](times_s), rng)


def _courses(follower: SimulatedFollower, rng: np.random.Generator, *, moves: bool) -> tuple[Course, Course]:
    """Return the courses of two robots around `follower`."""
    places = list[Array]()
    while len(places) < 2:
        way, reach_m = rng.uniform(-math.pi, math.pi), rng.uniform(NEAREST_M, FARTHEST_M)
        x_m, y_m = follower.x_m + reach_m * math.cos(way), follower.y_m + reach_m * math.sin(way)
        if all(math.dist((x_m, y_m), place[:2]) >= APART_M for place in places):
            places.append(np.array([x_m, y_m, rng.uniform(0.1, 1.6)]))
    radius_m = RADIUS_M if moves else 0.0
    phases = rng.uniform(-math.pi, math.pi, 2)

    def course(number: int) -> Course:
        def at(times_s: Array) -> Array:
            turned = phases[number] + TURN_RADPS * times_s
            level = radius_m * np.stack([np.cos(turned), np.sin(turned), np.zeros(len(times_s))], axis=1)
            return np.asarray(places[number] + level, dtype=np.float64)

        return at

    return course(0), course(1)


def _with_pose(
    trial: LocalizationTrial, yaw_rad: float, decoy_m: Array, rng: np.random.Generator
) -> IdentificationResult:
    identifier = RobotIdentifier()
    off_m = rng.normal(0.0, POSITION_SIGMA_M, 2)
    variance_m2, variance_rad2 = POSITION_SIGMA_M**2, YAW_SIGMA_RAD**2
    identifier.on_pose(
        UserPose(
            stamp_ns=0,
            position_m=(trial.x_m + float(off_m[0]), trial.y_m + float(off_m[1]), 0.0),
            yaw_rad=yaw_rad + float(rng.normal(0.0, YAW_SIGMA_RAD)),
            covariance=(variance_m2, 0.0, 0.0, 0.0, variance_m2, 0.0, 0.0, 0.0, variance_rad2),
        )
    )
    pointings = trial.pointings
    stamps = BEGIN_NS + np.rint((pointings.stamps_s - pointings.stamps_s[0]) * NS_PER_S).astype(np.int64)
    reported_ns = 0
    for row, stamp_ns in enumerate(stamps.tolist()):
        if stamp_ns - reported_ns >= NS_PER_S / REPORT_HZ:
            reported_ns = stamp_ns
            identifier.on_robot(INTENDED, stamp_ns, _vec3(pointings.targets_m[row]))
            identifier.on_robot(OTHER, stamp_ns, _vec3(decoy_m[row]))
        origin_m, direction = _vec3(pointings.origins_m[row]), _vec3(pointings.directions[row])
        identifier.on_ray(PointingRay(stamp_ns=stamp_ns, origin_m=origin_m, direction=direction))
    result = identifier.identify(int(stamps[-1]))
    of = {each.object_id: each.probability for each in result.candidates}
    return IdentificationResult(
        set=trial.set,
        subject=trial.subject,
        condition=trial.condition,
        method="with a pose",
        probability=of[INTENDED] / (of[INTENDED] + of[OTHER]) if of[INTENDED] > 0.0 else 0.0,
        is_right=of[INTENDED] > of[OTHER],
        chosen="right" if result.chosen == INTENDED else "wrong" if result.chosen else "none",
    )


def _without_pose(trial: LocalizationTrial, decoy_m: Array) -> IdentificationResult:
    """Return the result of the localizer's fits."""
    settings = SolverSettings().unlimited()
    ours = trial.pointings
    other_pointings = Pointings(ours.stamps_s, ours.origins_m, ours.directions, decoy_m)
    independent = 1.0 + settings.independent_hz * ours.span_s
    fits = rank_by_posterior(
        [(INTENDED, solve(ours, settings)), (OTHER, solve(other_pointings, settings))],
        independent,
        settings.ray_sigma_rad,
    )
    of = {fit.object_id: fit.probability for fit in fits}
    is_right = of[INTENDED] > of[OTHER]
    is_sure = max(of.values()) >= MEANT_FROM
    return IdentificationResult(
        set=trial.set,
        subject=trial.subject,
        condition=trial.condition,
        method="without a pose",
        probability=of[INTENDED],
        is_right=is_right,
        chosen="none" if not is_sure else "right" if is_right else "wrong",
    )


def _apart(trials: Sequence[LocalizationTrial], length_s: float) -> list[LocalizationTrial]:
    """Return those of `trials`, in order of time within each recording, that share no time."""
    kept: list[LocalizationTrial] = []
    before: dict[tuple[str, str], float] = {}
    for trial in trials:
        key, begin_s = (trial.set, trial.subject), float(trial.pointings.stamps_s[0])
        if key not in before or begin_s < before[key] - length_s or begin_s >= before[key] + length_s - 0.05:
            kept.append(trial)
            before[key] = begin_s
    return kept


def _resampled(other: Pointings, template: Pointings) -> Array:
    """Return the targets of `other` (n x 3) at the times of `template`, both from their beginnings."""
    own_s, wanted_s = other.stamps_s - other.stamps_s[0], template.stamps_s - template.stamps_s[0]
    columns: list[Array] = [np.interp(wanted_s, own_s, other.targets_m[:, axis]) for axis in range(3)]
    return np.stack(columns, axis=1)


def _vec3(values: Array) -> tuple[float, float, float]:
    return (float(values[0]), float(values[1]), float(values[2]))
