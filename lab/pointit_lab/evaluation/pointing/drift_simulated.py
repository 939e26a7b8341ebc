"""Yaw error of simulated people after three minutes of drift, with one anchor per minute (pointing.md §7)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from pointit.geometry import rotation, vector
from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.filter import DriftFilter, Fix
from pointit.services.localizer.drift.rest_detection import RestDetector
from pointit_lab.evaluation.pointing.drift_solvers import PLAIN, ratios
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row

Leap = Literal["", "in motion", "at rest", "after the last anchor"]
"""Time of the leap: anywhere before the last anchor, or in a rest before an anchor; then in both."""
Outcome = dict[str, tuple[float, float | None]]
"""Error and stated sigma by solver, rad."""

STEP_S = 1.0
"""Time step of the simulated drift."""

NAME = "simulated_drift"

ANCHORS_S = (60.0, 120.0)
"""Times of anchors after the localization at 0 s."""

LEARNING_S = 180.0

REST_PAUSE_S = 1.0
"""Time between a rest and the anchor after it."""

LEAP_RAD = (math.radians(20.0), math.radians(90.0))
"""Range of the angle by which the yaw leaps once, to either side; bounds are without the leap."""
USUAL = "3 min, 1 anchor/min"

WRONG_ANCHOR = "3 min, 1 anchor/min, wrong anchor"
"""Condition in which people point beside the lamp at the second anchor, as high; the bound is without it."""

BESIDE_RAD = math.radians(40.0)
"""By how much."""

NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal variable."""
NORMAL_P90 = 1.6449
"""Its 90th percentile."""


@dataclass(frozen=True, kw_only=True)
class DriftPersonModel:
    """Parameters of people and IMUs; angles in rad."""

    rate_sigma_radps: float = math.radians(0.25)
    rate_walk_radps: float = math.radians(0.002)
    """Standard deviation of the rate's random walk after one second."""
    leap: Leap = ""
    """Time of a leap of the yaw by `LEAP_RAD`."""
    azimuth_sigma_rad: float = math.radians(2.0)
    """Standard deviation of the azimuth error of one hold."""
    elevation_sigma_rad: float = math.radians(1.0)
    bent_arm_share: float = 0.05
    """Share of pointings with an additional error of `bent_arm_rad`."""
    bent_arm_rad: tuple[float, float] = (math.radians(5.0), math.radians(10.0))
    hold_yaw_sigma_rad: float = math.radians(0.25)
    hold_pitch_sigma_rad: float = math.radians(0.16)
    correlation_s: float = 0.3
    noise_rad: float = math.radians(0.03)
    eye_m: float = 1.64
    place_sigma_m: float = 0.15
    """Standard deviation of the localized position at the start."""
    start_sigma_rad: float = math.radians(2.0)
    rest_s: float = 8.0
    """Time for which the arm hangs before each anchor."""
    rest_hz: float = 25.0


class DriftingPerson:
    """One person with one IMU; deterministic for a seed."""

    def __init__(self, seed: int, person_model: DriftPersonModel, length_s: float) -> None:
        """Draw the person's pose and the IMU's drift for `length_s`."""
        self._rng = np.random.default_rng(seed)
        self._ways = person_model
        rng = self._rng
        steps = math.ceil(length_s / STEP_S) + 1
        walk_sigma_radps = person_model.rate_walk_radps * math.sqrt(STEP_S)
        walk = rng.normal(0.0, walk_sigma_radps, steps)
        rates = rng.normal(0.0, person_model.rate_sigma_radps) + np.cumsum(walk)
        self._times = np.arange(steps + 1) * STEP_S
        self._drifts = np.append(0.0, np.cumsum(rates) * STEP_S)
        self._yaw_rad = float(rng.uniform(-math.pi, math.pi))
        self.x_m, self.y_m = (float(coordinate) for coordinate in rng.uniform(-2.0, 2.0, 2))

        # own generator: people stay the same with and without a leap
        rng = np.random.default_rng([seed, 1])
        self._leap_rad = float(rng.uniform(*LEAP_RAD) * rng.choice((-1.0, 1.0)))
        self._leap_s = math.inf
        if person_model.leap == "at rest":
            anchor_s = rng.choice(ANCHORS_S)
            rest_share = rng.uniform(0.1, 0.9)
            self._leap_s = float(anchor_s - REST_PAUSE_S - rest_share * person_model.rest_s)
        elif person_model.leap == "after the last anchor":
            self._leap_s = float(rng.uniform(ANCHORS_S[1], LEARNING_S))
        elif person_model.leap:
            self._leap_s = float(rng.uniform(0.0, ANCHORS_S[1]))

    def yaw_rad(self, at_s: float) -> float:
        """Return the true yaw of {H} in {W}."""
        leaped_rad = self._leap_rad if at_s > self._leap_s else 0.0
        drifted_rad = float(np.interp(at_s, self._times, self._drifts))
        return self._yaw_rad - drifted_rad + leaped_rad

    def fix(self) -> Fix:
        """Return the localization at 0 s."""
        person_model = self._ways
        sigmas = np.array(
            [person_model.place_sigma_m, person_model.place_sigma_m, person_model.start_sigma_rad]
        )
        truth = np.array([self.x_m, self.y_m, self.yaw_rad(0.0)])
        x, y, yaw = truth + sigmas * self._rng.standard_normal(3)
        return Fix(x_m=x, y_m=y, yaw_rad=yaw, covariance=np.diag(sigmas**2), stamp_ns=0)

    def pointing(self, at_s: float, beside_rad: float = 0.0) -> tuple[Vec3, Vec3]:
        """Return a lamp ({W}) around the person, and the ray ({H}) that points at it.

        Args:
            at_s: time of the pointing.
            beside_rad: additional error to the left.
        """
        person_model = self._ways
        rng = self._rng
        around = rng.uniform(-math.pi, math.pi)
        away = rng.uniform(1.5, 4.0)
        high = rng.uniform(0.0, 1.2)
        x_m = self.x_m + away * math.cos(around)
        y_m = self.y_m + away * math.sin(around)
        target = (x_m, y_m, high)
        azimuth = around + rng.normal(0.0, person_model.azimuth_sigma_rad) + beside_rad
        if rng.random() < person_model.bent_arm_share:
            bend_rad = rng.uniform(*person_model.bent_arm_rad)
            side = 1.0 if rng.random() < 0.5 else -1.0
            azimuth += bend_rad * side
        true_elevation = math.atan2(high - person_model.eye_m, away)
        elevation = true_elevation + rng.normal(0.0, person_model.elevation_sigma_rad)
        return target, vector.direction(azimuth - self.yaw_rad(at_s), elevation)

    def rest(self, from_s: float) -> list[tuple[rotation.Quaternion, int]]:
        """Return the IMU's samples from `from_s` on, while the arm hangs down: orientation and time in ns."""
        person_model = self._ways
        count = round(person_model.rest_s * person_model.rest_hz)
        times = from_s + np.arange(count) / person_model.rest_hz
        yaw = self._wander(len(times), person_model.hold_yaw_sigma_rad)
        pitch = self._wander(len(times), person_model.hold_pitch_sigma_rad)
        noise = self._rng.normal(0.0, person_model.noise_rad, (2, len(times)))
        facing = float(self._rng.uniform(-math.pi, math.pi)) - self._yaw_rad
        has_leaped = times > self._leap_s
        drifts = np.interp(times, self._times, self._drifts) - self._leap_rad * has_leaped
        yaw_noise = yaw + noise[0]
        pitch_noise = pitch + noise[1]
        samples: list[tuple[rotation.Quaternion, int]] = []
        for time_s, drift, yaw_error, pitch_error in zip(times, drifts, yaw_noise, pitch_noise, strict=True):
            azimuth = float(facing + drift + yaw_error)
            orientation = rotation.from_azimuth_elevation(azimuth, float(pitch_error) - 1.4)
            samples.append((orientation, round(float(time_s) * NS_PER_S)))
        return samples

    def _wander(self, count: int, sigma_rad: float) -> Array:
        """Return a random walk with the correlation of people who hold still (Ornstein and Uhlenbeck)."""
        stays = math.exp(-1.0 / (self._ways.rest_hz * self._ways.correlation_s))
        kicks = self._rng.normal(0.0, sigma_rad * math.sqrt(1.0 - stays**2), count)
        kicks[0] = self._rng.normal(0.0, sigma_rad)
        walk = np.empty(count)
        value = 0.0
        for i in range(count):
            value = stays * value + float(kicks[i])
            walk[i] = value
        return walk


def simulated_rows(people: int, person_model: DriftPersonModel | None = None) -> list[Row]:
    """Return the rows of `people` simulated people, the same ones each time."""
    if person_model is None:
        person_model = DriftPersonModel()
    rows: list[Row] = []
    after_s = (*ANCHORS_S, LEARNING_S)
    quiet = replace(person_model, rate_sigma_radps=math.radians(0.02))
    scattering = replace(person_model, azimuth_sigma_rad=math.radians(5.0))
    # name, times of the anchors, model, error of the second anchor
    conditions = [
        (USUAL, ANCHORS_S, person_model, 0.0),
        (f"{USUAL}, after it", after_s, person_model, 0.0),
        (f"{USUAL}, 5° scatter", ANCHORS_S, scattering, 0.0),
        (f"{USUAL}, quiet IMU", ANCHORS_S, quiet, 0.0),
        (WRONG_ANCHOR, ANCHORS_S, person_model, BESIDE_RAD),
        (f"{WRONG_ANCHOR}, after it", after_s, person_model, BESIDE_RAD),
    ]
    for leap in get_args(Leap)[1:]:
        leaping = replace(person_model, leap=leap)
        quiet_leaping = replace(quiet, leap=leap)
        conditions += [
            (f"{USUAL}, leap {leap}", ANCHORS_S, leaping, 0.0),
            (f"{USUAL}, leap {leap}, after it", after_s, leaping, 0.0),
            (f"{USUAL}, quiet IMU, leap {leap}", ANCHORS_S, quiet_leaping, 0.0),
        ]
    for condition, anchors_s, own_model, beside_rad in conditions:
        outcomes = [outcome(seed, own_model, anchors_s, beside_rad) for seed in range(people)]
        rows += [_solver_row(condition, solver, outcomes) for solver in outcomes[0]]
        # no estimate without rests can be better
        sigma_rad = bound_rad(own_model, anchors_s)
        rows.append(normal_row(NAME, condition, "bound", people, sigma_rad))
    return rows


def _solver_row(condition: str, solver: str, outcomes: Sequence[Outcome]) -> Row:
    errors_rad: list[float] = []
    within: list[bool] = []
    for person_outcome in outcomes:
        error_rad, sigma_rad = person_outcome[solver]
        errors_rad.append(error_rad)
        if sigma_rad is not None:
            within.append(abs(error_rad) <= 2.0 * sigma_rad)

    times_plain = None
    if solver != PLAIN:
        names = [str(seed) for seed in range(len(outcomes))]
        plain_errors_rad = [person_outcome[PLAIN][0] for person_outcome in outcomes]
        times_plain = ratios(names, errors_rad, plain_errors_rad)
    yaw_within_2_sigma = float(np.mean(within)) if within else None
    return Row(
        set=NAME,
        subject=ALL,
        condition=condition,
        solver=solver,
        n=len(outcomes),
        yaw_deg=MetricSpread.of(map(math.degrees, errors_rad)),
        yaw_within_2_sigma=yaw_within_2_sigma,
        times_plain=times_plain,
    )


def outcome(
    seed: int, person_model: DriftPersonModel, anchors_s: Sequence[float], jump_rad: float = 0.0
) -> Outcome:
    """Return the yaw error of each solver at `LEARNING_S`.

    Args:
        seed: seed of the person.
        person_model: model of people and IMUs.
        anchors_s: times at which they point at a lamp.
        jump_rad: error of the second anchor.
    """
    person = DriftingPerson(seed, person_model, LEARNING_S)
    fix = person.fix()
    plain = DriftFilter(fix)
    rested = DriftFilter(fix)
    eyes_m = (0.0, 0.0, person_model.eye_m)
    anchors = [(0.0, fix.yaw_rad)]
    for number, at_s in enumerate(anchors_s):
        # a rest before each anchor, which only one of the filters knows
        rest_detector = RestDetector()
        samples = person.rest(at_s - person_model.rest_s - REST_PAUSE_S)
        rests = [rest_detector.add(*sample) for sample in samples]
        rests.append(rest_detector.end())
        for rest in rests:
            if rest is not None:
                rested.update_rest_rate(
                    rest.stamp_ns, rest.yaw_rate_radps, rest.sigma_radps, is_raised=rest.is_raised
                )

        # the anchor, which both know
        beside_rad = jump_rad if number == 1 else 0.0
        target, direction = person.pointing(at_s, beside_rad)
        at_ns = round(at_s * NS_PER_S)
        for drift in (plain, rested):
            drift.update_anchor(at_ns, target, eyes_m, direction, spread_rad=person_model.hold_yaw_sigma_rad)
        seen = vector.azimuth((target[0] - fix.x_m, target[1] - fix.y_m, 0.0))
        anchors.append((at_s, seen - vector.azimuth(direction)))

    # predictions of the yaw later
    learning_ns = round(LEARNING_S * NS_PER_S)
    pose = plain.predict(learning_ns)
    rested_pose = rested.predict(learning_ns)
    first_s, first = anchors[0]
    last_s, last = anchors[-1]
    rate = math.remainder(last - first, math.tau) / (last_s - first_s)
    extrapolated = last + rate * (LEARNING_S - last_s)
    truth = person.yaw_rad(LEARNING_S)
    yaws: Outcome = {
        "raw": (first, None),
        "re-anchored": (last, None),
        "re-anchored, constant rate": (extrapolated, None),
        "pointit": (pose.yaw_rad, pose.yaw_sigma_rad),
        "pointit, rests": (rested_pose.yaw_rad, rested_pose.yaw_sigma_rad),
    }
    errors: Outcome = {}
    for solver, (yaw_rad, sigma_rad) in yaws.items():
        errors[solver] = (_wrap(yaw_rad - truth), sigma_rad)
    return errors


def bound_rad(person_model: DriftPersonModel, anchors_s: Sequence[float]) -> float:
    """Return one sigma of the best estimate of the yaw at `LEARNING_S` without rests (Cramér and Rao).

    For a constant rate with the prior of IMUs, and anchors with independent errors. Rate walk, bent arms
    and an unknown position would increase it.
    """
    prior = [1.0 / person_model.start_sigma_rad**2, 1.0 / person_model.rate_sigma_radps**2]
    information = np.diag(prior)
    for at_s in anchors_s:
        slope = np.array([1.0, at_s])
        information += np.outer(slope, slope) / person_model.azimuth_sigma_rad**2
    slope = np.array([1.0, LEARNING_S])
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
        yaw_deg=MetricSpread(median=NORMAL_MEDIAN * sigma, p90=NORMAL_P90 * sigma, rms=sigma),
    )


def _wrap(angle_rad: float) -> float:
    return math.remainder(angle_rad, math.tau)
