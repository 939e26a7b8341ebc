"""Commands to a drone, as a stream of PoseStamped set-points."""

import dataclasses
from collections.abc import Callable

from pointit.bridges.ros2.graph.backend import Backend, Qos
from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.robot.config import Ros2RobotConfig
from pointit.bridges.ros2.robot.set_points import SetPoints
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation
from pointit.plugins import NS_PER_S, Command, OrderStatus, Report, RobotReport, RobotSpec, Stop

POSE = "geometry_msgs/msg/PoseStamped"
LONGEST_S = 0.2
"""A set-point moves on by at most this time at once, however late the tick."""


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
        self._types, self._config, self._now_ns, self._tell = types, config, now_ns, report
        self._points = SetPoints(spec, config.ground_m)
        types.prepare(POSE)
        self._writer = backend.advertise(config.setpoint_topic, types.kind(POSE), Qos(depth=10))
        self._order = 0
        self._ticked_ns = now_ns()
        self._heard_ns = 0

    def on_report(self, report: RobotReport) -> RobotReport:
        """Take the robot's pose; return it with whether it flies."""
        self._heard_ns = self._now_ns()
        self._points.on_pose(report.position_m, report.yaw_rad, report.velocity_mps)
        return dataclasses.replace(report, is_flying=self._points.is_flying)

    def command(self, command: Command) -> None:
        """Carry out `command`."""
        self._order = command.order
        news = self._points.command(command)
        if news is not None:
            self._tell(OrderStatus(command.order, *news))

    def tick(self) -> None:
        """Send the set-point of now."""
        now_ns = self._now_ns()
        passed_s = min(max(now_ns - self._ticked_ns, 0) / NS_PER_S, LONGEST_S)
        self._ticked_ns = now_ns
        is_fresh = now_ns - self._heard_ns <= self._config.pose.stale_s * NS_PER_S
        point, done = self._points.step(passed_s, is_fresh=is_fresh)
        if point is not None:
            types = self._types
            message = types.make(
                POSE,
                header=values.header(types, now_ns, self._config.frame),
                pose=values.pose(types, point.position_m, rotation.from_yaw(point.yaw_rad)),
            )
            self._writer.put(types.encode(POSE, message))
        if done is not None:
            self._tell(OrderStatus(self._order, done))

    async def close(self) -> None:
        """Hold the drone where it is, by a last set-point."""
        self.command(Stop(self._order))
        self.tick()
        self._writer.close()
