"""Faults injected into trials: each breaks one assumption of the solver, and changes nothing else.

A fault that turns all rays equally turns the true yaw, too, which is that of pointing.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures
from pointit.sim.aim import Stance
from pointit_lab.evaluation.localization.arm_rays import STATURE_M, eye_height_m, scaled_body
from pointit_lab.evaluation.localization.trial import LocalizationTrial

Change = Callable[[LocalizationTrial, np.random.Generator], LocalizationTrial]

BESIDE_M = 0.2
"""Distance of the shoulder from the assumed one."""

TALLER_M = 0.2
"""Difference of the true height of the eyes from the stated one."""

DRIFT_RADPS = math.radians(1.0)
"""Drift of the IMU's yaw: 60 degrees a minute."""

ROLL_RAD = math.radians(10.0)
ROLLING_RAD = math.radians(5.0)
"""Standard deviations of the roll of an arm: of people, and of one arm from second to second."""

KNOT_S = 1.0
"""Interval at which the roll of an arm changes."""

NONE = "as they are"


@dataclass(frozen=True, kw_only=True)
class Injection:
    """A fault, and the trials into which it fits."""

    name: str
    change: Change | None = None
    shift_s: float = 0.0
    """Time by which reports of the robot are late."""
    follows: bool = True
    """True if it fits people who follow a robot."""
    points: bool = True
    """True if it fits people who point at lamps."""
    wrong_lamp: bool = False
    """True if one of the lamps was not the one pointed at."""
    one_wall: bool = False
    """True if all lamps are on one wall."""
    visits: int = 1
    """Number of times that each lamp is pointed at, with the same error."""


def arm_directions(trial: LocalizationTrial, beside_m: Array | None = None) -> Array:
    """Return the straight arms (n x 3, unit, {H}) whose fingers are on the rays of `trial`.

    Args:
        trial: rays from the eyes.
        beside_m: offset of the shoulder from its place below the eyes, 3, {H}.
    """
    body = _body(trial)
    arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m
    shoulder_m = np.array([0.0, 0.0, -body.neck_to_eyes_m])
    if beside_m is not None:
        shoulder_m += beside_m

    # the finger is where the ray meets the sphere of the arm's length about the shoulder
    rays = trial.pointings.directions
    half = rays @ shoulder_m
    square = half**2 - shoulder_m @ shoulder_m + arm_m**2
    distance_m = half + np.sqrt(np.maximum(square, 0.0))
    finger_m = distance_m[:, None] * rays
    arms = finger_m - shoulder_m
    lengths_m = np.linalg.norm(arms, axis=1)
    return np.asarray(arms / lengths_m[:, None], dtype=np.float64)


def _body(trial: LocalizationTrial) -> BodyMeasures:
    default_eyes_m = eye_height_m(BodyMeasures())
    return scaled_body(STATURE_M * trial.eye_height_m / default_eyes_m)


def with_arms(trial: LocalizationTrial, arms: Array) -> LocalizationTrial:
    """Return `trial` with the rays that the localizer's model makes of `arms` (n x 3, unit, {H})."""
    body = _body(trial)
    arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m
    reach = arm_m * arms
    reach[:, 2] -= body.neck_to_eyes_m
    lengths_m = np.linalg.norm(reach, axis=1)
    return _turned(trial, reach / lengths_m[:, None])


def _turned(trial: LocalizationTrial, directions: Array) -> LocalizationTrial:
    """Return `trial` with `directions`. The true yaw turns back by their mean turn."""
    previous = trial.pointings.directions
    azimuths = np.arctan2(directions[:, 1], directions[:, 0])
    previous_azimuths = np.arctan2(previous[:, 1], previous[:, 0])
    turns = azimuths - previous_azimuths
    yaw_rad = trial.yaw_rad
    if yaw_rad is not None:
        mean_direction = np.exp(1j * turns).mean()
        mean_turn_rad = float(np.angle(mean_direction))
        yaw_rad = math.remainder(yaw_rad - mean_turn_rad, math.tau)
    return replace(_with_directions(trial, directions), yaw_rad=yaw_rad)


def _with_directions(trial: LocalizationTrial, directions: Array) -> LocalizationTrial:
    pointings = replace(trial.pointings, directions=directions)
    return replace(trial, pointings=pointings)


def shoulder(trial: LocalizationTrial, rng: np.random.Generator, *, to_right_m: float) -> LocalizationTrial:
    """Move the shoulder `to_right_m` beside the assumed one; the body turns with the arm."""
    del rng
    return _beside(trial, to_right_m)


def shoulder_unknown(trial: LocalizationTrial, rng: np.random.Generator) -> LocalizationTrial:
    """Move the shoulder up to `BESIDE_M` to either side."""
    to_right_m = float(rng.uniform(-BESIDE_M, BESIDE_M))
    return _beside(trial, to_right_m)


def _beside(trial: LocalizationTrial, to_right_m: float) -> LocalizationTrial:
    """Return `trial` with arms from a shoulder `to_right_m` beside the neck; the body turns with them."""
    hand = "right" if to_right_m > 0.0 else "left"
    beside = {"neck_to_shoulder_m": abs(to_right_m)}
    stance = Stance(_body(trial).model_copy(update=beside), hand)
    directions: list[Vec3] = []
    for x, y, z in trial.pointings.directions.tolist():
        aim = stance.aim_at(vector.add(stance.eyes_m, (x, y, z)))
        directions.append(vector.direction(*aim))
    return with_arms(trial, np.array(directions, dtype=np.float64))


def shoulder_still(trial: LocalizationTrial, rng: np.random.Generator) -> LocalizationTrial:
    """Move the shoulder to the right of a body that does not turn, and faces the middle of all rays."""
    del rng
    forward, left, _ = trial.pointings.directions.mean(axis=0)
    level = max(math.hypot(forward, left), 1e-6)
    right = np.array([left, -forward, 0.0]) / level
    return with_arms(trial, arm_directions(trial, BESIDE_M * right))


def height(trial: LocalizationTrial, rng: np.random.Generator, *, taller_m: float) -> LocalizationTrial:
    """State the person `taller_m` taller than they are."""
    del rng
    taller = np.array([0.0, 0.0, taller_m])
    origins_m = trial.pointings.origins_m + taller
    return replace(trial, pointings=replace(trial.pointings, origins_m=origins_m))


def garbage(trial: LocalizationTrial, rng: np.random.Generator, *, share: float) -> LocalizationTrial:
    """Turn a `share` of the rays to any directions."""
    count = len(trial.pointings)
    anywhere = rng.normal(size=(count, 3))
    lengths = np.linalg.norm(anywhere, axis=1)
    anywhere /= lengths[:, None]
    is_garbage = rng.random(count) < share
    directions = np.where(is_garbage[:, None], anywhere, trial.pointings.directions)
    return _with_directions(trial, directions)


def drift(trial: LocalizationTrial, rng: np.random.Generator) -> LocalizationTrial:
    """Turn the rays at `DRIFT_RADPS` to either side; the true yaw is that of the middle."""
    stamps_s = trial.pointings.stamps_s
    side = float(rng.choice([-1.0, 1.0]))
    from_middle_s = stamps_s - stamps_s.mean()
    turn = np.exp(1j * side * DRIFT_RADPS * from_middle_s)

    # the horizontal part of a ray as a complex number, which a multiplication turns
    rays = trial.pointings.directions
    level = rays[:, 0] + 1j * rays[:, 1]
    level *= turn
    directions = np.stack([level.real, level.imag, rays[:, 2]], axis=1)
    return _with_directions(trial, directions)


def across(trial: LocalizationTrial, rng: np.random.Generator) -> LocalizationTrial:
    """Mount the sensor across the arm: its pitch is the arm's roll."""
    arms = arm_directions(trial)
    level = np.maximum(np.hypot(arms[:, 0], arms[:, 1]), 1e-6)
    left = np.zeros_like(arms)
    left[:, 0] = -arms[:, 1] / level
    left[:, 1] = arms[:, 0] / level
    up = np.cross(arms, left)

    # roll turns the sensor's axis about the arm
    roll_rad = _roll_rad(trial.pointings.stamps_s, rng)[:, None]
    sideways = np.cos(roll_rad) * left + np.sin(roll_rad) * up
    side = float(rng.choice([-1.0, 1.0]))
    return with_arms(trial, side * sideways)


def backwards(trial: LocalizationTrial, rng: np.random.Generator) -> LocalizationTrial:
    """Mount the sensor with its axis towards the elbow."""
    del rng
    return with_arms(trial, -arm_directions(trial))


def _roll_rad(stamps_s: Array, rng: np.random.Generator) -> Array:
    """Return the roll of an arm (n, rad), which wanders about a mean of this person."""
    end_s = stamps_s[-1] + 2.0 * KNOT_S
    knots_s = np.arange(stamps_s[0], end_s, KNOT_S)
    knots_rad = rng.normal(0.0, ROLLING_RAD, len(knots_s))
    wander = np.interp(stamps_s, knots_s, knots_rad)
    mean_rad = float(rng.normal(0.0, ROLL_RAD))
    return np.asarray(mean_rad + wander, dtype=np.float64)


INJECTIONS = (
    Injection(name=NONE),
    Injection(name="time +0.2 s", shift_s=0.2, points=False),
    Injection(name="time -0.2 s", shift_s=-0.2, points=False),
    Injection(name="time +0.5 s", shift_s=0.5, points=False),
    Injection(name="time -0.5 s", shift_s=-0.5, points=False),
    Injection(name="shoulder right", change=partial(shoulder, to_right_m=BESIDE_M)),
    Injection(name="shoulder left", change=partial(shoulder, to_right_m=-BESIDE_M)),
    Injection(name="shoulder unknown", change=shoulder_unknown),
    Injection(name="shoulder right, body still", change=shoulder_still, points=False),
    Injection(name="height +0.2 m", change=partial(height, taller_m=TALLER_M)),
    Injection(name="height -0.2 m", change=partial(height, taller_m=-TALLER_M)),
    Injection(name="wrong lamp", follows=False, wrong_lamp=True),
    Injection(name="wrong lamp, twice", follows=False, wrong_lamp=True, visits=2),
    Injection(name="garbage 5 %", change=partial(garbage, share=0.05)),
    Injection(name="garbage 15 %", change=partial(garbage, share=0.15)),
    Injection(name="drift 60°/min", change=drift),
    Injection(name="lamps on one wall", follows=False, one_wall=True),
    Injection(name="mounted across", change=across),
    Injection(name="mounted backwards", change=backwards),
)
"""All faults, in the order of the table."""
