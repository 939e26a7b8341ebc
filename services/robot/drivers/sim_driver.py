"""The driver of simulated robots: they move by the clock, in any speed of it.

No core: it moves by the clock.
"""

import math
import zlib
from itertools import chain

import numpy as np
from pydantic import Field

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.clock import ticks
from pointit.runtime.config.config import Config
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import NS_PER_S
from pointit.services.robot.drivers.quadrotor import (
    STEP_S,
    FollowedPath,
    MotionLimits,
    SimulatedQuadrotor,
    braking_speed,
    ordered_speed,
    towards,
)
from pointit.services.robot.robot_driver import (
    Command,
    Follow,
    FollowPath,
    Land,
    OrderStatus,
    Report,
    RobotPlugin,
    RobotReport,
    RobotSpec,
    Stop,
    TakeOff,
)

TURN_RADPS = math.radians(90.0)
"""Limit of the turn rate, rad/s."""
TURN_RADPS2 = math.radians(360.0)
"""Limit of the turn rate's change, rad/s²."""
AHEAD_RAD = math.radians(45.0)
"""Direction to the target beside which it turns in place, rad."""
THERE_M = 0.02
"""Distance from the target at which it has arrived, m."""
FACING_RAD = math.radians(2.0)
"""Angle from the direction to face at which it has turned, rad."""

REPORT_HZ = 50.0
"""Rate of steps and reports, Hz."""
STEP_NS = round(STEP_S * NS_PER_S)
STALL_S = 1.0
"""Wall time without a step after which the robot has stood still meanwhile, instead of jumping, s."""


class SimulatedGroundRobot:
    """A robot on a level floor. Heights in commands are ignored. Refused commands change nothing."""

    def __init__(self, start_m: Vec3, yaw_rad: float, limits: MotionLimits) -> None:
        """Create at rest at `start_m`. The jerk of wheels is not limited."""
        self._limits = limits
        self._position_m = start_m
        self._yaw_rad = yaw_rad
        self._speed_mps = 0.0
        self._rate_radps = 0.0
        self._command: Command | None = None
        self._route: FollowedPath | None = None
        """Way to go. None: it brakes."""
        self._face_rad: float | None = None
        """Direction to face at the end."""

    is_flying = False

    def command(self, command: Command) -> str:
        """Carry out `command` instead of the one before. Return why it is refused, or `""`."""
        match command:
            case Follow(position_m=position_m, yaw_rad=yaw_rad):
                self._route = self._level((position_m,))
                self._face_rad = yaw_rad
            case FollowPath(points_m=points_m, yaw_rad=yaw_rad):
                self._route = self._level(points_m)
                self._face_rad = yaw_rad
            case Stop():
                self._route = None
            case _:
                return "it is a ground robot: it neither takes off nor lands"
        self._command = command
        return ""

    @property
    def is_done(self) -> bool:
        """Return True if the last command is complete; `Follow` never is."""
        if self._speed_mps or self._rate_radps:
            return False
        if isinstance(self._command, FollowPath):
            return self._is_there and abs(self._remaining_turn_rad) <= FACING_RAD
        return isinstance(self._command, Stop)

    def step(self) -> None:
        """Advance by `STEP_S`."""
        speed_mps, turn_rad = self._target_speed_and_turn()
        max_rate_radps = min(TURN_RADPS, braking_speed(abs(turn_rad), TURN_RADPS2))
        rate_radps = math.copysign(max_rate_radps, turn_rad)
        max_change_mps = self._limits.max_acceleration_mps2 * STEP_S
        self._speed_mps = towards(self._speed_mps, speed_mps, max_change_mps)
        self._rate_radps = towards(self._rate_radps, rate_radps, TURN_RADPS2 * STEP_S)

        # Along the mean direction of the step
        x, y, z = self._position_m
        middle_rad = self._yaw_rad + self._rate_radps * STEP_S / 2.0
        way_m = self._speed_mps * STEP_S
        x += way_m * math.cos(middle_rad)
        y += way_m * math.sin(middle_rad)
        self._position_m = (x, y, z)
        self._yaw_rad = vector.wrap(self._yaw_rad + self._rate_radps * STEP_S)

    def report(self, stamp_ns: int) -> RobotReport:
        """Return its pose at `stamp_ns`."""
        front = vector.direction(self._yaw_rad, 0.0)
        return RobotReport(
            stamp_ns=stamp_ns,
            position_m=self._position_m,
            yaw_rad=self._yaw_rad,
            velocity_mps=vector.scale(front, self._speed_mps),
        )

    def _level(self, points_m: tuple[Vec3, ...]) -> FollowedPath:
        """Return the path along `points_m` at the height of the robot."""
        height_m = self._position_m[2]
        level_points = [(x, y, height_m) for x, y, _ in points_m]
        return FollowedPath(self._position_m, level_points)

    @property
    def _gap(self) -> Vec3:
        if self._route is None:
            return (0.0, 0.0, 0.0)
        return vector.subtract(self._route.target_m, self._position_m)

    @property
    def _is_there(self) -> bool:
        is_last = self._route is None or len(self._route.line_m) == 1
        return is_last and vector.norm(self._gap) <= THERE_M

    @property
    def _remaining_turn_rad(self) -> float:
        if self._face_rad is None:
            return 0.0
        return vector.wrap(self._face_rad - self._yaw_rad)

    def _target_speed_and_turn(self) -> tuple[float, float]:
        """Return the speed, m/s, and the angle to turn, rad."""
        route = self._route
        if route is None:
            return 0.0, 0.0
        route.pass_points(self._position_m)
        if self._is_there:
            turn_rad = self._remaining_turn_rad
            if abs(turn_rad) <= FACING_RAD / 2.0:
                turn_rad = 0.0
            return 0.0, turn_rad

        # It turns in place before it drives towards what lies far aside
        gap = self._gap
        turn_rad = vector.wrap(vector.azimuth(gap) - self._yaw_rad)
        if abs(turn_rad) > AHEAD_RAD:
            return 0.0, turn_rad
        limits = self._limits
        free_m = vector.norm(gap) + route.beyond_m
        braking_mps = braking_speed(free_m, limits.max_acceleration_mps2)
        speed_mps = min(limits.max_speed_mps, ordered_speed(self._command), braking_mps)
        return speed_mps * math.cos(turn_rad), turn_rad


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
        problem = problem or _problem(command)
        if not problem:
            problem = self._robot.command(command)
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
        statuses = self._statuses
        self._statuses = []
        return statuses

    def report(self, stamp_ns: int) -> RobotReport:
        """Return its pose at `stamp_ns`."""
        return self._robot.report(stamp_ns)


def _problem(command: Command) -> str:
    """Return an error message if a number of `command` cannot be used, else `""`."""
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
    if not all(map(math.isfinite, numbers)):
        return "its position, direction or height is not a number"
    return ""


class SimDriver:
    """Connection to a simulated robot, which is there as long as `run` runs."""

    def __init__(self, config: SimConfig, spec: RobotSpec, surroundings: Surroundings) -> None:
        self._robot = OrderedRobot(config, spec)
        self._clock = surroundings.clock
        self._is_running = False

    async def run(self, report: Report) -> None:
        """Move the robot, and report, until cancelled."""
        at_ns = self._clock.now_ns()
        self._is_running = True
        try:
            async for now_ns in ticks(self._clock, REPORT_HZ):
                stall_ns = STALL_S * self._clock.speed * NS_PER_S
                if not 0 <= now_ns - at_ns <= stall_ns:
                    at_ns = now_ns
                while at_ns + STEP_NS <= now_ns:
                    at_ns += STEP_NS
                    self._robot.step()
                for status in self._robot.take_statuses():
                    report(status)
                report(self._robot.report(at_ns))
        finally:
            self._is_running = False
            self.command(Stop(0))  # so that it does not go on if it runs again

    def command(self, command: Command) -> None:
        """Carry out `command`, or refuse it with a reason."""
        is_early = not self._is_running and not isinstance(command, (Stop, Land))
        problem = "it is not connected yet" if is_early else ""
        self._robot.command(command, problem)


SIM = RobotPlugin(
    summary="a simulated quadrotor or ground robot, with limited speed, acceleration and turn rate",
    config=SimConfig,
    make=SimDriver,
)
