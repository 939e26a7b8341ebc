"""Sensors that sit across the arm or backwards, while the person follows a robot."""

import dataclasses
import math

import numpy as np
import pytest

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, BodyMeasures, PointingRay
from pointit.services.localizer.estimation import mounting
from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.estimation.mounting import Slope, mounting_fault
from pointit.services.localizer.moving_target import MovingTarget
from pointit.services.localizer.outputs import Output
from pointit.services.pointing.pointer import ArmRay
from tests.unit.localizer.person import EYES_M, START_NS, config, poses, solved, told
from tests.unit.localizer.test_moving_target import robots

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
    away = generator.uniform(1.8, 3.0)
    towards = generator.uniform(0.0, math.tau)
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
    east, north, up = (targets - [x, y, EYES_M]).T
    elevations = np.arctan2(up, np.hypot(east, north))
    elevations += unrest[:, 1] + generator.normal(0.0, math.radians(4.0))
    raised = elevations + np.arcsin(BODY.neck_to_eyes_m * np.cos(elevations) / ARM_M)
    azimuths = np.arctan2(north, east) + unrest[:, 0] - generator.uniform(-3.0, 3.0)
    rolls = unrest[:, 2] + generator.normal(0.0, math.radians(10.0))

    sensors = [
        rotation.multiply(rotation.from_azimuth_elevation(*arm), turn)
        for arm in np.column_stack([azimuths, raised, rolls]).tolist()
    ]
    return Pointings(t_s, *ArmRay(BODY).rays(np.array(sensors)), targets)


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


def test_rays_that_do_not_follow_are_not_blamed_on_sensors() -> None:
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


SURE = Slope(value=0.0, sigma=0.05, freedom=18.0, sideways_rad=0.03)
"""Slope of a sensor across the arm, in a window of 10 s."""


def said(monkeypatch: pytest.MonkeyPatch, slope: Slope, *, is_refused: bool = False) -> str:
    """Return the message about `slope` with accepted or refused rays."""
    gathered = following(1, TURNS["along"])

    def measured(*_: object, independent: float) -> Slope:
        del independent
        return slope

    monkeypatch.setattr(mounting, "mounting_slope", measured)
    result = Refusal("the rays miss", 0.3) if is_refused else solved(gathered)
    return mounting_fault(gathered, result, SolverSettings(), 0.0)


@pytest.mark.parametrize(("value", "how"), [(0.2, "across"), (-0.4, "across"), (-0.6, "backwards on")])
@pytest.mark.parametrize("is_refused", [False, True])
def test_recorded_slopes_are_told_apart(
    monkeypatch: pytest.MonkeyPatch, value: float, how: str, *, is_refused: bool
) -> None:
    """People's arms with a sensor across them have slopes of -0.6 to 0.5, backwards of -1 to -0.6."""
    fault = said(monkeypatch, dataclasses.replace(SURE, value=value), is_refused=is_refused)
    assert f"seems to be mounted {how} the arm" in fault


@pytest.mark.parametrize(
    ("sigma", "value", "is_told"), [(0.2, 0.4, True), (0.3, 0.4, False), (0.2, 0.6, False)]
)
def test_slope_that_is_uncertain_is_no_reason_for_doubt(
    monkeypatch: pytest.MonkeyPatch, sigma: float, value: float, *, is_told: bool
) -> None:
    slope = dataclasses.replace(SURE, value=value, sigma=sigma)
    fault = said(monkeypatch, slope)
    assert ("the rays rise and sink only 0.4 times as much as the robot" in fault) == bool(fault) == is_told
    assert said(monkeypatch, slope, is_refused=True) == ""  # then the rays miss for another reason


def test_procedure_goes_on_while_a_mounting_is_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    """No pose is accepted before the slope is clear, and the reason is published meanwhile."""
    slopes = [dataclasses.replace(SURE, value=0.45, sigma=0.2)]

    def measured(*_: object, **__: object) -> Slope:
        return slopes[0]

    monkeypatch.setattr(mounting, "mounting_slope", measured)
    gathered = following(1, TURNS["along"])
    procedure = MovingTarget(config(give_up_s=30.0))
    procedure.start(START_NS)
    outputs = list[Output]()
    rows = zip(gathered.stamps_s, gathered.origins_m, gathered.directions, gathered.targets_m, strict=True)
    for t_s, origin, direction, target in rows:
        stamp_ns = START_NS + round(t_s * NS_PER_S)
        if t_s > 8.0:
            slopes[0] = dataclasses.replace(SURE, value=0.9)
        procedure.on_ray(
            PointingRay(
                stamp_ns=stamp_ns, origin_m=tuple(origin.tolist()), direction=tuple(direction.tolist())
            )
        )
        procedure.on_objects("tracker", robots(t_s, drone=tuple(target.tolist())))
        outputs += procedure.step(stamp_ns)

    assert [pose.stamp_ns > START_NS + 8 * NS_PER_S for pose in poses(outputs)] == [True]
    assert any("rise and sink only 0.5 times" in each.reason for each in told(outputs))
