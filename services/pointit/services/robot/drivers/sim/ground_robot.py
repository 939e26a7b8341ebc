"""A simulated ground robot with differential drive: turns in place, drives along paths, stops."""

import math

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.robot.drivers.sim.motion_limits import (
    STEP_S,
    FollowedPath,
    MotionLimits,
    braking_speed,
    ordered_speed,
    towards,
)
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, RobotReport, Stop

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
                self._route, self._face_rad = self._level((position_m,)), yaw_rad
            case FollowPath(points_m=points_m, yaw_rad=yaw_rad):
                self._route, self._face_rad = self._level(points_m), yaw_rad
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
        speed_mps, turn_rad = self._wanted()
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

    def _wanted(self) -> tuple[float, float]:
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
