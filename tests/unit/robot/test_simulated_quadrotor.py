"""The simulated quadrotor keeps its limits, arrives, and carries out the newest command."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.services.robot.drivers.sim.motion_limits import STEP_S, MotionLimits
from pointit.services.robot.drivers.sim.quadrotor import (
    WANDER_LIMIT,
    WANDER_SD_M,
    SimulatedQuadrotor,
    SmoothMotion,
)
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land, Stop, TakeOff
from tests.unit.robot.robot_course import (
    commands,
    coordinates,
    courses,
    drive,
    horizontal,
    longest,
    places,
    pose_of,
    rates,
    settle,
)

LIMITS = MotionLimits(max_speed_mps=1.5, max_acceleration_mps2=2.0, max_jerk_mps3=15.0)
MARGIN = 1.0 + 1e-6
WANDER_M = WANDER_LIMIT * vector.norm(WANDER_SD_M)


def quadrotor(seed: int = 0) -> SimulatedQuadrotor:
    return SimulatedQuadrotor((0.0, 0.0, 0.0), 0.0, LIMITS, np.random.default_rng(seed))


def flying(height_m: float = 1.0) -> SimulatedQuadrotor:
    robot = quadrotor()
    settle(robot, TakeOff(1, height_m))
    return robot


@given(courses)
def test_speed_acceleration_and_jerk_stay_within_limits_at_any_command(
    course: list[tuple[Command, int]],
) -> None:
    positions = [pose.position_m for pose in drive(quadrotor(), [(TakeOff(0, 0.5), 60), *course])]
    speeds = rates(positions)
    accelerations = rates(speeds)
    assert longest(speeds) <= LIMITS.max_speed_mps * MARGIN
    assert longest(accelerations) <= LIMITS.max_acceleration_mps2 * MARGIN
    assert longest(rates(accelerations)) <= LIMITS.max_jerk_mps3 * MARGIN
    assert min(z for _, _, z in positions) >= -1e-9, "beneath the ground"


@given(courses, places)
def test_a_place_is_reached_after_any_commands(course: list[tuple[Command, int]], place: vector.Vec3) -> None:
    robot = quadrotor()
    drive(robot, course)
    if not robot.is_flying:
        settle(robot, TakeOff(1, 0.5))
    settle(robot, FollowPath(2, (place,)))
    for step in range(200):
        robot.step()
        assert step < 100 or vector.norm(vector.subtract(pose_of(robot).position_m, place)) <= WANDER_M + 0.02


@given(courses, st.none() | st.tuples(coordinates, coordinates, st.floats(0.0, 1.0)))
def test_it_lands_on_the_place_after_any_commands(
    course: list[tuple[Command, int]], place: vector.Vec3 | None
) -> None:
    robot = quadrotor()
    drive(robot, [*course, (TakeOff(0, 0.5), 1)])
    settle(robot, Land(1, place))
    landed = pose_of(robot)
    assert not robot.is_flying
    if place is not None:
        assert horizontal(landed.position_m, place) <= WANDER_M + 1e-6
    robot.step()
    assert pose_of(robot) == landed


def test_it_flies_to_the_place_of_its_landing_no_faster_than_told() -> None:
    robot = flying()
    robot.command(Land(1, (2.0, 0.0, 0.0), 0.4))
    fastest_mps = 0.0
    for _ in range(2000):
        robot.step()
        fastest_mps = max(fastest_mps, vector.norm(robot.report(0).velocity_mps))
    assert not robot.is_flying
    assert 0.35 < fastest_mps < 0.45


@given(courses)
def test_a_stop_brakes_to_a_hover_within_the_stated_time(course: list[tuple[Command, int]]) -> None:
    robot = flying()
    drive(robot, course)
    if not robot.is_flying:
        return
    speed = vector.norm(robot.report(0).velocity_mps)
    braking_s = LIMITS.max_speed_mps / LIMITS.max_acceleration_mps2
    jerk_s = 2.0 * LIMITS.max_acceleration_mps2 / LIMITS.max_jerk_mps3
    before = pose_of(robot).position_m
    took_s = settle(robot, Stop(1))
    assert took_s <= braking_s + jerk_s + 2 * STEP_S
    way_m = vector.norm(vector.subtract(pose_of(robot).position_m, before))
    assert way_m <= LIMITS.max_speed_mps * (braking_s / 2.0 + jerk_s) + 0.05, f"from {speed:.2f} m/s"
    here = pose_of(robot).position_m
    for _ in range(200):
        robot.step()
        assert vector.norm(vector.subtract(pose_of(robot).position_m, here)) <= 2.0 * WANDER_M + 0.02


@given(
    st.lists(st.tuples(st.tuples(*[st.floats(0.0, 3.0)] * 3), st.integers(1, 150)), min_size=2, max_size=10)
)
def test_set_points_within_a_box_lead_it_out_by_centimetres_at_most(
    targets: list[tuple[vector.Vec3, int]],
) -> None:
    motion = SmoothMotion((1.5, 1.5, 1.5), LIMITS)
    for target_m, steps in targets:
        for _ in range(steps):
            motion.step(target_m)
            assert all(-0.05 <= along_m <= 3.05 for along_m in motion.position_m)


@given(commands)
def test_on_the_ground_it_flies_nowhere_before_it_has_taken_off(command: Command) -> None:
    robot = quadrotor()
    refused = robot.command(command)
    for _ in range(50):
        robot.step()
    if isinstance(command, (Follow, FollowPath)):
        assert "take off" in refused
    if not isinstance(command, TakeOff):
        assert pose_of(robot).position_m == (0.0, 0.0, 0.0)


def test_it_hovers_with_the_wander_of_a_small_quadrotor() -> None:
    robot = flying()
    at = [pose.position_m for pose in drive(robot, [(Follow(2, (1.0, 1.0, 1.0)), 8000)])][1000:]
    sd_m = np.std(np.array(at), axis=0)
    assert 0.005 < sd_m[0] < 0.02
    assert 0.005 < sd_m[1] < 0.02
    assert 0.002 < sd_m[2] < 0.012


def test_the_same_seed_flies_the_same_way_and_another_does_not() -> None:
    course: list[tuple[Command, int]] = [(TakeOff(0, 0.5), 300), (Follow(1, (1.0, 2.0, 0.7)), 300)]
    assert drive(quadrotor(1), course) == drive(quadrotor(1), course)
    assert drive(quadrotor(1), course) != drive(quadrotor(2), course)


def test_it_follows_a_moving_set_point_with_less_than_half_a_metre_of_lag() -> None:
    robot = flying()
    gaps_m: list[float] = []
    for step in range(600):
        angle = 0.5 * step * STEP_S
        target = (math.cos(angle), math.sin(angle), 1.0)
        robot.command(Follow(step, target))
        robot.step()
        gaps_m.append(vector.norm(vector.subtract(pose_of(robot).position_m, target)))
    assert max(gaps_m[300:]) < 0.5


def test_the_same_landing_ordered_again_and_again_still_ends() -> None:
    robot = flying()
    for _ in range(200):
        robot.command(Land(1, (1.0, 0.0, 0.0)))
        for _ in range(10):
            robot.step()
    assert not robot.is_flying


def test_a_path_is_followed_along_its_corners() -> None:
    robot = flying()
    corners = ((2.0, 0.0, 1.0), (2.0, 2.0, 1.0), (0.0, 2.0, 1.0))
    robot.command(FollowPath(1, corners))
    apart_m = dict.fromkeys(corners, math.inf)
    while not robot.is_done:
        robot.step()
        for corner in corners:
            distance_m = vector.norm(vector.subtract(pose_of(robot).position_m, corner))
            apart_m[corner] = min(apart_m[corner], distance_m)
    assert max(apart_m.values()) < 0.2
