"""A simulated robot that says what becomes of its orders."""

import math
import zlib
from itertools import chain

import numpy as np
from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.services.robot.drivers.sim.ground_robot import SimulatedGroundRobot
from pointit.services.robot.drivers.sim.motion_limits import MotionLimits, ordered_speed
from pointit.services.robot.drivers.sim.quadrotor import SimulatedQuadrotor
from pointit.services.robot.robot_driver import (
    Command,
    Follow,
    FollowPath,
    Land,
    OrderStatus,
    RobotReport,
    RobotSpec,
    Stop,
    TakeOff,
)


class SimConfig(Config):
    """A simulated robot."""

    seed: int = Field(default=0, ge=0, description="seed of a quadrotor's wander while it hovers")
    max_jerk_mps3: float = Field(
        default=15.0, gt=0, le=1000, description="quadrotor: limit of its jerk, m/s³"
    )


SimulatedRobot = SimulatedGroundRobot | SimulatedQuadrotor
"""The motion of a robot in steps of `STEP_S`."""


def make_simulated_robot(config: SimConfig, spec: RobotSpec) -> SimulatedRobot:
    """Return the robot of `spec` at rest where it starts; the same seed and name wander in the same way."""
    limits = MotionLimits(
        max_speed_mps=spec.max_speed_mps,
        max_acceleration_mps2=spec.max_acceleration_mps2,
        max_jerk_mps3=config.max_jerk_mps3,
    )
    if spec.kind == "ground":
        return SimulatedGroundRobot(spec.start_m, spec.start_yaw_rad, limits)
    rng = np.random.default_rng([config.seed, zlib.crc32(spec.name.encode())])
    return SimulatedQuadrotor(spec.start_m, spec.start_yaw_rad, limits, rng)


class OrderedRobot:
    """A simulated robot and the statuses of its orders."""

    def __init__(self, config: SimConfig, spec: RobotSpec) -> None:
        self._robot = make_simulated_robot(config, spec)
        self._current: int | None = None
        """Order that is neither done nor replaced and needs a status."""
        self._statuses: list[OrderStatus] = []

    def command(self, command: Command, problem: str = "") -> None:
        """Carry out `command`, or refuse it, because of `problem` or by itself."""
        problem = problem or _problem(command) or self._robot.command(command)
        if problem:
            self._statuses.append(OrderStatus(command.order, "refused", problem))
            return
        if self._current is not None:
            self._statuses.append(OrderStatus(self._current, "cancelled"))
        self._current = None
        if not isinstance(command, Follow):
            self._current = command.order
            self._statuses.append(OrderStatus(command.order, "active"))

    def step(self) -> None:
        """Advance by `STEP_S`."""
        self._robot.step()
        if self._current is not None and self._robot.is_done:
            self._statuses.append(OrderStatus(self._current, "done"))
            self._current = None

    def take_statuses(self) -> list[OrderStatus]:
        """Return the statuses since the last call."""
        taken, self._statuses = self._statuses, []
        return taken

    def report(self, stamp_ns: int) -> RobotReport:
        """Return its pose at `stamp_ns`."""
        return self._robot.report(stamp_ns)


def _problem(command: Command) -> str:
    """Return an error message if a number of `command` cannot be used, else `""`."""
    speed_mps = ordered_speed(command)
    if not speed_mps > 0.0:
        return f"its speed is limited to {speed_mps:g} m/s: the limit must be above 0"
    match command:
        case Follow(position_m=position_m, yaw_rad=yaw_rad):
            numbers = [*position_m, yaw_rad or 0.0]
        case FollowPath(points_m=points_m, yaw_rad=yaw_rad):
            if not points_m:
                return "the path has no points"
            numbers = [*chain.from_iterable(points_m), yaw_rad or 0.0]
        case TakeOff(height_m=height_m):
            numbers = [height_m]
        case Land(position_m=position_m):
            numbers = list(position_m or ())
        case Stop():
            numbers = []
    return "" if all(map(math.isfinite, numbers)) else "its position, direction or height is not a number"
