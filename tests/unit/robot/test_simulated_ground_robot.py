"""The simulated ground robot keeps its limits, arrives, and carries out the newest command."""

import math
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.services.robot.drivers.sim.ground_robot import (
    AHEAD_RAD,
    FACING_RAD,
    THERE_M,
    TURN_RADPS,
    TURN_RADPS2,
    SimulatedGroundRobot,
)
from pointit.services.robot.drivers.sim.motion_limits import STEP_S, MotionLimits
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Stop
from tests.unit.robot.robot_course import courses, drive, horizontal, places, pose_of, settle, yaws

LIMITS = MotionLimits(max_speed_mps=0.8, max_acceleration_mps2=1.0, max_jerk_mps3=15.0)
MARGIN = 1.0 + 1e-6


def ground_robot() -> SimulatedGroundRobot:
    return SimulatedGroundRobot((0.0, 0.0, 0.0), 0.0, LIMITS)


@given(courses)
def test_speed_acceleration_and_turn_rate_stay_within_limits_at_any_command(
    course: list[tuple[Command, int]],
) -> None:
    poses = drive(ground_robot(), course)
    speeds = [horizontal(after.position_m, before.position_m) / STEP_S for before, after in pairwise(poses)]
    turns = [vector.wrap(after.yaw_rad - before.yaw_rad) / STEP_S for before, after in pairwise(poses)]
    assert max(speeds, default=0.0) <= LIMITS.max_speed_mps * MARGIN
    for before, after in pairwise(speeds):
        assert abs(after - before) / STEP_S <= LIMITS.max_acceleration_mps2 * MARGIN
    assert max(map(abs, turns), default=0.0) <= TURN_RADPS * MARGIN
    for before, after in pairwise(turns):
        assert abs(after - before) / STEP_S <= TURN_RADPS2 * MARGIN
    assert {pose.position_m[2] for pose in poses} == {0.0}


@given(courses)
def test_it_moves_forwards_only_and_never_sideways(course: list[tuple[Command, int]]) -> None:
    for before, after in pairwise(drive(ground_robot(), course)):
        step = vector.subtract(after.position_m, before.position_m)
        if vector.norm(step) > 1e-9:
            turn = abs(vector.wrap(after.yaw_rad - before.yaw_rad))
            assert abs(vector.wrap(vector.azimuth(step) - before.yaw_rad)) <= turn + 1e-6


@given(courses, st.lists(places, min_size=1, max_size=5).map(tuple), yaws)
def test_the_end_of_a_path_is_reached_after_any_commands_facing_as_ordered(
    course: list[tuple[Command, int]], points: tuple[vector.Vec3, ...], yaw_rad: float | None
) -> None:
    robot = ground_robot()
    drive(robot, course)
    settle(robot, FollowPath(1, points, yaw_rad), limit_s=120.0)
    pose = pose_of(robot)
    assert horizontal(pose.position_m, points[-1]) <= THERE_M + 1e-9
    if yaw_rad is not None:
        assert abs(vector.wrap(pose.yaw_rad - yaw_rad)) <= FACING_RAD
    for _ in range(100):
        robot.step()
    assert pose_of(robot) == pose


@given(courses)
def test_a_stop_brakes_within_the_stated_time_and_way(course: list[tuple[Command, int]]) -> None:
    robot = ground_robot()
    drive(robot, course)
    before = pose_of(robot).position_m
    braking_s = LIMITS.max_speed_mps / LIMITS.max_acceleration_mps2
    turning_s = TURN_RADPS / TURN_RADPS2
    assert settle(robot, Stop(1)) <= max(braking_s, turning_s) + 2 * STEP_S
    stopped = pose_of(robot)
    assert horizontal(stopped.position_m, before) <= LIMITS.max_speed_mps * braking_s / 2.0 + 0.01
    for _ in range(50):
        robot.step()
    assert pose_of(robot) == stopped


def test_it_turns_in_place_towards_a_target_behind_it() -> None:
    poses = drive(ground_robot(), [(Follow(1, (-2.0, 0.0, 0.0)), 300)])
    turning = [pose for pose in poses if abs(vector.wrap(pose.yaw_rad - math.pi)) > AHEAD_RAD]
    assert 0 < len(turning) < len(poses)
    assert {pose.position_m for pose in turning} == {(0.0, 0.0, 0.0)}


def test_a_path_is_followed_along_its_corners() -> None:
    robot = ground_robot()
    corners = ((2.0, 0.0, 0.0), (2.0, 2.0, 0.0), (0.0, 2.0, 0.0))
    robot.command(FollowPath(1, corners))
    apart_m = dict.fromkeys(corners, math.inf)
    while not robot.is_done:
        robot.step()
        for corner in corners:
            apart_m[corner] = min(apart_m[corner], horizontal(pose_of(robot).position_m, corner))
    assert max(apart_m.values()) < 0.12
