"""The robot driver `ros2`.

No core: it waits for a robot.
"""

import asyncio
import contextlib
import functools
import math

from pointit.bridges.ros2.graph.backend import Backend
from pointit.bridges.ros2.graph.backends import check_endpoint, opened
from pointit.bridges.ros2.robot.navigator import Navigator
from pointit.bridges.ros2.robot.plugin import Ros2RobotConfig
from pointit.bridges.ros2.robot.pose_input import PoseInput, PoseReader
from pointit.bridges.ros2.robot.set_point_sender import SetPointSender
from pointit.bridges.ros2.routing.names import RosNames
from pointit.bridges.ros2.types.types import Types
from pointit.plugins import (
    NS_PER_S,
    Command,
    ConfigError,
    Follow,
    FollowPath,
    Land,
    LinkLost,
    OrderStatus,
    Report,
    RobotReport,
    RobotSpec,
    Stop,
    Surroundings,
    TakeOff,
)

Actuator = Navigator | SetPointSender
"""Carries out commands."""

TICK_S = 0.05


class Ros2Driver:
    """A robot that is a ROS 2 node; see `pointit.plugins.RobotDriver` for the contract."""

    def __init__(self, config: Ros2RobotConfig, spec: RobotSpec, surroundings: Surroundings) -> None:
        """Join nothing yet.

        Raises:
            ConfigError: If the endpoint is no address, or the robot cannot be controlled so.
        """
        check_endpoint(config.backend.endpoint)
        control = "nav2" if spec.kind == "ground" else "setpoints"
        if config.control != control:
            raise ConfigError(
                f"robot {spec.name}: control {config.control} is not for a {spec.kind} robot; "
                f"set it to {control}"
            )
        self._config = config
        self._spec = spec
        self._surroundings = surroundings
        self._actuator: Actuator | None = None
        self._report: Report | None = None
        self._last_ns = 0
        """Time of the last report, 0 before the first one and while the link is lost."""
        self._problem = ""

    def command(self, command: Command) -> None:
        """Carry out `command`, or refuse it while the robot is not connected, or if it leads nowhere."""
        if not _leads_somewhere(command):
            self._refuse(command, "it leads nowhere: give finite places")
            return

        # A robot whose pose is lost may still receive: it is stopped or landed, but sent nowhere
        is_possible = self._last_ns or isinstance(command, Stop | Land)
        if self._actuator is not None and is_possible:
            self._actuator.command(command)
        elif not isinstance(command, Stop | Follow):
            self._refuse(command, "the robot is not connected")

    def _refuse(self, command: Command, reason: str) -> None:
        if self._report is not None:
            self._report(OrderStatus(command.order, "refused", reason))

    async def run(self, report: Report) -> None:
        """Report until cancelled. Then stop the robot.

        Raises:
            ConfigError: If the ROS graph cannot be joined as configured.
        """
        settings = self._config.backend
        if not settings.node:
            name = RosNames().of(self._spec.name)
            settings = settings.model_copy(update={"node": f"/pointit_{name}"})
        now_ns = self._surroundings.clock.now_ns
        health = self._surroundings.health
        backend = await opened(settings, health, now_ns=now_ns)
        async with contextlib.AsyncExitStack() as stack:
            stack.push_async_callback(backend.close)

            # On leaving, the actuator stops the robot while its pose still comes
            types = Types(settings.distro)
            actuator = self._new_actuator(backend, types, report)
            self._actuator = actuator
            stack.push_async_callback(actuator.close)
            source = self._config.pose
            reader = PoseReader(source, self._config.frame)
            on_report = functools.partial(self._on_report, actuator, report)
            pose = PoseInput(
                backend,
                types,
                reader,
                source,
                now_ns=now_ns,
                on_report=on_report,
                on_problem=self._on_problem,
            )
            stack.callback(pose.close)
            stack.callback(self._end_commands)

            # Lost until its first pose
            self._report = report
            self._report_loss(report)
            max_age_ns = source.stale_s * NS_PER_S
            while True:
                await asyncio.sleep(TICK_S)
                if self._last_ns and now_ns() - self._last_ns > max_age_ns:
                    self._report_loss(report)
                actuator.tick()

    def _new_actuator(self, backend: Backend, types: Types, report: Report) -> Actuator:
        now_ns = self._surroundings.clock.now_ns
        if self._config.control == "nav2":
            health = self._surroundings.health
            on_problem = functools.partial(health.warn, "action")
            on_distance = functools.partial(health.set_metric, "way left", unit="m")
            return Navigator(
                backend,
                types,
                self._config,
                now_ns=now_ns,
                report=report,
                on_problem=on_problem,
                on_distance=on_distance,
            )
        return SetPointSender(backend, types, self._config, self._spec, now_ns=now_ns, report=report)

    def _on_report(self, actuator: Actuator, report: Report, pose: RobotReport) -> None:
        self._last_ns = self._surroundings.clock.now_ns()
        report(actuator.on_report(pose))

    def _on_problem(self, problem: str) -> None:
        if problem != self._problem:
            self._problem = problem
            self._surroundings.health.warn("pose", problem)

    def _report_loss(self, report: Report) -> None:
        self._last_ns = 0
        source = self._config.pose
        origin = source.topic or f"/tf of {source.frame}"
        problem = self._problem or f"no pose comes from {origin}: start the robot, or correct `pose`"
        report(LinkLost(problem))

    def _end_commands(self) -> None:
        self._actuator = None
        self._report = None
        self._last_ns = 0


def _leads_somewhere(command: Command) -> bool:
    """Return True if all places and angles of `command` are finite, and a path has some."""
    match command:
        case FollowPath(points_m=points_m):
            numbers = [number for point_m in points_m for number in point_m]
        case Follow(position_m=position_m):
            numbers = [*position_m]
        case Land(position_m=position_m):
            numbers = [*(position_m or (0.0,))]
        case TakeOff(height_m=height_m):
            numbers = [height_m]
        case Stop():
            return True
    if not numbers:
        return False
    yaw_rad = getattr(command, "yaw_rad", None) or 0.0
    return all(map(math.isfinite, (*numbers, yaw_rad)))
