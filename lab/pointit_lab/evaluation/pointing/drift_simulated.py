"""Yaw error of simulated people after three minutes of drift, with one anchor per minute (pointing.md §7)."""

import math
from collections.abc import Iterable, Sequence
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
        self._model = person_model
        rng = self._rng

        # the rate is drawn, and walks
        steps = math.ceil(length_s / STEP_S) + 1
        walk_sigma_radps = person_model.rate_walk_radps * math.sqrt(STEP_S)
        walk = rng.normal(0.0, walk_sigma_radps, steps)
        rates = rng.normal(0.0, person_model.rate_sigma_radps) + np.cumsum(walk)
        drifts = np.cumsum(rates) * STEP_S
        self._times = np.arange(steps + 1) * STEP_S
        self._drifts = np.append(0.0, drifts)
        self._yaw_rad = float(rng.uniform(-math.pi, math.pi))
        x_m, y_m = rng.uniform(-2.0, 2.0, 2)
        self.x_m = float(x_m)
        self.y_m = float(y_m)

        # own generator: people stay the same with and without a leap
        rng = np.random.default_rng([seed, 1])
        leap_rad = rng.uniform(*LEAP_RAD)
        side = rng.choice((-1.0, 1.0))
        self._leap_rad = float(leap_rad * side)
        self._leap_s = math.inf
        if person_model.leap == "at rest":
            anchor_s = rng.choice(ANCHORS_S)
            rest_share = rng.uniform(0.1, 0.9)
            before_end_s = rest_share * person_model.rest_s
            self._leap_s = float(anchor_s - REST_PAUSE_S - before_end_s)
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
        model = self._model
        sigmas = np.array([model.place_sigma_m, model.place_sigma_m, model.start_sigma_rad])
        truth = np.array([self.x_m, self.y_m, self.yaw_rad(0.0)])
        errors = sigmas * self._rng.standard_normal(3)
        x, y, yaw = truth + errors
        covariance = np.diag(sigmas**2)
        return Fix(x_m=x, y_m=y, yaw_rad=yaw, covariance=covariance, stamp_ns=0)

    def pointing(self, at_s: float, beside_rad: float = 0.0) -> tuple[Vec3, Vec3]:
        """Return a lamp ({W}) around the person, and the ray ({H}) that points at it.

        Args:
            at_s: time of the pointing.
            beside_rad: additional error to the left.
        """
        model = self._model
        rng = self._rng

        # a lamp anywhere around
        around = rng.uniform(-math.pi, math.pi)
        away = rng.uniform(1.5, 4.0)
        high = rng.uniform(0.0, 1.2)
        x_m = self.x_m + away * math.cos(around)
        y_m = self.y_m + away * math.sin(around)
        target = (x_m, y_m, high)

        # the ray, with the error of a hold, and sometimes of a bent arm
        azimuth = around + rng.normal(0.0, model.azimuth_sigma_rad) + beside_rad
        if rng.random() < model.bent_arm_share:
            bend_rad = rng.uniform(*model.bent_arm_rad)
            side = 1.0 if rng.random() < 0.5 else -1.0
            azimuth += bend_rad * side
        true_elevation = math.atan2(high - model.eye_m, away)
        elevation = true_elevation + rng.normal(0.0, model.elevation_sigma_rad)
        azimuth_h = azimuth - self.yaw_rad(at_s)
        return target, vector.direction(azimuth_h, elevation)

    def rest(self, from_s: float) -> list[tuple[rotation.Quaternion, int]]:
        """Return the IMU's samples from `from_s` on, while the arm hangs down: orientation and time in ns."""
        model = self._model
        count = round(model.rest_s * model.rest_hz)
        times = from_s + np.arange(count) / model.rest_hz

        yaw_errors, pitch_errors = self._hold_errors(count)

        # where it faces, and what the IMU makes of it
        facing = float(self._rng.uniform(-math.pi, math.pi)) - self._yaw_rad
        leaps = self._leap_rad * (times > self._leap_s)
        drifts = np.interp(times, self._times, self._drifts) - leaps
        samples: list[tuple[rotation.Quaternion, int]] = []
        for time_s, drift, yaw_error, pitch_error in zip(
            times, drifts, yaw_errors, pitch_errors, strict=True
        ):
            azimuth = float(facing + drift + yaw_error)
            elevation = float(pitch_error) - 1.4
            orientation = rotation.from_azimuth_elevation(azimuth, elevation)
            time_ns = round(float(time_s) * NS_PER_S)
            samples.append((orientation, time_ns))
        return samples

    def _hold_errors(self, count: int) -> tuple[Array, Array]:
        """Return the motion of an arm that hangs, with the sensor's noise: yaw and pitch (n each, rad)."""
        model = self._model
        yaw = self._wander(count, model.hold_yaw_sigma_rad)
        pitch = self._wander(count, model.hold_pitch_sigma_rad)
        yaw_noise, pitch_noise = self._rng.normal(0.0, model.noise_rad, (2, count))
        return yaw + yaw_noise, pitch + pitch_noise

    def _wander(self, count: int, sigma_rad: float) -> Array:
        """Return a random walk with the correlation of people who hold still (Ornstein and Uhlenbeck)."""
        samples = self._model.rest_hz * self._model.correlation_s
        stays = math.exp(-1.0 / samples)
        kick_sigma_rad = sigma_rad * math.sqrt(1.0 - stays**2)
        kicks = self._rng.normal(0.0, kick_sigma_rad, count)
        kicks[0] = self._rng.normal(0.0, sigma_rad)
        walk = np.empty(count)
        value = 0.0
        for index, kick in enumerate(kicks.tolist()):
            value = stays * value + kick
            walk[index] = value
        return walk


def simulated_rows(people: int, person_model: DriftPersonModel | None = None) -> list[Row]:
    """Return the rows of `people` simulated people, the same ones each time."""
    if person_model is None:
        person_model = DriftPersonModel()
    rows: list[Row] = []
    for condition in _conditions(person_model):
        outcomes: list[Outcome] = []
        for seed in range(people):
            outcomes.append(outcome(seed, condition.model, condition.anchors_s, condition.beside_rad))
        rows += [_solver_row(condition.name, solver, outcomes) for solver in outcomes[0]]
        # no estimate without rests can be better
        sigma_rad = bound_rad(condition.model, condition.anchors_s)
        rows.append(normal_row(NAME, condition.name, "bound", people, sigma_rad))
    return rows


@dataclass(frozen=True)
class _DriftCondition:
    name: str
    anchors_s: Sequence[float]
    model: DriftPersonModel
    beside_rad: float = 0.0
    """Error of the second anchor."""


def _conditions(model: DriftPersonModel) -> list[_DriftCondition]:
    """Return the conditions of the table, in its order."""
    after_s = (*ANCHORS_S, LEARNING_S)
    quiet = replace(model, rate_sigma_radps=math.radians(0.02))
    scattering = replace(model, azimuth_sigma_rad=math.radians(5.0))
    conditions = [
        _DriftCondition(USUAL, ANCHORS_S, model),
        _DriftCondition(f"{USUAL}, after it", after_s, model),
        _DriftCondition(f"{USUAL}, 5° scatter", ANCHORS_S, scattering),
        _DriftCondition(f"{USUAL}, quiet IMU", ANCHORS_S, quiet),
        _DriftCondition(WRONG_ANCHOR, ANCHORS_S, model, BESIDE_RAD),
        _DriftCondition(f"{WRONG_ANCHOR}, after it", after_s, model, BESIDE_RAD),
    ]
    for leap in get_args(Leap)[1:]:
        leaping = replace(model, leap=leap)
        quiet_leaping = replace(quiet, leap=leap)
        conditions += [
            _DriftCondition(f"{USUAL}, leap {leap}", ANCHORS_S, leaping),
            _DriftCondition(f"{USUAL}, leap {leap}, after it", after_s, leaping),
            _DriftCondition(f"{USUAL}, quiet IMU, leap {leap}", ANCHORS_S, quiet_leaping),
        ]
    return conditions


def _solver_row(condition: str, solver: str, outcomes: Sequence[Outcome]) -> Row:
    errors_rad: list[float] = []
    within: list[bool] = []
    for person_outcome in outcomes:
        error_rad, sigma_rad = person_outcome[solver]
        errors_rad.append(error_rad)
        if sigma_rad is not None:
            is_within = abs(error_rad) <= 2.0 * sigma_rad
            within.append(is_within)
    yaw_within_2_sigma = None
    if within:
        yaw_within_2_sigma = float(np.mean(within))

    # as multiples of plain re-anchoring, over people
    times_plain = None
    if solver != PLAIN:
        names = [str(seed) for seed in range(len(outcomes))]
        plain_errors_rad = [person_outcome[PLAIN][0] for person_outcome in outcomes]
        times_plain = ratios(names, errors_rad, plain_errors_rad)
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
        rest_start_s = at_s - person_model.rest_s - REST_PAUSE_S
        _rest(rested, person.rest(rest_start_s))

        # the anchor, which both know
        beside_rad = jump_rad if number == 1 else 0.0
        target, direction = person.pointing(at_s, beside_rad)
        at_ns = round(at_s * NS_PER_S)
        for drift in (plain, rested):
            drift.update_anchor(at_ns, target, eyes_m, direction, spread_rad=person_model.hold_yaw_sigma_rad)
        anchors.append((at_s, _anchored_yaw_rad(fix, target, direction)))

    truth = person.yaw_rad(LEARNING_S)
    errors: Outcome = {}
    for solver, (predicted_rad, sigma_rad) in _predictions(anchors, plain, rested).items():
        errors[solver] = (_wrap(predicted_rad - truth), sigma_rad)
    return errors


def _predictions(anchors: Sequence[tuple[float, float]], plain: DriftFilter, rested: DriftFilter) -> Outcome:
    """Return the yaw at `LEARNING_S` and its sigma by solver, of anchors (time, yaw) and two filters."""
    learning_ns = round(LEARNING_S * NS_PER_S)
    pose = plain.predict(learning_ns)
    rested_pose = rested.predict(learning_ns)
    return {
        "raw": (anchors[0][1], None),
        "re-anchored": (anchors[-1][1], None),
        "re-anchored, constant rate": (_extrapolated(anchors), None),
        "pointit": (pose.yaw_rad, pose.yaw_sigma_rad),
        "pointit, rests": (rested_pose.yaw_rad, rested_pose.yaw_sigma_rad),
    }


def _anchored_yaw_rad(fix: Fix, target: Vec3, direction: Vec3) -> float:
    """Return the yaw in which the ray `direction` ({H}) meets `target` from the localized place."""
    x_m, y_m, _ = target
    seen_rad = vector.azimuth((x_m - fix.x_m, y_m - fix.y_m, 0.0))
    return seen_rad - vector.azimuth(direction)


def _rest(drift: DriftFilter, samples: Iterable[tuple[rotation.Quaternion, int]]) -> None:
    """Update `drift` by the rests that are detected in `samples`."""
    detector = RestDetector()
    rests = [detector.add(orientation, time_ns) for orientation, time_ns in samples]
    rests.append(detector.end())
    for rest in rests:
        if rest is not None:
            drift.update_rest_rate(
                rest.stamp_ns, rest.yaw_rate_radps, rest.sigma_radps, is_raised=rest.is_raised
            )


def _extrapolated(anchors: Sequence[tuple[float, float]]) -> float:
    """Return the yaw at `LEARNING_S` by the mean rate between the first anchor and the last (time, yaw)."""
    first_s, first_rad = anchors[0]
    last_s, last_rad = anchors[-1]
    turned_rad = math.remainder(last_rad - first_rad, math.tau)
    rate_radps = turned_rad / (last_s - first_s)
    return last_rad + rate_radps * (LEARNING_S - last_s)


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
    variance = float(slope @ np.linalg.solve(information, slope))
    return math.sqrt(variance)


def normal_row(name: str, condition: str, solver: str, n: int, sigma_rad: float) -> Row:
    """Return the row of errors that are normal with `sigma_rad`."""
    sigma = math.degrees(sigma_rad)
    spread = MetricSpread(median=NORMAL_MEDIAN * sigma, p90=NORMAL_P90 * sigma, rms=sigma)
    return Row(set=name, subject=ALL, condition=condition, solver=solver, n=n, yaw_deg=spread)


def _wrap(angle_rad: float) -> float:
    return math.remainder(angle_rad, math.tau)
