"""A simulated quadrotor: takes off, hovers, follows set-points and paths within its limits, lands."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land, RobotReport, Stop, TakeOff

STEP_S = 0.01
"""Time step of the simulation, s."""

BRAKING_SHARE = 0.5
"""Share of the acceleration with which a robot brakes for its target. The rest corrects its direction."""

APPROACH_PER_S = 3.0
"""Speed close to the target per distance, 1/s: the robot approaches it exponentially."""

PASS_M = 0.1
"""Distance at which a point that is not the last one has been reached, m."""

SHARP_RAD = math.radians(20.0)
"""Turn at a point of the path from which the robot stops there, as it would leave the path otherwise."""

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

WANDER_SD_M: Vec3 = (0.015, 0.015, 0.008)
"""Standard deviation per axis, m: that of a small quadrotor under motion capture."""

WANDER_S = 1.0
"""Correlation time, s."""

WANDER_LIMIT = 2.5
"""Limit per axis, in standard deviations."""

ZERO: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """Limits of the norms of velocity, acceleration and jerk."""

    max_speed_mps: float
    max_acceleration_mps2: float
    max_jerk_mps3: float


def braking_speed(distance_m: float, acceleration_mps2: float) -> float:
    """Return the speed from which braking at `BRAKING_SHARE` of the acceleration ends after `distance_m`.

    It is the square root of the distance, and proportional to it close to the end, where the root is steep.
    Works for angles, too.
    """
    braking = BRAKING_SHARE * acceleration_mps2
    linear_m = braking / APPROACH_PER_S**2
    if distance_m <= linear_m:
        return APPROACH_PER_S * max(distance_m, 0.0)
    return math.sqrt(2.0 * braking * (distance_m - linear_m / 2.0))


def towards(value: float, wanted: float, step: float) -> float:
    """Return `wanted`, or the value nearest to it that is within `step` of `value`."""
    return min(max(wanted, value - step), value + step)


def ordered_speed(command: Command | None) -> float:
    """Return the speed limit of `command`, m/s, or infinity if it has none."""
    if not isinstance(command, (Follow, FollowPath, Land)):
        return math.inf
    return math.inf if command.max_speed_mps is None else command.max_speed_mps


class FollowedPath:
    """A path, and how far it has been followed."""

    def __init__(self, start_m: Vec3, points_m: Sequence[Vec3]) -> None:
        """Create a path from `start_m` through `points_m`, at least one."""
        remaining: list[Vec3] = []
        previous_m = start_m
        for point_m in points_m:
            if point_m != previous_m:
                remaining.append(point_m)
            previous_m = point_m
        self._remaining = remaining or [points_m[-1]]

        # From the end on: behind a point lies the way to the next sharp turn, or to the end
        steps: list[Vec3] = []
        for point_m, next_m in pairwise((start_m, *self._remaining)):
            steps.append(vector.subtract(next_m, point_m))
        beyond_m = 0.0
        beyond_points_m: list[float] = []
        for index in range(len(steps) - 1, -1, -1):
            beyond_points_m.append(beyond_m)
            is_sharp = index == 0 or vector.angle_between(steps[index - 1], steps[index]) > SHARP_RAD
            beyond_m = 0.0 if is_sharp else beyond_m + vector.norm(steps[index])
        self._beyond_m = beyond_points_m[::-1]

    @property
    def line_m(self) -> tuple[Vec3, ...]:
        """Return the points not yet reached; the last one remains."""
        return tuple(self._remaining)

    @property
    def target_m(self) -> Vec3:
        """Return the next point."""
        return self._remaining[0]

    @property
    def beyond_m(self) -> float:
        """Return the distance behind the next point at which the robot must be able to stop."""
        return self._beyond_m[0]

    def pass_points(self, position_m: Vec3) -> None:
        """Drop the points that `position_m` has reached, except the last one."""
        while len(self._remaining) > 1:
            gap = vector.subtract(self._remaining[0], position_m)
            if vector.norm(gap) > PASS_M:
                return
            del self._remaining[0], self._beyond_m[0]


class SimulatedQuadrotor:
    """A quadrotor that stands on the ground at first. Refused commands change nothing."""

    def __init__(self, start_m: Vec3, yaw_rad: float, limits: MotionLimits, rng: np.random.Generator) -> None:
        """Create on the ground at `start_m`; `rng` moves it while it hovers."""
        self._limits = limits
        self._motion = SmoothMotion(start_m, limits)
        self._wander = HoverWander(rng)
        self._offset: Vec3 = ZERO
        self._ground_m = start_m[2]
        self._yaw_rad = yaw_rad
        self._target_yaw_rad = yaw_rad
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

        # What the last command has left behind is forgotten
        here = self._motion.lead_m
        was_descending = self._is_descending
        self._command = command
        self._route = None
        self._is_descending = False
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
                clear_m = self._ground_m + CLEARANCE_M
                self._target_m = (x, y, max(here[2], clear_m))
                # the same order again does not climb once more
                distance_m = math.hypot(x - here[0], y - here[1])
                is_above = distance_m <= ABOVE_M + math.hypot(*self._offset)
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
                if not is_last or not self._is_still:
                    return False
                return self._distance_m <= THERE_M
            case _:
                return False

    def step(self) -> None:
        """Advance by `STEP_S`."""
        if not self.is_flying:
            return
        if not self._is_descending:
            self._offset = self._wander.step()
        turn_rad = vector.wrap(self._target_yaw_rad - self._yaw_rad)
        turned_rad = towards(0.0, turn_rad, TURN_RADPS * STEP_S)
        self._yaw_rad = vector.wrap(self._yaw_rad + turned_rad)

        # It brakes, follows its path, lands, or goes to its set-point
        if self._target_m is None:
            self._brake()
        elif self._route is not None:
            self._follow_route(self._route)
        elif isinstance(self._command, Land):
            self._land(self._target_m)
        else:
            max_speed_mps = ordered_speed(self._command)
            if isinstance(self._command, TakeOff):
                max_speed_mps = CLIMB_MPS
            self._motion.step(self._aim(self._target_m), max_speed_mps)

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
        target_m = self._target_m
        if self._route is not None:
            target_m = self._route.target_m
        if target_m is None:
            return 0.0
        gap = vector.subtract(target_m, self._motion.position_m)
        return vector.norm(gap)

    def _face(self, yaw_rad: float | None) -> None:
        if yaw_rad is not None:
            self._target_yaw_rad = yaw_rad

    def _aim(self, target_m: Vec3) -> Vec3:
        """Return `target_m` with the wander about it, but not beneath the ground."""
        x, y, z = vector.add(target_m, self._offset)
        lowest_m = min(self._ground_m, target_m[2])
        return (x, y, max(z, lowest_m))

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
        max_speed_mps = min(DESCENT_MPS, ordered_speed(self._command))
        self._motion.step((x, y, self._ground_m), max_speed_mps)
        if self._motion.is_at_rest:
            self.is_flying = False


class HoverWander:
    """A first-order Gauss-Markov process per axis, clamped."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._keep = math.exp(-STEP_S / WANDER_S)
        self._kick = math.sqrt(1.0 - self._keep**2)
        self._values: Vec3 = (0.0, 0.0, 0.0)

    def step(self) -> Vec3:
        """Advance by `STEP_S`. Return the offset from the set-point, m."""
        noises = self._rng.standard_normal(3).tolist()
        values: list[float] = []
        offsets_m: list[float] = []
        for noise, previous, sd_m in zip(noises, self._values, WANDER_SD_M, strict=True):
            value = self._keep * previous + self._kick * noise
            values.append(value)
            offsets_m.append(sd_m * min(max(value, -WANDER_LIMIT), WANDER_LIMIT))
        self._values = (values[0], values[1], values[2])
        return (offsets_m[0], offsets_m[1], offsets_m[2])


class SmoothMotion:
    """Motion of a point in discrete steps of `STEP_S`. The target may change at any step.

    A leading point obeys the limits of speed and acceleration. The position is its mean over a window of
    2 a / j: the norms of speed and acceleration stay within the same limits, as a mean of vectors is not
    longer than the longest, and the jerk is at most 2 a divided by the window.
    """

    def __init__(self, position_m: Vec3, limits: MotionLimits) -> None:
        self._limits = limits
        window_s = 2.0 * limits.max_acceleration_mps2 / limits.max_jerk_mps3
        self._count = max(1, math.ceil(window_s / STEP_S))
        self._lead = position_m
        self._speed: Vec3 = ZERO
        self._velocities: deque[Vec3] = deque([ZERO] * self._count, self._count)
        self.position_m = position_m
        self.velocity_mps: Vec3 = ZERO

    @property
    def lead_m(self) -> Vec3:
        """Return the position of the leading point, which is where it comes to rest if it stands still."""
        return self._lead

    @property
    def is_at_rest(self) -> bool:
        """Return True if it stands still and will do so until its target changes."""
        return not any(map(any, self._velocities))

    def step(self, target_m: Vec3 | None, max_speed_mps: float = math.inf, beyond_m: float = 0.0) -> None:
        """Advance by `STEP_S`.

        Args:
            target_m: position to fly to. None: brake.
            max_speed_mps: speed limit. If it is exceeded, it brakes to it.
            beyond_m: distance behind the target for which it need not have stopped at the target.
        """
        target_velocity = ZERO
        if target_m is not None:
            target_velocity = self._stoppable_velocity(target_m, max_speed_mps, beyond_m)
        self._speed = self._accelerated(target_velocity)
        self._lead = vector.add(self._lead, vector.scale(self._speed, STEP_S))

        # The mean over the window: the newest velocity enters, the oldest leaves
        entering = vector.scale(self._speed, 1.0 / self._count)
        leaving = vector.scale(self._velocities[0], 1.0 / self._count)
        self.velocity_mps = vector.add(self.velocity_mps, vector.subtract(entering, leaving))
        self._velocities.append(self._speed)
        if self.is_at_rest:  # drops what rounding has left
            self.velocity_mps = ZERO
            self.position_m = self._lead
        else:
            self.position_m = vector.add(self.position_m, vector.scale(self.velocity_mps, STEP_S))

    def _stoppable_velocity(self, target_m: Vec3, max_speed_mps: float, beyond_m: float) -> Vec3:
        """Return the velocity to the target from which it can stop there."""
        limits = self._limits
        gap = vector.subtract(target_m, self._lead)
        distance_m = vector.norm(gap)
        if distance_m <= limits.max_acceleration_mps2 * STEP_S**2:
            return vector.scale(gap, 1.0 / STEP_S)
        braking_mps = braking_speed(distance_m + beyond_m, limits.max_acceleration_mps2)
        speed_mps = min(limits.max_speed_mps, max_speed_mps, braking_mps)
        return vector.scale(gap, speed_mps / distance_m)

    def _accelerated(self, target_velocity: Vec3) -> Vec3:
        """Return the next velocity: braking has priority over the change of direction."""
        step = self._limits.max_acceleration_mps2 * STEP_S
        change = vector.subtract(target_velocity, self._speed)
        size = vector.norm(change)
        if size <= step:
            return target_velocity
        speed = vector.norm(self._speed)
        along = vector.dot(change, self._speed) / speed if speed > 0.0 else 0.0
        if along >= 0.0:
            return vector.add(self._speed, vector.scale(change, step / size))

        # What the acceleration for braking leaves changes the direction
        braking = max(along, -step)
        ahead = vector.scale(self._speed, 1.0 / speed)
        across = vector.subtract(change, vector.scale(ahead, along))
        remaining = math.sqrt(max(step * step - braking * braking, 0.0))
        width = vector.norm(across)
        sideways = ZERO
        if width > 0.0:
            sideways = vector.scale(across, min(1.0, remaining / width))
        braked = vector.add(self._speed, vector.scale(ahead, braking))
        return vector.add(braked, sideways)
