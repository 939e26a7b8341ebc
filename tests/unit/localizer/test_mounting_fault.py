"""Sensors that sit across the arm or backwards, while the person follows a robot."""

import math
from collections.abc import Iterable

import numpy as np
import pytest

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, BodyMeasures, PointingRay
from pointit.services.imu_bridge.arm_frame import MOUNTINGS, ArmFrame
from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.estimation.mounting import mounting_fault, mounting_slope
from pointit.services.localizer.procedures.moving_target import MovingTarget
from pointit.sim.recordings import OPERATOR, read_imu_csv
from pointit_lab.evaluation.datasets import motion_relloc, read_trials
from pointit_lab.evaluation.localization.arm_rays import eye_finger_rays, eye_height_m
from pointit_lab.evaluation.recordings.data_folder import file_of, read_index
from tests.support.data import data_file
from tests.unit.localizer.lab import config
from tests.unit.localizer.test_moving_target import START_NS, poses, robots, told

BODY = BodyMeasures()
ARM_M = BODY.shoulder_to_wrist_m + BODY.wrist_to_finger_m
TURNS: dict[str, Quaternion] = {
    "left": rotation.from_yaw(math.pi / 2.0),
    "right": rotation.from_yaw(-math.pi / 2.0),
    "backwards": rotation.from_yaw(math.pi),
    "upside down": rotation.from_axis_angle((1.0, 0.0, 0.0), math.pi),
    "along": rotation.IDENTITY,
}
"""Turns of the sensor on the arm."""


def following(seed: int, turn: Quaternion, *, rise_m: float = 0.4, is_around: bool = False) -> Pointings:
    """A person who follows a robot for 10 s, with unrest and a rolling arm; the sensor is turned by `turn`.

    The robot flies a circle of 1 m beside the person, or of 2 m around them, and rises and sinks by `rise_m`.
    """
    generator = np.random.default_rng(seed)
    t_s = np.arange(250) / 25.0
    x, y = generator.uniform(-2.0, 2.0, 2)
    away, towards = generator.uniform(1.8, 3.0), generator.uniform(0.0, math.tau)
    radius_m = 2.0 if is_around else 1.0
    if is_around:
        away = 0.0
    angle = math.tau * t_s / 8.0
    targets = np.column_stack(
        [
            x + away * math.cos(towards) + radius_m * np.cos(angle),
            y + away * math.sin(towards) + radius_m * np.sin(angle),
            0.7 + rise_m * np.sin(2.0 * angle),
        ]
    )
    unrest = np.zeros((len(t_s), 3))
    steps = generator.normal(0.0, np.radians([2.0, 1.5, 5.0]), unrest.shape) * math.sqrt(1.0 - 0.92**2)
    for index in range(1, len(t_s)):
        unrest[index] = 0.92 * unrest[index - 1] + steps[index]
    east, north, up = (targets - [x, y, eye_height_m(BODY)]).T
    elevations = np.arctan2(up, np.hypot(east, north))
    elevations += unrest[:, 1] + generator.normal(0.0, math.radians(4.0))
    raised = elevations + np.arcsin(BODY.neck_to_eyes_m * np.cos(elevations) / ARM_M)
    azimuths = np.arctan2(north, east) + unrest[:, 0] - generator.uniform(-3.0, 3.0)
    rolls = unrest[:, 2] + generator.normal(0.0, math.radians(10.0))

    def sensors() -> Iterable[Quaternion]:
        for azimuth, elevation, roll in np.column_stack([azimuths, raised, rolls]).tolist():
            rolled = rotation.from_axis_angle((1.0, 0.0, 0.0), roll)
            arm = rotation.multiply(rotation.from_azimuth_elevation(azimuth, elevation), rolled)
            yield rotation.multiply(arm, turn)

    return Pointings(t_s, *eye_finger_rays(sensors(), BODY), targets)


def verdict(pointings: Pointings) -> tuple[bool, str]:
    """Return True if the solver accepts `pointings`, and the message about the mounting."""
    result = solve(pointings, SolverSettings())
    return isinstance(result, Solution), mounting_fault(pointings, result, SolverSettings(), 0.0)


@pytest.mark.parametrize("rise_m", [0.3, 0.8])
@pytest.mark.parametrize("turn", ["left", "right", "backwards"])
def test_wrong_mounting_is_recognized_when_the_robot_rises_and_sinks(turn: str, rise_m: float) -> None:
    named = 0
    for seed in range(25):
        is_accepted, fault = verdict(following(seed, TURNS[turn], rise_m=rise_m))
        assert fault or not is_accepted
        named += "calibrate mounting" in fault and ("backwards" if turn == "backwards" else "across") in fault
    assert named >= 20


@pytest.mark.parametrize("turn", ["along", "upside down"])
def test_sensor_along_the_arm_causes_no_alarm(turn: str) -> None:
    for seed in range(25):
        for rise_m, is_around in ((0.4, False), (0.0, False), (0.0, True)):
            gathered = following(seed, TURNS[turn], rise_m=rise_m, is_around=is_around)
            assert verdict(gathered) == (True, "")


def test_robot_at_one_elevation_does_not_tell_the_mounting() -> None:
    """A level circle around the person: whatever the sensor does upwards, nothing contradicts it."""
    for turn in ("left", "right", "backwards"):
        for seed in range(5):
            assert verdict(following(seed, TURNS[turn], rise_m=0.0, is_around=True))[1] == ""


def test_no_pointings_give_no_slope() -> None:
    gathered = following(1, TURNS["along"])
    found = solve(gathered, SolverSettings())
    assert isinstance(found, Solution)
    nothing = gathered.only(np.zeros(len(gathered), dtype=np.bool_))
    assert mounting_slope(nothing, found, SolverSettings(), 0.0, independent=20.0) is None


@pytest.mark.parametrize("ahead_s", [(0.0,), (60.0, 0.0)], ids=["one tracker", "another with a wrong clock"])
@pytest.mark.parametrize(("turn", "how"), [("left", "across the arm"), ("backwards", "backwards on the arm")])
def test_procedure_refuses_a_wrong_mounting_and_says_what_to_do(
    turn: str, how: str, ahead_s: tuple[float, ...]
) -> None:
    gathered = following(1, TURNS[turn])
    procedure = MovingTarget(config(give_up_s=9.5))
    outputs = procedure.start(START_NS)
    rows = zip(gathered.stamps_s, gathered.origins_m, gathered.directions, gathered.targets_m, strict=True)
    for t_s, origin, direction, target in rows:
        stamp_ns = START_NS + round(t_s * NS_PER_S)
        ray = PointingRay(
            stamp_ns=stamp_ns, origin_m=tuple(origin.tolist()), direction=tuple(direction.tolist())
        )
        procedure.on_ray(ray)
        for number, offset_s in enumerate(ahead_s):
            procedure.on_objects(f"tracker {number}", robots(t_s + offset_s, drone=tuple(target.tolist())))
        outputs += procedure.step(stamp_ns)
    assert poses(outputs) == []
    last = told(outputs)[-1]
    assert last.phase == "refused"
    assert f"seems to be mounted {how}; run `pointit person calibrate mounting" in last.reason


@pytest.mark.parametrize("name", ["motion_relloc", "proximity_waypoints"])
def test_no_recorded_person_is_said_to_wear_the_sensor_wrong(name: str) -> None:
    accepted = doubted = 0
    for trial in read_trials(data_file("recordings"), [name]).trials:
        if trial.condition not in ("3 s", "5 s", "10 s"):
            continue
        is_accepted, fault = verdict(trial.pointings)
        assert "seems to be mounted" not in fault, (trial.subject, trial.condition, fault)
        accepted += is_accepted
        doubted += bool(fault)
        assert not (fault and trial.condition == "10 s")  # a whole window leaves no doubt
    assert doubted <= 0.025 * accepted  # 6 of 246: windows of 3 s tell a mounting less well than a whole one


@pytest.mark.parametrize("turn", ["left", "right", "backwards"])
def test_recorded_arms_with_a_sensor_turned_on_them_are_refused(turn: str) -> None:
    """A recorded operator, whose arm rolls as arms do; windows of 10 s."""
    folder = data_file("recordings/motion_relloc")
    arm = ArmFrame(rotation.multiply(MOUNTINGS[motion_relloc.MOUNTING], TURNS[turn]))
    faults: list[str] = []
    for entry in read_index(folder):
        path = file_of(folder, entry) if entry.get("kind") == motion_relloc.KIND else None
        if path is None:
            continue
        recorded = read_imu_csv(path)
        assert recorded.robot_m is not None
        for start_s in np.arange(0.0, float(recorded.t_s[-1]) - 10.0, 3.0):
            part = (recorded.t_s >= start_s) & (recorded.t_s < start_s + 10.0)
            sensors: list[Quaternion] = [tuple(row) for row in recorded.orientation_xyzw[part].tolist()]
            rays = eye_finger_rays((arm.orientation(each) for each in sensors), OPERATOR)
            gathered = Pointings(recorded.t_s[part] - start_s, *rays, recorded.robot_m[part])
            is_accepted, fault = verdict(gathered)
            assert fault or not is_accepted
            faults.append(fault)
    assert np.mean(["seems to be mounted" in fault for fault in faults]) > 0.7


def test_rays_that_do_not_follow_are_not_blamed_on_the_sensor() -> None:
    gathered = following(2, TURNS["along"])
    generator = np.random.default_rng(3)
    for _ in range(20):
        other = generator.normal(0.0, 1.0, (10, 3)).repeat(25, axis=0)
        aside = Pointings(
            gathered.stamps_s,
            gathered.origins_m,
            other / np.linalg.norm(other, axis=1)[:, None],
            gathered.targets_m,
        )
        result = solve(aside, SolverSettings())
        assert isinstance(result, Refusal)
        assert mounting_fault(aside, result, SolverSettings(), 0.0) == ""
