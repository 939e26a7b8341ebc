"""Pointings at lamps: one at another lamp is not taken, nor are those of a sensor across the arm."""

import math

import numpy as np
import pytest

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, BodyMeasures, Lamp, PointingRay, UserPose
from pointit.services.localizer.estimation.estimator import Pointings, Refusal, Solution, SolverSettings
from pointit.services.localizer.procedures.static_targets import StaticTargets
from pointit.services.localizer.verification.holds import held, odd_hold
from pointit.services.pointing.arm_ray import ArmRay
from tests.unit.localizer.person import EYES_M, START_NS, Person, config, told
from tests.unit.localizer.test_static_targets import TICK_NS

LAMPS: tuple[Vec3, ...] = (
    (3.0, 2.0, 0.1),
    (-3.0, 2.5, 0.9),
    (-2.5, -3.0, 2.0),
    (3.0, -2.0, 0.3),
    (0.0, 3.5, 2.4),
    (0.5, -3.5, 1.2),
)
RAYS = 40
TURNS: dict[str, Quaternion] = {
    "across": rotation.from_yaw(math.pi / 2.0),
    "backwards": rotation.from_yaw(math.pi),
    "along": rotation.IDENTITY,
}


def pointed(
    seed: int, lamps_m: tuple[Vec3, ...], *, wrong: int | None = None, turn: Quaternion = rotation.IDENTITY
) -> tuple[Person, Pointings]:
    """Return a person, and a hold of 2 s at each of `lamps_m`, each another few degrees off.

    Number `wrong` was at another lamp; the sensor is turned by `turn` on an arm that rolls.
    """
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1.0, 1.0, 2).tolist()
    person = Person(x, y, float(rng.uniform(-3.0, 3.0)), float(rng.normal(0.0, math.radians(4.0))))
    aims = list(lamps_m)
    if wrong is not None:
        aims[wrong] = lamps_m[(wrong + 1) % len(lamps_m)]
    sensors: list[Quaternion] = []
    for aim in aims:
        ray = person.direction(aim)
        off_rad = rng.normal(0.0, np.radians([3.0, 1.5]))
        elevation = vector.elevation(ray) + float(off_rad[1])
        body = BodyMeasures()
        raised = elevation + math.asin(
            body.neck_to_eyes_m * math.cos(elevation) / (body.shoulder_to_wrist_m + body.wrist_to_finger_m)
        )
        arm = rotation.from_azimuth_elevation(vector.azimuth(ray) + float(off_rad[0]), raised)
        rolled = rotation.from_axis_angle((1.0, 0.0, 0.0), float(rng.normal(0.0, math.radians(10.0))))
        sensors += [rotation.multiply(rotation.multiply(arm, rolled), turn)] * RAYS
    origins, directions = ArmRay().rays(np.array(sensors))
    stamps_s = np.arange(len(sensors)) / 20.0 + 2.0 * np.repeat(np.arange(len(aims)), RAYS)
    return person, Pointings(stamps_s, origins, directions, np.repeat(np.array(lamps_m), RAYS, axis=0))


def error_m(found: Solution, person: Person) -> float:
    return math.hypot(found.x_m - person.x, found.y_m - person.y)


@pytest.mark.parametrize("count", [4, 6])
def test_people_who_point_at_the_lamps_are_taken(count: int) -> None:
    found = [held(pointed(seed, LAMPS[:count])[1], SolverSettings()) for seed in range(20)]
    assert sum(isinstance(each, Solution) for each in found) >= 17


def test_one_pointing_at_another_lamp_does_not_count_when_five_others_agree() -> None:
    taken = 0
    for seed in range(20):
        wrong = seed % len(LAMPS)
        person, pointings = pointed(seed, LAMPS, wrong=wrong)
        assert odd_hold(pointings, SolverSettings()) in {wrong, None}
        found = held(pointings, SolverSettings())
        if isinstance(found, Solution):
            taken += 1
            assert error_m(found, person) < max(0.5, 2.0 * found.position_sigma_m)
    assert taken >= 15


def test_one_of_three_or_four_pointings_at_another_lamp_makes_no_sure_wrong_pose() -> None:
    wrong = 0
    for count in (3, 4):
        for seed in range(20):
            person, pointings = pointed(seed, LAMPS[:count], wrong=seed % count)
            found = held(pointings, SolverSettings())
            if isinstance(found, Solution):
                wrong += error_m(found, person) > max(0.5, 2.0 * found.position_sigma_m)
    assert wrong <= 2


def test_pointings_that_agree_leave_none_out() -> None:
    assert {odd_hold(pointed(seed, LAMPS)[1], SolverSettings()) for seed in range(20)} == {None}


@pytest.mark.parametrize("turn", ["across", "backwards"])
def test_turned_sensor_is_named_at_lamps(turn: str) -> None:
    named = 0
    for seed in range(20):
        found = held(pointed(seed, LAMPS[:4], turn=TURNS[turn])[1], SolverSettings())
        assert isinstance(found, Refusal)
        named += f"mounted {'backwards on' if turn == 'backwards' else 'across'} the arm" in found.reason
    assert named >= 10


def test_procedure_tells_which_pointing_does_not_count() -> None:
    lamps = tuple(Lamp(id=name, position_m=at) for name, at in zip("abcdef", LAMPS, strict=True))
    places = {lamp.id: lamp.position_m for lamp in lamps}
    procedure, person = StaticTargets(lamps, config()), Person(0.6, -0.4, 2.2, math.radians(3.0))
    outputs = procedure.start(START_NS)
    for now_ns in range(START_NS, START_NS + 30 * NS_PER_S, TICK_NS):
        lit = told(outputs)[-1].target_id
        aim = places["e" if lit == "b" else lit or "a"]
        direction = person.direction(aim)
        procedure.on_ray(PointingRay(stamp_ns=now_ns, origin_m=(0.0, 0.0, EYES_M), direction=direction))
        outputs += procedure.step(now_ns)
    (pose,) = (each for each in outputs if isinstance(each, UserPose))
    assert math.hypot(pose.position_m[0] - person.x, pose.position_m[1] - person.y) < 0.1
    assert told(outputs)[-1].reason == "pointing 2, at b, missed it by far and does not count"
