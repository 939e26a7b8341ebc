"""A simulated quadrotor: takes off, hovers, follows set-points and paths, lands."""

import math

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.robot.drivers.sim.followed_path import FollowedPath
from pointit.services.robot.drivers.sim.hover_wander import HoverWander
from pointit.services.robot.drivers.sim.motion_limits import STEP_S, MotionLimits, ordered_speed, towards
from pointit.services.robot.drivers.sim.smooth_motion import ZERO, SmoothMotion
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land, RobotReport, Stop, TakeOff

CLIMB_MPS = 0.5
"""Speed of the take-off, m/s."""
DESCENT_MPS = 0.3
"""Speed of the landing, m/s."""
TURN_RADPS = math.radians(90.0)
"""Yaw rate, rad/s."""
THERE_M = 0.08
"""Distance from the target at which it has arrived, m: more than it wanders."""
STILL_MPS = 0.1
"""Speed at which it hovers, m/s."""
ABOVE_M = 0.05
"""Horizontal distance from the place of landing at which it descends, m."""
CLEARANCE_M = 0.2
"""Minimum height above the place of landing on the way there, m."""


class SimulatedQuadrotor:
    """A quadrotor that stands on the ground at first. Refused commands change nothing."""

    def __init__(self, start_m: Vec3, yaw_rad: float, limits: MotionLimits, rng: np.random.Generator) -> None:
        """Create on the ground at `start_m`; `rng` moves it while it hovers."""
        self._limits = limits
        self._motion = SmoothMotion(start_m, limits)
        self._wander = HoverWander(rng)
        self._offset: Vec3 = ZERO
        self._ground_m = start_m[2]
        self._yaw_rad = self._wanted_yaw_rad = yaw_rad
        self._command: Command | None = None
        self._target_m: Vec3 | None = start_m
        """Set-point. None: it brakes."""
        self._route: FollowedPath | None = None
        self._is_descending = False
        self.is_flying = False

    def command(self, command: Command) -> str:
        """Carry out `command` instead of the one before. Return why it is refused, or `""`."""
        if not self.is_flying and isinstance(command, (Follow, FollowPath)):
            return "it stands on the ground: let it take off first"
        if isinstance(command, TakeOff) and command.height_m <= 0.0:
            return f"it cannot take off to {command.height_m:g} m: the height must be above 0"
        here, was_descending = self._motion.lead_m, self._is_descending
        self._command, self._route, self._is_descending = command, None, False
        match command:
            case Stop():
                self._target_m = None
            case TakeOff(height_m=height_m):
                self._target_m = (here[0], here[1], self._ground_m + height_m)
                self.is_flying = True
            case Follow(position_m=position_m, yaw_rad=yaw_rad):
                self._target_m = position_m
                self._face(yaw_rad)
            case FollowPath(points_m=points_m, yaw_rad=yaw_rad):
                self._route = FollowedPath(here, points_m)
                self._face(yaw_rad)
            case Land(position_m=position_m) if self.is_flying:
                x, y, self._ground_m = position_m or (here[0], here[1], self._ground_m)
                self._target_m = (x, y, max(here[2], self._ground_m + CLEARANCE_M))
                # the same order again does not climb once more
                is_above = math.hypot(x - here[0], y - here[1]) <= ABOVE_M + math.hypot(*self._offset)
                self._is_descending = was_descending and is_above
            case Land():
                pass
        return ""

    @property
    def is_done(self) -> bool:
        """Return True if the last command is complete; `Follow` never is."""
        match self._command:
            case Land():
                return not self.is_flying
            case Stop():
                return not self.is_flying or self._is_still
            case TakeOff() | FollowPath():
                is_last = self._route is None or len(self._route.line_m) == 1
                return is_last and self._is_still and self._distance_m <= THERE_M
            case _:
                return False

    def step(self) -> None:
        """Advance by `STEP_S`."""
        if not self.is_flying:
            return
        if not self._is_descending:
            self._offset = self._wander.step()
        turn = vector.wrap(self._wanted_yaw_rad - self._yaw_rad)
        self._yaw_rad = vector.wrap(self._yaw_rad + towards(0.0, turn, TURN_RADPS * STEP_S))
        if self._target_m is None:
            self._brake()
        elif self._route is not None:
            self._follow_route(self._route)
        elif isinstance(self._command, Land):
            self._land(self._target_m)
        else:
            climbs = isinstance(self._command, TakeOff)
            self._motion.step(
                self._aim(self._target_m), CLIMB_MPS if climbs else ordered_speed(self._command)
            )

    def report(self, stamp_ns: int) -> RobotReport:
        """Return its pose at `stamp_ns`."""
        return RobotReport(
            stamp_ns=stamp_ns,
            position_m=self._motion.position_m,
            yaw_rad=self._yaw_rad,
            velocity_mps=self._motion.velocity_mps,
            is_flying=self.is_flying,
        )

    @property
    def _is_still(self) -> bool:
        return self._target_m is not None and vector.norm(self._motion.velocity_mps) <= STILL_MPS

    @property
    def _distance_m(self) -> float:
        target_m = self._route.target_m if self._route is not None else self._target_m
        gap = ZERO if target_m is None else vector.subtract(target_m, self._motion.position_m)
        return vector.norm(gap)

    def _face(self, yaw_rad: float | None) -> None:
        if yaw_rad is not None:
            self._wanted_yaw_rad = yaw_rad

    def _aim(self, target_m: Vec3) -> Vec3:
        """Return `target_m` with the wander about it, but not beneath the ground."""
        x, y, z = vector.add(target_m, self._offset)
        return (x, y, max(z, min(self._ground_m, target_m[2])))

    def _brake(self) -> None:
        self._motion.step(None)
        if self._motion.is_at_rest:  # hovers here, without a step in the set-point
            self._target_m = vector.subtract(self._motion.lead_m, self._offset)

    def _follow_route(self, route: FollowedPath) -> None:
        route.pass_points(self._motion.lead_m)
        self._target_m = route.target_m
        self._motion.step(self._aim(route.target_m), ordered_speed(self._command), route.beyond_m)

    def _land(self, above_m: Vec3) -> None:
        """Fly over the place, then descend to it. The offset of the descent's start remains."""
        here = self._motion.lead_m
        if not self._is_descending:
            self._motion.step(self._aim(above_m), ordered_speed(self._command))
            gap_m = math.hypot(above_m[0] - here[0], above_m[1] - here[1])
            self._is_descending = gap_m <= ABOVE_M and self._is_still
            return
        x, y, _ = vector.add(above_m, self._offset)
        self._motion.step((x, y, self._ground_m), min(DESCENT_MPS, ordered_speed(self._command)))
        if self._motion.is_at_rest:
            self.is_flying = False
