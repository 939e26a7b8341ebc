"""The driver of simulated robots: they move by the clock, in any speed of it."""

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
            return self._is_there and abs(self._turn_left_rad) <= FACING_RAD
        return isinstance(self._command, Stop)

    def step(self) -> None:
        """Advance by `STEP_S`."""
        speed_mps, turn_rad = self._target_speed_and_turn()
        rate_radps = math.copysign(min(TURN_RADPS, braking_speed(abs(turn_rad), TURN_RADPS2)), turn_rad)
        self._speed_mps = towards(self._speed_mps, speed_mps, self._limits.max_acceleration_mps2 * STEP_S)
        self._rate_radps = towards(self._rate_radps, rate_radps, TURN_RADPS2 * STEP_S)
        x, y, z = self._position_m
        middle_rad = self._yaw_rad + self._rate_radps * STEP_S / 2.0
        way_m = self._speed_mps * STEP_S
        self._position_m = (x + way_m * math.cos(middle_rad), y + way_m * math.sin(middle_rad), z)
        self._yaw_rad = vector.wrap(self._yaw_rad + self._rate_radps * STEP_S)

    def report(self, stamp_ns: int) -> RobotReport:
        """Return its pose at `stamp_ns`."""
        return RobotReport(
            stamp_ns=stamp_ns,
            position_m=self._position_m,
            yaw_rad=self._yaw_rad,
            velocity_mps=vector.scale(vector.direction(self._yaw_rad, 0.0), self._speed_mps),
        )

    def _level(self, points_m: tuple[Vec3, ...]) -> FollowedPath:
        height_m = self._position_m[2]
        return FollowedPath(self._position_m, [(x, y, height_m) for x, y, _ in points_m])

    @property
    def _gap(self) -> Vec3:
        return (
            (0.0, 0.0, 0.0)
            if self._route is None
            else vector.subtract(self._route.target_m, self._position_m)
        )

    @property
    def _is_there(self) -> bool:
        is_last = self._route is None or len(self._route.line_m) == 1
        return is_last and vector.norm(self._gap) <= THERE_M

    @property
    def _turn_left_rad(self) -> float:
        return 0.0 if self._face_rad is None else vector.wrap(self._face_rad - self._yaw_rad)

    def _target_speed_and_turn(self) -> tuple[float, float]:
        """Return the speed, m/s, and the angle to turn, rad."""
        route = self._route
        if route is None:
            return 0.0, 0.0
        route.pass_points(self._position_m)
        if self._is_there:
            turn_rad = self._turn_left_rad
            return 0.0, turn_rad if abs(turn_rad) > FACING_RAD / 2.0 else 0.0
        gap = self._gap
        turn_rad = vector.wrap(vector.azimuth(gap) - self._yaw_rad)
        if abs(turn_rad) > AHEAD_RAD:
            return 0.0, turn_rad
        limits = self._limits
        speed_mps = min(
            limits.max_speed_mps,
            ordered_speed(self._command),
            braking_speed(vector.norm(gap) + route.beyond_m, limits.max_acceleration_mps2),
        )
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
        taken = self._statuses
        self._statuses = []
        return taken

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
    return "" if all(map(math.isfinite, numbers)) else "its position, direction or height is not a number"


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
                if not 0 <= now_ns - at_ns <= STALL_S * self._clock.speed * NS_PER_S:
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
        self._robot.command(command, "it is not connected yet" if is_early else "")


SIM = RobotPlugin(
    summary="a simulated quadrotor or ground robot, with limited speed, acceleration and turn rate",
    config=SimConfig,
    make=SimDriver,
)
