"""Checks of a robot's own reports: numbers, order, age, jumps."""

import math

from pointit.geometry.vector import Vec3, norm, scale, subtract, wrap
from pointit.schemas import NS_PER_S
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import RobotReport
from pointit.services.robot.stop_reason import StopReason

JUMP_M = 0.5
"""Distance by which a report may exceed the speed limit's distance, in addition to 2 sigma, m."""
SPEED_RATIO = 1.5
"""Speed that a robot may have, as a multiple of its limit: others push it, and its clock is not ours."""
SETTLED_S = 1.0
"""Time without another jump after which a robot's reports are trusted again."""
AHEAD_S = 1.0
"""Time by which a report may be ahead of this machine's clock."""
MOVING_MPS = 0.1
"""Speed above which a robot moves."""
BASE_S = 0.25
"""Least time between two places whose difference is a velocity."""
TURN_S = 0.1
"""Least time between two directions whose difference is a turn rate."""


class Reports:
    """Newest usable report, and the problem of later ones."""

    def __init__(self, config: RobotConfig, robot: str) -> None:
        self._config = config
        self._robot = robot
        self._problem = f"{robot} has not reported its place yet: see that it is switched on and connected"
        self._jump = ""
        self._jumped_ns = 0
        self._came_ns = 0
        """Time of the newest report by the slower of the two clocks."""
        self._base: RobotReport | None = None
        self._turn_base: RobotReport | None = None
        self._driven_mps: Vec3 = (0.0, 0.0, 0.0)
        """Velocity from the places of two reports."""
        self.turn_radps = 0.0
        """Turn rate from the directions of two reports."""
        self.newest: RobotReport | None = None

    @property
    def velocity_mps(self) -> Vec3:
        """Return the robot's velocity; from its places if it reports none."""
        reported = (0.0, 0.0, 0.0) if self.newest is None else self.newest.velocity_mps
        return reported if norm(reported) >= MOVING_MPS else self._driven_mps

    def on_report(self, report: RobotReport, now_ns: int) -> str:
        """Check `report`, of finite numbers in {W}. Return why it is not used, or `""`."""
        ahead_s = (report.stamp_ns - now_ns) / NS_PER_S
        if ahead_s > AHEAD_S:
            self._problem = (
                f"{self._robot} is {ahead_s:.1f} s ahead of this machine: synchronize the two clocks"
            )
            return self._problem
        last = self.newest
        if last is not None and report.stamp_ns < last.stamp_ns:
            return f"{self._robot} reports late: a newer report was here before"
        if last is not None:
            self._find_jump(last, report, now_ns)
        self.newest, self._came_ns = report, min(report.stamp_ns, now_ns)
        self._note_velocity(report)
        self._note_turn(report)
        self._problem = ""
        return ""

    def on_link_lost(self, reason: str) -> None:
        """Discard the reports. None is usable until the next one."""
        self._problem = reason

    def stop_reason(self, now_ns: int) -> StopReason | None:
        """Return the reason to stop a robot with these reports, or None."""
        if self._problem or self.newest is None:
            return StopReason("report", self._problem, is_freeing=True)
        age_s = (now_ns - self._came_ns) / NS_PER_S
        if age_s > self._config.report_timeout_s:
            text = f"{self._robot} has not reported its place for {age_s:.1f} s: look at its link and battery"
            return StopReason("report", text, is_freeing=True)
        if self.newest.has_other_master:
            text = (
                f"another master control steers {self._robot}: it is left alone until its order has ended; "
                "stop it there, or at the vehicle"
            )
            return StopReason("other_master", text, is_freeing=True)
        if self._jump and now_ns - self._jumped_ns < SETTLED_S * NS_PER_S:
            return StopReason("jump", self._jump, is_freeing=True)
        return None

    def _note_turn(self, report: RobotReport) -> None:
        base = self._turn_base or report
        passed_s = (report.stamp_ns - base.stamp_ns) / NS_PER_S
        if passed_s >= TURN_S or self._turn_base is None:
            self._turn_base = report
            self.turn_radps = wrap(report.yaw_rad - base.yaw_rad) / max(passed_s, TURN_S)

    def _note_velocity(self, report: RobotReport) -> None:
        base = self._base
        passed_s = BASE_S if base is None else (report.stamp_ns - base.stamp_ns) / NS_PER_S
        if passed_s < BASE_S:
            return
        self._base = report
        way = (0.0, 0.0, 0.0) if base is None else subtract(report.position_m, base.position_m)
        self._driven_mps = scale(way, 1.0 / passed_s)

    def _find_jump(self, last: RobotReport, report: RobotReport, now_ns: int) -> None:
        passed_s = (report.stamp_ns - last.stamp_ns) / NS_PER_S
        sigma_m = math.hypot(last.position_sigma_m or 0.0, report.position_sigma_m or 0.0)
        limit_m = SPEED_RATIO * self._config.max_speed_mps * passed_s + JUMP_M + 2.0 * sigma_m
        moved_m = math.dist(last.position_m, report.position_m)
        if moved_m > limit_m:
            self._jumped_ns = now_ns
            self._jump = (
                f"{self._robot}'s place jumped by {moved_m:.1f} m: check its localization and that no other "
                "robot has its name, then take it again"
            )
