"""Simulated robots and their driver."""

import asyncio
import contextlib
import math
from collections.abc import AsyncGenerator, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.service.plugin_guard import NullHealth, Surroundings
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import RobotKind
from pointit.services.robot.drivers.quadrotor import (
    STEP_S,
    WANDER_LIMIT,
    WANDER_SD_M,
    MotionLimits,
    SimulatedQuadrotor,
)
from pointit.services.robot.drivers.sim_driver import (
    FACING_RAD,
    SIM,
    THERE_M,
    TURN_RADPS,
    TURN_RADPS2,
    SimConfig,
    SimulatedGroundRobot,
    SimulatedRobot,
)
from pointit.services.robot.robot_driver import (
    Command,
    Follow,
    FollowPath,
    Land,
    OrderStatus,
    ReportItem,
    RobotDriver,
    RobotReport,
    Stop,
    TakeOff,
)
from tests.unit.robot.vda5050.agv_bench import SPEC

coordinates = st.floats(-4.0, 4.0, allow_subnormal=False)
places = st.tuples(coordinates, coordinates, st.floats(0.0, 2.0, allow_subnormal=False))
yaws = st.none() | st.floats(-7.0, 7.0)
commands: SearchStrategy[Command] = st.one_of(
    st.builds(Follow, st.just(0), places, yaws),
    st.builds(
        FollowPath,
        st.just(0),
        st.lists(places, min_size=1, max_size=4).map(tuple),
        yaws,
        st.none() | st.floats(0.1, 3.0),
    ),
    st.builds(TakeOff, st.just(0), st.floats(0.1, 2.0)),
    st.builds(Land, st.just(0), st.none() | places),
    st.builds(Stop, st.just(0)),
)
courses = st.lists(st.tuples(commands, st.integers(1, 150)), min_size=1, max_size=12)
"""Commands, each with the number of steps until the next."""


@dataclass(frozen=True)
class Pose:
    """A pose of a course."""

    position_m: Vec3
    yaw_rad: float


def drive(robot: SimulatedRobot, course: Iterable[tuple[Command, int]]) -> list[Pose]:
    poses: list[Pose] = []
    for command, steps in course:
        robot.command(command)
        for _ in range(steps):
            poses.append(pose_of(robot))
            robot.step()
    return poses


def settle(robot: SimulatedRobot, command: Command, *, limit_s: float = 60.0) -> float:
    """Return the time that `robot` needs for `command`, s."""
    assert robot.command(command) == ""
    for step in range(round(limit_s / STEP_S)):
        if robot.is_done:
            return step * STEP_S
        robot.step()
    raise AssertionError(f"{command} is not done within {limit_s} s, at {robot.report(0)}")


def pose_of(robot: SimulatedRobot) -> Pose:
    report = robot.report(0)
    return Pose(report.position_m, report.yaw_rad)


def rates(values: Sequence[Vec3]) -> list[Vec3]:
    return [vector.scale(vector.subtract(after, before), 1.0 / STEP_S) for before, after in pairwise(values)]


def longest(values: Sequence[Vec3]) -> float:
    return max(map(vector.norm, values), default=0.0)


def horizontal(a: Vec3, b: Vec3) -> float:
    return vector.norm((a[0] - b[0], a[1] - b[1], 0.0))


LIMITS = MotionLimits(max_speed_mps=1.5, max_acceleration_mps2=2.0, max_jerk_mps3=15.0)
GROUND_LIMITS = MotionLimits(max_speed_mps=0.8, max_acceleration_mps2=1.0, max_jerk_mps3=15.0)
MARGIN = 1.0 + 1e-6
WANDER_M = WANDER_LIMIT * vector.norm(WANDER_SD_M)


def quadrotor(seed: int = 0) -> SimulatedQuadrotor:
    return SimulatedQuadrotor((0.0, 0.0, 0.0), 0.0, LIMITS, np.random.default_rng(seed))


def flying(height_m: float = 1.0) -> SimulatedQuadrotor:
    robot = quadrotor()
    settle(robot, TakeOff(1, height_m))
    return robot


def ground_robot() -> SimulatedGroundRobot:
    return SimulatedGroundRobot((0.0, 0.0, 0.0), 0.0, GROUND_LIMITS)


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
def test_place_is_reached_after_any_commands(course: list[tuple[Command, int]], place: vector.Vec3) -> None:
    robot = quadrotor()
    drive(robot, course)
    if not robot.is_flying:
        settle(robot, TakeOff(1, 0.5))
    settle(robot, FollowPath(2, (place,)))
    for step in range(200):
        robot.step()
        assert step < 100 or vector.norm(vector.subtract(pose_of(robot).position_m, place)) <= WANDER_M + 0.02


@given(courses, st.none() | st.tuples(coordinates, coordinates, st.floats(0.0, 1.0)))
def test_quadrotor_lands_on_the_place_after_any_commands(
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


@given(courses)
def test_stop_brakes_to_a_hover_within_the_stated_time(course: list[tuple[Command, int]]) -> None:
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


def test_wander_is_the_same_for_the_same_seed_only() -> None:
    course: list[tuple[Command, int]] = [(TakeOff(0, 0.5), 300), (Follow(1, (1.0, 2.0, 0.7)), 300)]
    assert drive(quadrotor(1), course) == drive(quadrotor(1), course)
    assert drive(quadrotor(1), course) != drive(quadrotor(2), course)


@given(courses)
def test_speed_acceleration_and_turn_rate_are_limited_for_any_command(
    course: list[tuple[Command, int]],
) -> None:
    poses = drive(ground_robot(), course)
    speeds = [horizontal(after.position_m, before.position_m) / STEP_S for before, after in pairwise(poses)]
    turns = [vector.wrap(after.yaw_rad - before.yaw_rad) / STEP_S for before, after in pairwise(poses)]
    assert max(speeds, default=0.0) <= GROUND_LIMITS.max_speed_mps * MARGIN
    for before, after in pairwise(speeds):
        assert abs(after - before) / STEP_S <= GROUND_LIMITS.max_acceleration_mps2 * MARGIN
    assert max(map(abs, turns), default=0.0) <= TURN_RADPS * MARGIN
    for before, after in pairwise(turns):
        assert abs(after - before) / STEP_S <= TURN_RADPS2 * MARGIN
    assert {pose.position_m[2] for pose in poses} == {0.0}


@given(courses)
def test_ground_robot_moves_forwards_only(course: list[tuple[Command, int]]) -> None:
    for before, after in pairwise(drive(ground_robot(), course)):
        step = vector.subtract(after.position_m, before.position_m)
        if vector.norm(step) > 1e-9:
            turn = abs(vector.wrap(after.yaw_rad - before.yaw_rad))
            assert abs(vector.wrap(vector.azimuth(step) - before.yaw_rad)) <= turn + 1e-6


@given(courses, st.lists(places, min_size=1, max_size=5).map(tuple), yaws)
def test_path_ends_at_its_last_point_facing_as_ordered(
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
def test_stop_brakes_within_the_stated_time_and_way(course: list[tuple[Command, int]]) -> None:
    robot = ground_robot()
    drive(robot, course)
    before = pose_of(robot).position_m
    braking_s = GROUND_LIMITS.max_speed_mps / GROUND_LIMITS.max_acceleration_mps2
    turning_s = TURN_RADPS / TURN_RADPS2
    assert settle(robot, Stop(1)) <= max(braking_s, turning_s) + 2 * STEP_S
    stopped = pose_of(robot)
    assert horizontal(stopped.position_m, before) <= GROUND_LIMITS.max_speed_mps * braking_s / 2.0 + 0.01
    for _ in range(50):
        robot.step()
    assert pose_of(robot) == stopped


class Pilot:
    """Gives a driver commands, and collects what it reports."""

    def __init__(self, kind: RobotKind, clock: VirtualClock) -> None:
        spec = replace(SPEC, kind=kind)
        surroundings = Surroundings(clock=clock, health=NullHealth(), folder=Path("unused"))
        self.driver: RobotDriver = SIM.make(SimConfig(), spec, surroundings)
        self.items: list[ReportItem] = []

    @property
    def poses(self) -> list[RobotReport]:
        return [item for item in self.items if isinstance(item, RobotReport)]

    def states(self, order: int) -> list[str]:
        return [item.state for item in self.items if isinstance(item, OrderStatus) and item.order == order]

    @contextlib.asynccontextmanager
    async def connected(self) -> AsyncGenerator[None]:
        async with asyncio.TaskGroup() as group:
            task = group.create_task(self.driver.run(self.items.append))
            await asyncio.sleep(0.1)
            yield
            task.cancel()


def fly(
    *orders: tuple[Command, float], kind: RobotKind = "quadrotor", clock: VirtualClock | None = None
) -> Pilot:
    """Return the pilot after `orders`, each with the time of the loop until the next, s."""

    async def flight() -> Pilot:
        pilot = Pilot(kind, clock or VirtualClock())
        async with pilot.connected():
            for command, wait_s in orders:
                pilot.driver.command(command)
                await asyncio.sleep(wait_s)
        return pilot

    return run_virtually(flight())


def test_orders_are_active_then_done_or_cancelled_when_replaced() -> None:
    pilot = fly(
        (TakeOff(1, 0.5), 4.0),
        (FollowPath(2, ((5.0, 0.0, 0.5),)), 1.0),
        (Follow(3, (0.0, 0.0, 0.5)), 2.0),
        (Stop(4), 2.0),
        (Land(5), 10.0),
    )
    assert pilot.states(1) == ["active", "done"]
    assert pilot.states(2) == ["active", "cancelled"]
    assert pilot.states(3) == []
    assert pilot.states(4) == ["active", "done"]
    assert pilot.states(5) == ["active", "done"]
    assert not pilot.poses[-1].is_flying


@pytest.mark.parametrize("refused", [TakeOff(2, 1.0), Land(2)], ids=["take-off", "landing"])
def test_refused_order_has_a_reason_and_leaves_the_previous_one(refused: Command) -> None:
    pilot = fly((FollowPath(1, ((1.0, 0.0, 0.0),)), 0.5), (refused, 4.0), kind="ground")
    assert pilot.states(1) == ["active", "done"]
    [said] = [item.reason for item in pilot.items if isinstance(item, OrderStatus) and item.order == 2]
    assert "ground robot" in said
    assert pilot.states(2) == ["refused"]
    assert pilot.poses[-1].position_m == pytest.approx((1.0, 0.0, 0.0), abs=0.03)


@pytest.mark.parametrize("kind", ["ground", "quadrotor"])
@pytest.mark.parametrize(
    "command",
    [Follow(2, (9.0, 0.0, 0.5), max_speed_mps=0.3), FollowPath(2, ((9.0, 0.0, 0.5),), max_speed_mps=0.3)],
    ids=["follow", "path"],
)
def test_speed_limit_of_an_order_is_kept(kind: RobotKind, command: Command) -> None:
    pilot = fly((TakeOff(1, 0.5), 4.0), (command, 4.0), kind=kind)
    assert 0.25 < max(math.hypot(*pose.velocity_mps[:2]) for pose in pilot.poses) < 0.301


def test_robot_that_is_reconnected_stops() -> None:
    async def drive() -> Pilot:
        pilot = Pilot("ground", VirtualClock())
        async with pilot.connected():
            pilot.driver.command(Follow(1, (9.0, 0.0, 0.0)))
            await asyncio.sleep(2.0)
        async with pilot.connected():
            await asyncio.sleep(3.0)
        return pilot

    assert run_virtually(drive()).poses[-1].velocity_mps == (0.0, 0.0, 0.0)
