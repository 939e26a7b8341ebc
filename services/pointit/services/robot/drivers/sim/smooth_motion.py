"""A point that flies to its target with limited speed, acceleration and jerk."""

import math
from collections import deque

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.robot.drivers.sim.motion_limits import STEP_S, MotionLimits, braking_speed

ZERO: Vec3 = (0.0, 0.0, 0.0)


class SmoothMotion:
    """Motion of a point in discrete steps of `STEP_S`. The target may change at any step.

    A leading point obeys the limits of speed and acceleration. The position is its mean over a window of
    2 a / j: the norms of speed and acceleration stay within the same limits, as a mean of vectors is not
    longer than the longest, and the jerk is at most 2 a divided by the window.
    """

    def __init__(self, position_m: Vec3, limits: MotionLimits) -> None:
        """Start at rest at `position_m`."""
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
        wanted = ZERO if target_m is None else self._wanted(target_m, max_speed_mps, beyond_m)
        self._speed = self._accelerated(wanted)
        self._lead = vector.add(self._lead, vector.scale(self._speed, STEP_S))
        entering = vector.scale(self._speed, 1.0 / self._count)
        self.velocity_mps = vector.add(
            self.velocity_mps, vector.subtract(entering, vector.scale(self._velocities[0], 1.0 / self._count))
        )
        self._velocities.append(self._speed)
        if self.is_at_rest:  # drops what rounding has left
            self.velocity_mps, self.position_m = ZERO, self._lead
        else:
            self.position_m = vector.add(self.position_m, vector.scale(self.velocity_mps, STEP_S))

    def _wanted(self, target_m: Vec3, max_speed_mps: float, beyond_m: float) -> Vec3:
        """Return the velocity to the target from which it can stop there."""
        limits = self._limits
        gap = vector.subtract(target_m, self._lead)
        distance_m = vector.norm(gap)
        if distance_m <= limits.max_acceleration_mps2 * STEP_S**2:
            return vector.scale(gap, 1.0 / STEP_S)
        speed = min(
            limits.max_speed_mps,
            max_speed_mps,
            braking_speed(distance_m + beyond_m, limits.max_acceleration_mps2),
        )
        return vector.scale(gap, speed / distance_m)

    def _accelerated(self, wanted: Vec3) -> Vec3:
        """Return the next velocity: braking has priority over the change of direction."""
        step = self._limits.max_acceleration_mps2 * STEP_S
        change = vector.subtract(wanted, self._speed)
        size = vector.norm(change)
        if size <= step:
            return wanted
        speed = vector.norm(self._speed)
        along = vector.dot(change, self._speed) / speed if speed > 0.0 else 0.0
        if along >= 0.0:
            return vector.add(self._speed, vector.scale(change, step / size))
        braking = max(along, -step)
        ahead = vector.scale(self._speed, 1.0 / speed)
        across = vector.subtract(change, vector.scale(ahead, along))
        left = math.sqrt(max(step * step - braking * braking, 0.0))
        width = vector.norm(across)
        sideways = vector.scale(across, min(1.0, left / width)) if width > 0.0 else ZERO
        return vector.add(vector.add(self._speed, vector.scale(ahead, braking)), sideways)
