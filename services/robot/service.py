"""Service that drives a robot from users' goals, poses and pointing, and publishes its state."""

import asyncio
import math
from typing import ClassVar

from pointit.maps.frames import frame_or_problem
from pointit.runtime.clock import ticks
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.plugin_guard import NullHealth, PluginGuard, guard_of
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    Cursor,
    Done,
    Environment,
    Goal,
    Interaction,
    RobotState,
    Steering,
    StopRobot,
    topics,
)
from pointit.schemas.environment import Frame
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import (
    ROBOTS,
    Command,
    LinkLost,
    ReportItem,
    RobotDriver,
    RobotReport,
    RobotSpec,
    in_frame,
    report_fault,
    report_in_world,
)
from pointit.services.robot.robot_messages import RobotMessages
from pointit.services.robot.robot_pilot import RobotPilot
from pointit.services.robot.safety.safety import Safety

TICK_HZ = 20.0
SUPERVISOR = "supervisor."
"""Beginning of the instances of the services that know whether a person points."""
LOCALIZER = "localizer."
"""Beginning of the instances of the services that localize a person."""
DRIVER_ENDED = LinkLost("the driver of the robot has ended; it is started again")


class Robot(Service[RobotConfig]):
    """One robot that users steer by pointing. Publishes its position, activity, owner and reason to stop."""

    NAME: ClassVar[str] = "robot"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = RobotConfig
    SEVERAL: ClassVar[bool] = True

    def __init__(self, config: RobotConfig, context: Context) -> None:
        """Create the driver, which opens no connection yet.

        Raises:
            ConfigError: If the driver is not installed, or its parameters cannot work.
        """
        super().__init__(config, context)

        # The driver is made here, so that its errors are those of the configuration, and runs in `run`
        self._robot = self.name or self.NAME
        self._safety = Safety(config, self._robot)
        self._pilot = RobotPilot(config, self._robot, self._safety)
        self._messages = RobotMessages(config, self._robot, self._pilot)
        self._guard = guard_of(ROBOTS, config.driver, self.bus)
        self._driver: RobotDriver = self._guard.made(self._make_driver)
        self._is_made = True
        """False once the driver has run: then a new one is made for the next run."""
        self._frame: Frame | None = None
        """Frame of the driver's places, or None if that is {W} or not known yet."""

        # Requests and messages: from here on the methods below may be called
        self._states = self.bus.publisher(topics.ROBOT_STATE, self._robot)
        self._plans = self.bus.publisher(topics.ROBOT_PLAN, self._robot)
        self._objects = self.bus.publisher(topics.OBJECTS, f"{self.NAME}.{self._robot}")
        self.bus.serve(topics.STOP_ROBOT, self._stop, self._robot)
        self.bus.watch(topics.USER_ALIVE, self._on_presence)
        self.bus.watch(topics.SERVICE_ALIVE, self._on_service)
        self.bus.subscribe(topics.MAP, self._on_map)
        self.bus.subscribe(topics.POSE, lambda pose, user: self._pilot.on_pose(user, pose))
        self.bus.subscribe(topics.INTERACTION, self._on_interaction)
        self.bus.subscribe(topics.CURSOR, self._on_cursor)
        self.bus.subscribe(topics.STEERING, self._on_steering)
        self.bus.subscribe(topics.GOAL, self._on_goal)
        self.bus.subscribe(topics.ROBOT_STATE, self._on_robot)
        self.bus.subscribe(
            topics.LOCALIZATION, lambda localization, user: self._pilot.on_localization(user, localization)
        )

    @classmethod
    def validate_config(cls, config: RobotConfig) -> None:
        """Check the parameters of the driver."""
        guard = PluginGuard(ROBOTS.label(config.driver), NullHealth())
        guard.made(lambda: ROBOTS.get(config.driver).check(config.section(config.driver)))

    async def run(self) -> None:
        """Drive until cancelled; at the end the robot gets an order to stop."""
        driving = asyncio.create_task(self._guard.keep_running(self._run_driver), name="driver")
        try:
            async for now_ns in ticks(self.clock, TICK_HZ):
                self._step(now_ns)
        finally:
            driving.cancel()
            await asyncio.wait({driving})

    async def _run_driver(self) -> None:
        if not self._is_made:
            self._driver = self._make_driver()
        self._is_made = False
        try:
            await self._driver.run(self._report)
        except asyncio.CancelledError:  # the service ends
            raise
        except BaseException:
            self._report(DRIVER_ENDED)
            raise
        self._report(DRIVER_ENDED)

    def _make_driver(self) -> RobotDriver:
        config = self.config
        spec = RobotSpec(
            name=self._robot,
            kind=config.kind,
            start_m=config.start_m,
            start_yaw_rad=math.radians(config.start_yaw_deg),
            radius_m=config.radius_m,
            hover_m=config.hover_m,
            max_speed_mps=config.max_speed_mps,
            max_acceleration_mps2=config.max_acceleration_mps2,
        )
        surroundings = self.surroundings(ROBOTS.kind, config.driver, which=self._robot)
        plugin = ROBOTS.get(config.driver)
        return plugin.make(config.section(config.driver), spec, surroundings)

    def _report(self, item: ReportItem) -> None:
        now_ns = self.clock.now_ns()
        if self._frame is not None:
            if isinstance(item, RobotReport) and not report_fault(item):  # else the pilot refuses it
                item = report_in_world(item, self._frame)
        elif self.config.frame:
            item = LinkLost(
                f"the map has no frame {self.config.frame!r} yet, in which the robot reports its place"
            )
        fault = self._pilot.on_item(item, now_ns)
        self.bus.warn("report", fault)
        link_problem = item.reason if isinstance(item, LinkLost) else ""
        self.bus.warn("link", link_problem)
        self._publish_objects(now_ns)

    def _step(self, now_ns: int) -> None:
        command = self._pilot.step(now_ns)
        if command is not None:
            self._send_command(command)

        # After the command, whose effect they report
        state = self._messages.state(now_ns)
        if state is not None:
            self._states.put(state)
        plan = self._messages.plan(now_ns)
        if plan is not None:
            self._plans.put(plan)
        self._publish_objects(now_ns)

    def _publish_objects(self, now_ns: int) -> None:
        objects = self._messages.objects(now_ns)
        if objects is not None:
            self._objects.put(objects)

    def _send_command(self, command: Command) -> None:
        sent_command = command
        if self._frame is not None:
            sent_command = in_frame(command, self._frame)
        self._guard.call("command", lambda: self._driver.command(sent_command))

    def _on_map(self, environment: Environment, _name: str) -> None:
        self._pilot.on_map(environment)
        if self.config.frame:
            self._frame, problem = frame_or_problem(environment, self.config.frame)
            self.bus.warn("frame", problem)
            self._messages.frame = self._frame

    def _on_presence(self, user: str, *, present: bool) -> None:
        self._pilot.on_presence(user, present=present)
        self._step(self.clock.now_ns())

    def _on_service(self, instance: str, *, present: bool) -> None:
        if instance.startswith(SUPERVISOR) and not present:  # nobody knows whether they still point
            idle_interaction = Interaction(stamp_ns=self.clock.now_ns(), state="idle")
            self._on_interaction(idle_interaction, instance.removeprefix(SUPERVISOR))
        if instance.startswith(LOCALIZER) and not present:
            self._pilot.on_localizer_end(instance.removeprefix(LOCALIZER))

    def _on_interaction(self, interaction: Interaction, user: str) -> None:
        self._safety.people.on_interaction(user, interaction)
        if user == self._pilot.user:
            self._step(self.clock.now_ns())

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        self._pilot.on_cursor(user, cursor)
        if user == self._pilot.user:
            self._step(self.clock.now_ns())

    def _on_steering(self, steering: Steering, user: str) -> None:
        self._pilot.on_steering(user, steering)
        self._step(self.clock.now_ns())

    def _on_goal(self, goal: Goal, user: str) -> None:
        now_ns = self.clock.now_ns()
        self._pilot.on_goal(user, goal, now_ns)
        self._step(now_ns)

    def _on_robot(self, state: RobotState, robot: str) -> None:
        if robot != self._robot:
            self._safety.on_robot(robot, state)

    async def _stop(self, query: StopRobot, _robot: str) -> Done:
        if self._pilot.has_other_master:
            raise RefusedError(self._pilot.reason)
        explanation = f" ({query.reason})" if query.reason else ""
        self._pilot.on_stop_request(
            f"somebody has stopped the robot{explanation}: point at it and take it again"
        )
        self._step(self.clock.now_ns())
        return Done(message=f"{self._robot} is told to stop; nobody steers it until somebody takes it again")


SERVICE = Robot
