"""Courses of random commands for simulated robots, and the motion that results."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.robot.drivers.sim.motion_limits import STEP_S
from pointit.services.robot.drivers.sim.ordered_robot import SimulatedRobot
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land, Stop, TakeOff

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
    """Return the poses of `robot` after each step of `course`."""
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
    """Return the current pose of `robot`."""
    report = robot.report(0)
    return Pose(report.position_m, report.yaw_rad)


def rates(values: Sequence[Vec3]) -> list[Vec3]:
    """Return the changes of `values` per second."""
    return [vector.scale(vector.subtract(after, before), 1.0 / STEP_S) for before, after in pairwise(values)]


def longest(values: Sequence[Vec3]) -> float:
    """Return the largest norm of `values`."""
    return max(map(vector.norm, values), default=0.0)


def horizontal(a: Vec3, b: Vec3) -> float:
    """Return the horizontal distance between `a` and `b`."""
    return vector.norm((a[0] - b[0], a[1] - b[1], 0.0))
