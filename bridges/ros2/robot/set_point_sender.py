"""Commands to a drone, as a stream of PoseStamped set-points."""

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

from pointit.bridges.ros2.graph.backend import Backend, Qos
from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.robot.goal_book import Outcome
from pointit.bridges.ros2.robot.plugin import Ros2RobotConfig
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.plugins import (
    NS_PER_S,
    Command,
    Follow,
    FollowPath,
    Land,
    OrderStatus,
    Report,
    RobotReport,
    RobotSpec,
    Stop,
    TakeOff,
)

THERE_M = 0.15
"""Distance at which the drone counts as being at a place."""
FLYING_M = 0.1
"""Height above the floor from which it flies."""
DESCENT_MPS = 0.3
"""Speed of landing and of taking off."""
UNDER_M = 0.2
"""The last set-point of a landing is this far below the floor, so that the drone stands."""
MAX_LEAD_M = 0.5
"""The set-point is at most this far ahead of the drone, besides what it flies in half a second."""
MAX_LEAD_S = 0.5

POSE = "geometry_msgs/msg/PoseStamped"
LONGEST_S = 0.2
"""A set-point moves on by at most this time at once, however late the tick."""


class SetPoint(NamedTuple):
    """Place and azimuth that the drone is to have now."""

    position_m: Vec3
    yaw_rad: float


class SetPoints:
    """The set-point of one drone, moved every `step`."""

    def __init__(self, spec: RobotSpec, ground_m: float) -> None:
        """Start on the ground at height `ground_m`, or at the first pose."""
        self._spec = spec
        self._ground_m = ground_m
        self._at_m: Vec3 | None = None
        self._velocity_mps: Vec3 = (0.0, 0.0, 0.0)
        self._yaw_rad = 0.0
        self._now: Vec3 | None = None
        """The set-point, None while none is sent."""
        self._speed_mps = 0.0
        self._command: Command | None = None
        self._waypoints_m: list[Vec3] = []
        """Places to go to, in order."""
        self._is_over = True

    @property
    def is_flying(self) -> bool:
        """Return True while it is above the ground."""
        if self._at_m is None:
            return False
        return self._at_m[2] > self._ground_m + FLYING_M

    def on_pose(self, position_m: Vec3, yaw_rad: float, velocity_mps: Vec3 = (0.0, 0.0, 0.0)) -> None:
        """Store the drone's pose and velocity."""
        self._velocity_mps = velocity_mps
        if self._now is None:
            self._yaw_rad = yaw_rad
        self._at_m = position_m

    def command(self, command: Command) -> tuple[Outcome, str] | None:
        """Carry out `command`; return its outcome and the reason, if there is one at once."""
        if self._at_m is None:
            if isinstance(command, Stop):
                return None
            return "refused", "its pose is not known: check its topic"
        if not self.is_flying and isinstance(command, Follow | FollowPath):
            return "refused", "it is on the ground: take off first"
        is_at_rest = not self.is_flying and self._now is None
        if is_at_rest and isinstance(command, Stop | Land):
            return "done", ""

        self._command = command
        self._is_over = False
        self._waypoints_m = self._places(command, self._at_m)
        yaw_rad = getattr(command, "yaw_rad", None)
        if yaw_rad is not None:
            self._yaw_rad = yaw_rad

        # A new flight, and a stop, begin where the drone comes to rest
        if self._now is None or isinstance(command, Stop):
            self._now = self._rest_m(self._at_m)
            self._speed_mps = 0.0
        return None if isinstance(command, Follow | Stop) else ("active", "")

    def step(self, passed_s: float, *, is_fresh: bool) -> tuple[SetPoint | None, Outcome | None]:
        """Move the set-point on by `passed_s`; it waits while the pose is not fresh.

        Returns:
            The set-point to publish, None if there is none, and `done` once when the command is carried out.
        """
        if self._now is None or self._at_m is None:
            return None, None
        done: Outcome | None = None
        if is_fresh and self._waypoints_m:
            self._now = self._advanced(passed_s, self._now, self._at_m)
            done = self._arrived(self._at_m)
        return self._set_point(), done

    def _set_point(self) -> SetPoint | None:
        return None if self._now is None else SetPoint(self._now, self._yaw_rad)

    def _places(self, command: Command, at_m: Vec3) -> list[Vec3]:
        match command:
            case Follow(position_m=position_m):
                return [position_m]
            case FollowPath(points_m=points_m):
                return list(points_m)
            case TakeOff(height_m=height_m):
                return [(at_m[0], at_m[1], self._ground_m + height_m)]
            case Land(position_m=position_m):
                above_m = at_m
                if position_m is not None:
                    above_m = (position_m[0], position_m[1], at_m[2])
                under_m = (above_m[0], above_m[1], self._ground_m - UNDER_M)
                return [above_m, under_m]
            case Stop():
                return []

    def _rest_m(self, at_m: Vec3) -> Vec3:
        """Return where the drone comes to rest if it brakes now."""
        speed_mps = min(vector.norm(self._velocity_mps), self._spec.max_speed_mps)
        if not self.is_flying or speed_mps == 0.0:
            return at_m
        brake_s = speed_mps / (2.0 * self._spec.max_acceleration_mps2)
        brake_m = vector.scale(self._velocity_mps, brake_s)
        x, y, z = vector.add(at_m, brake_m)
        return x, y, max(z, self._ground_m + FLYING_M)

    def _advanced(self, passed_s: float, now_m: Vec3, at_m: Vec3) -> Vec3:
        """Return the set-point `now_m` moved on towards the next place; the drone is at `at_m`."""
        remaining = vector.subtract(self._waypoints_m[0], now_m)
        remaining_m = vector.norm(remaining)
        limit_mps = self._limit_mps()
        if remaining_m == 0.0:
            self._speed_mps = 0.0
            return now_m

        # Speed: as fast as it may, so that it can still brake before the last place
        acceleration_mps2 = self._spec.max_acceleration_mps2
        brake_mps = limit_mps
        if len(self._waypoints_m) == 1:
            brake_mps = math.sqrt(2.0 * acceleration_mps2 * remaining_m)
        faster_mps = self._speed_mps + acceleration_mps2 * passed_s
        self._speed_mps = min(limit_mps, brake_mps, faster_mps)

        # Step: not further ahead of the drone than it can follow
        step_m = min(remaining_m, self._speed_mps * passed_s)
        next_m = vector.add(now_m, vector.scale(remaining, step_m / remaining_m))
        next_lead_m = vector.norm(vector.subtract(next_m, at_m))
        lead_m = vector.norm(vector.subtract(now_m, at_m))
        if next_lead_m <= MAX_LEAD_M + limit_mps * MAX_LEAD_S or next_lead_m < lead_m:
            return next_m
        self._speed_mps = 0.0
        return now_m

    def _limit_mps(self) -> float:
        limit_mps = self._spec.max_speed_mps
        own_mps = getattr(self._command, "max_speed_mps", None)
        if own_mps is not None:
            limit_mps = min(own_mps, limit_mps)
        if isinstance(self._command, TakeOff) or self._is_descending:
            limit_mps = min(limit_mps, DESCENT_MPS)
        return limit_mps

    @property
    def _is_descending(self) -> bool:
        """Return True if it lands, and is above the place."""
        return isinstance(self._command, Land) and len(self._waypoints_m) == 1

    def _arrived(self, at_m: Vec3) -> Outcome | None:
        """Return `done` if the last place is reached, and go on to the next one if another is."""
        place_m = self._waypoints_m[0]
        if self._is_descending:
            if self.is_flying:
                return None
            if self._now is not None and self._now != place_m:
                return None
            self._now = None  # it stands: no set-point holds it in the air
            self._waypoints_m = []
        elif vector.norm(vector.subtract(place_m, at_m)) > THERE_M:
            return None
        elif len(self._waypoints_m) > 1:
            del self._waypoints_m[0]
            return None
        if self._is_over or isinstance(self._command, Follow):
            return None
        self._is_over = True
        return "done"


class SetPointSender:
    """Carries out commands, the newest first; `tick` is to be called at 10 Hz or more."""

    def __init__(
        self,
        backend: Backend,
        types: Types,
        config: Ros2RobotConfig,
        spec: RobotSpec,
        *,
        now_ns: Callable[[], int],
        report: Report,
    ) -> None:
        self._types = types
        self._config = config
        self._now_ns = now_ns
        self._report = report
        self._points = SetPoints(spec, config.ground_m)
        types.prepare(POSE)
        kind = types.kind(POSE)
        self._writer = backend.advertise(config.setpoint_topic, kind, Qos(depth=10))
        self._order = 0
        self._ticked_ns = now_ns()
        self._received_ns = 0

    def on_report(self, report: RobotReport) -> RobotReport:
        """Store the robot's pose. Return it with the state of flying."""
        self._received_ns = self._now_ns()
        self._points.on_pose(report.position_m, report.yaw_rad, report.velocity_mps)
        return dataclasses.replace(report, is_flying=self._points.is_flying)

    def command(self, command: Command) -> None:
        """Carry out `command`."""
        self._order = command.order
        outcome = self._points.command(command)
        if outcome is not None:
            self._report(OrderStatus(command.order, *outcome))

    def tick(self) -> None:
        """Send the set-point of now."""
        now_ns = self._now_ns()
        ticked_s = max(now_ns - self._ticked_ns, 0) / NS_PER_S
        passed_s = min(ticked_s, LONGEST_S)
        self._ticked_ns = now_ns
        is_fresh = now_ns - self._received_ns <= self._config.pose.stale_s * NS_PER_S
        point, done = self._points.step(passed_s, is_fresh=is_fresh)
        if point is not None:
            types = self._types
            orientation = rotation.from_yaw(point.yaw_rad)
            message = types.make(
                POSE,
                header=values.header(types, now_ns, self._config.frame),
                pose=values.pose(types, point.position_m, orientation),
            )
            self._writer.put(types.encode(POSE, message))
        if done is not None:
            self._report(OrderStatus(self._order, done))

    async def close(self) -> None:
        """Hold the drone where it is, by a last set-point."""
        self.command(Stop(self._order))
        self.tick()
        self._writer.close()
