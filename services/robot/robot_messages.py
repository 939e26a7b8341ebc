"""Messages about a robot, and the times at which they are due."""

import math

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, RobotPhase, RobotPlan, RobotState, TrackedObject, TrackedObjects
from pointit.schemas.environment import Frame
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import RobotReport, report_in_world
from pointit.services.robot.robot_pilot import RobotPilot

KIND = "robot"
"""Kind of the tracked object."""
STATE_NS = NS_PER_S // 10
"""Time between two states that say nothing new but the pose."""
OBJECTS_NS = NS_PER_S // 30
"""Least time between two messages of the tracked object."""
PLAN_NS = NS_PER_S // 5
"""Least time between two plans of the same person."""
PLAN_CHANGE_M = 0.05
"""A plan whose points have moved by less is not published again, m."""


class RobotMessages:
    """Makes the messages about a robot from its pilot, each when it is due."""

    def __init__(self, config: RobotConfig, name: str, pilot: RobotPilot) -> None:
        self._config = config
        self._name = name
        self._pilot = pilot
        self._state_ns = self._plan_ns = self._objects_ns = 0
        self._reported: tuple[RobotPhase, str, str] | None = None
        self._plan: RobotPlan | None = None
        self._report: RobotReport | None = None
        """The last one that was published as an object."""
        self.frame: Frame | None = None
        """Frame of the driver, or None if that is {W} or not known yet."""
        self._states = self._plans = self._counted = 0

    def state(self, now_ns: int) -> RobotState | None:
        """Return the state ten times a second, and at once if its phase, user or reason changes."""
        pilot = self._pilot
        config = self._config
        hindrance = pilot.hindrance
        current = (pilot.phase, pilot.user, hindrance.text)
        is_early = 0 <= now_ns - self._state_ns < STATE_NS
        if is_early and current == self._reported:
            return None
        self._reported = current
        self._state_ns = now_ns
        self._states += 1

        # Before the first report it is where it starts by its configuration
        report = pilot.report
        if report is None:
            yaw_rad = math.radians(config.start_yaw_deg)
            report = RobotReport(now_ns, config.start_m, yaw_rad)
            if self.frame is not None:
                report = report_in_world(report, self.frame)
        way = pilot.way_m
        target_m = way[-1] if way else None
        return RobotState(
            stamp_ns=report.stamp_ns,
            seq=self._states,
            kind=config.kind,
            phase=pilot.phase,
            position_m=report.position_m,
            yaw_rad=report.yaw_rad,
            velocity_mps=report.velocity_mps,
            position_sigma_m=report.position_sigma_m,
            radius_m=config.radius_m,
            user=pilot.user,
            target_m=target_m,
            reason=hindrance.text,
            reason_code=hindrance.code,
            goal_ns=pilot.goal_ns,
            battery=report.battery,
        )

    def plan(self, now_ns: int) -> RobotPlan | None:
        """Return its plan if that has changed."""
        line = self._pilot.way_m
        user = self._pilot.user
        previous = self._plan
        if previous is not None and previous.user == user and len(previous.line_m) == len(line):
            is_early = 0 <= now_ns - self._plan_ns < PLAN_NS
            if is_early or _distance_m(previous.line_m, line) < PLAN_CHANGE_M:
                return None
        self._plans += 1
        self._plan_ns = now_ns
        self._plan = RobotPlan(stamp_ns=now_ns, seq=self._plans, line_m=line, user=user)
        return self._plan

    def objects(self, now_ns: int) -> TrackedObjects | None:
        """Return it as a tracked object if its pose is new, and nothing once if it is lost."""
        report = None
        if self._pilot.phase != "lost":
            report = self._pilot.report
        if report is self._report:
            return None
        is_early = 0 <= now_ns - self._objects_ns < OBJECTS_NS
        if is_early and report is not None:  # a loss is reported at once
            return None
        self._report = report
        self._objects_ns = now_ns
        self._counted += 1
        if report is None:
            return TrackedObjects(stamp_ns=now_ns, seq=self._counted)

        # Its place is in the middle of the circle that it fills
        robot = TrackedObject(
            id=self._name,
            kind=KIND,
            position_m=report.position_m,
            velocity_mps=report.velocity_mps,
            length_m=2.0 * self._config.radius_m,
            yaw_rad=report.yaw_rad,
            position_sigma_m=report.position_sigma_m,
        )
        return TrackedObjects(
            stamp_ns=report.stamp_ns,
            seq=self._counted,
            objects=(robot,),
            latency_sigma_s=self._config.latency_sigma_s,
        )


def _distance_m(first: tuple[Vec3, ...], second: tuple[Vec3, ...]) -> float:
    pairs = zip(first, second, strict=True)
    return max((math.dist(a, b) for a, b in pairs), default=0.0)
