"""The robot driver `ros2`."""

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
        if (config.control == "nav2") != (spec.kind == "ground"):
            raise ConfigError(
                f"robot {spec.name}: control {config.control} is not for a {spec.kind} robot; set it to "
                f"{'nav2' if spec.kind == 'ground' else 'setpoints'}"
            )
        self._config = config
        self._spec = spec
        self._around = surroundings
        self._actuator: Actuator | None = None
        self._report: Report | None = None
        self._last_ns = 0
        """Time of the last report, 0 before the first one and while the link is lost."""
        self._problem = ""

    def command(self, command: Command) -> None:
        """Carry out `command`, or refuse it while the robot is not connected, or if it leads nowhere."""
        if not _leads_somewhere(command):
            self._refuse(command, "it leads nowhere: give finite places")
        elif self._actuator is not None and (self._last_ns or isinstance(command, Stop | Land)):
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
            settings = settings.model_copy(update={"node": f"/pointit_{RosNames().of(self._spec.name)}"})
        now_ns = self._around.clock.now_ns
        health = self._around.health
        backend = await opened(settings, health, now_ns=now_ns)
        async with contextlib.AsyncExitStack() as stack:
            stack.push_async_callback(backend.close)
            types = Types(settings.distro)
            actuator = self._actuator = self._made(backend, types, report)
            stack.push_async_callback(actuator.close)
            source = self._config.pose
            pose = PoseInput(
                backend,
                types,
                PoseReader(source, self._config.frame),
                source,
                now_ns=now_ns,
                on_report=functools.partial(self._on_report, actuator, report),
                on_problem=self._on_problem,
            )
            stack.callback(pose.close)
            stack.callback(self._leave)
            self._report = report
            self._lose(report)
            while True:
                await asyncio.sleep(TICK_S)
                if self._last_ns and now_ns() - self._last_ns > source.stale_s * NS_PER_S:
                    self._lose(report)
                actuator.tick()

    def _made(self, backend: Backend, types: Types, report: Report) -> Actuator:
        now_ns = self._around.clock.now_ns
        if self._config.control == "nav2":
            return Navigator(
                backend,
                types,
                self._config,
                now_ns=now_ns,
                report=report,
                on_problem=functools.partial(self._around.health.warn, "action"),
                on_distance=functools.partial(self._around.health.set_metric, "way left", unit="m"),
            )
        return SetPointSender(backend, types, self._config, self._spec, now_ns=now_ns, report=report)

    def _on_report(self, actuator: Actuator, report: Report, found: RobotReport) -> None:
        self._last_ns = self._around.clock.now_ns()
        report(actuator.on_report(found))

    def _on_problem(self, problem: str) -> None:
        if problem != self._problem:
            self._problem = problem
            self._around.health.warn("pose", problem)

    def _lose(self, report: Report) -> None:
        self._last_ns = 0
        source = self._config.pose
        where = source.topic or f"/tf of {source.frame}"
        report(LinkLost(self._problem or f"no pose comes from {where}: start the robot, or correct `pose`"))

    def _leave(self) -> None:
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
    return bool(numbers) and all(map(math.isfinite, (*numbers, getattr(command, "yaw_rad", None) or 0.0)))
