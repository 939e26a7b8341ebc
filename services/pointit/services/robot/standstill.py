"""Checks that a robot without an order stands, and that one with an order moves. Pure."""

import math

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import Command, FollowPath, Land, RobotReport, TakeOff

MOVED_M = 0.2
"""Distance that a robot which stands may seem to move within `WINDOW_S`, besides 2 sigma, m."""
WINDOW_S = 2.0
"""Time after which its present place is what it may not leave, s."""
STUCK_S = 15.0
"""Time without motion after which a take-off or landing is given up, and a path is said to be held up, s."""
REPEAT_S = 1.0
"""Time after its brakes have stopped it, and between two more orders to stop, s."""


class StandstillMonitor:
    """Notices by a robot's places that it moves though it was told to stop, or has done its last order."""

    def __init__(self, config: RobotConfig, robot: str) -> None:
        """Start without a report."""
        self._braking_s = config.max_speed_mps / config.max_acceleration_mps2
        self._text = f"{robot} moves although it has no order or was told to stop: press its emergency stop"
        self.problem = ""
        """That it does, as one sentence, or `""`."""
        self._due_ns: int | None = None
        """Time from which it stands, or None while it may move."""
        self._place: tuple[int, Vec3] | None = None
        """Place that it may not leave, and since when."""

    def forget(self) -> None:
        """Note that it may move, or that its place is not known."""
        self.problem, self._due_ns, self._place = "", None, None

    def is_left(self, report: RobotReport, now_ns: int) -> bool:
        """Return True if it has to be told once more to stop. Call this while it has no order."""
        if self._due_ns is None:
            self._due_ns = now_ns + round((self._braking_s + REPEAT_S) * NS_PER_S)
        if now_ns < self._due_ns:
            return False
        limit_m = MOVED_M + 2.0 * (report.position_sigma_m or 0.0)
        if self._place is not None and math.dist(self._place[1], report.position_m) > limit_m:
            self.problem, self._place = self._text, None
            self._due_ns = now_ns + round(REPEAT_S * NS_PER_S)
            return True
        if self._place is not None and now_ns - self._place[0] < WINDOW_S * NS_PER_S:
            return False
        if self._place is not None:
            self.problem = ""
        self._place = (now_ns, report.position_m)
        return False


class ProgressMonitor:
    """Notices that a robot that is to take off, to land or to follow a path does not move."""

    def __init__(self) -> None:
        """Start without an order."""
        self._order = 0
        self._place: tuple[int, Vec3] = (0, (0.0, 0.0, 0.0))
        """Since when it is about where."""

    def problem(self, command: Command | None, report: RobotReport | None, now_ns: int) -> str:
        """Return that it has not moved for `STUCK_S` by `command`, its order, as one sentence, or `""`."""
        if report is None or not isinstance(command, TakeOff | Land | FollowPath):
            return ""
        since_ns, place_m = self._place
        if command.order != self._order or math.dist(place_m, report.position_m) > MOVED_M:
            self._order, self._place = command.order, (now_ns, report.position_m)
            return ""
        if now_ns - since_ns < STUCK_S * NS_PER_S:
            return ""
        if isinstance(command, FollowPath):
            return f"the robot has not moved for {STUCK_S:.0f} s: see what holds it, or send it elsewhere"
        what = "taken off: see that it is armed" if isinstance(command, TakeOff) else "landed: look at it"
        return f"the robot has not moved for {STUCK_S:.0f} s and not {what}, and take it again"
