"""The order that a robot carries out, by its reports, and whether it moves or stands as ordered."""

import math
from dataclasses import dataclass, replace

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import (
    Command,
    Follow,
    FollowPath,
    Land,
    OrderStatus,
    RobotReport,
    Stop,
    TakeOff,
)

MOVED_M = 0.2
"""Distance that a robot which stands may seem to move within `WINDOW_S`, besides 2 sigma, m."""

WINDOW_S = 2.0
"""Time after which its present position is the one it may not leave, s."""

STUCK_S = 15.0
"""Time without motion after which a take-off or landing is given up, and a path is reported as held up, s."""

REPEAT_S = 1.0
"""Time after its brakes have stopped it, and between two more orders to stop, s."""


@dataclass(frozen=True)
class _GivenCommand:
    command: Command
    first: int
    """Number of the first of commands to follow that came without a break, else its own."""
    since_ns: int
    goal_ns: int
    is_answered: bool = False


class CurrentOrder:
    """Numbers commands, and knows which of them is not over yet."""

    def __init__(self) -> None:
        self._count = 0
        self._current: _GivenCommand | None = None

    @property
    def command(self) -> Command | None:
        """Return the command that is not over, or None. Passed points of its way are left out."""
        return None if self._current is None else self._current.command

    @property
    def goal_ns(self) -> int:
        """Return the stamp of the goal that it carries out, or 0."""
        return 0 if self._current is None else self._current.goal_ns

    def next(self) -> int:
        """Return the number of the next command."""
        self._count += 1
        return self._count

    def give(self, command: Command, now_ns: int, goal_ns: int = 0) -> None:
        """Record that the driver receives `command`, for the goal with the stamp `goal_ns`."""
        first = command.order
        previous = self._current
        if isinstance(command, Follow) and previous is not None and isinstance(previous.command, Follow):
            first = previous.first
        self._current = _GivenCommand(command, first, now_ns, goal_ns)

    def drop(self) -> None:
        """Forget it: it is over, or replaced."""
        self._current = None

    def end(self, status: OrderStatus) -> Command | None:
        """Update an order's status. Return the present command if it has ended. Earlier ones have."""
        current = self._current
        if current is None:
            return None

        # In a row of commands to follow, the refusal of an earlier one counts for the present one, too
        first = current.command.order
        if status.state in ("refused", "failed"):
            first = current.first
        if not first <= status.order <= current.command.order:
            return None
        if status.state in ("accepted", "active"):
            self._current = replace(current, is_answered=True)
            return None
        self._current = None
        return current.command

    def unanswered_s(self, now_ns: int) -> float:
        """Return for how long the driver has not answered an order that wants an answer, s."""
        current = self._current
        if current is None or current.is_answered:
            return 0.0
        if isinstance(current.command, Follow | Stop):
            return 0.0
        return (now_ns - current.since_ns) / NS_PER_S

    def pass_points(self, here_m: Vec3, near_m: float) -> None:
        """Shorten its way by the points that are passed at `here_m`."""
        current = self._current
        if current is None or not isinstance(current.command, FollowPath):
            return
        points_m = current.command.points_m
        if len(points_m) > 1 and math.dist(points_m[0], here_m) < near_m:
            shorter = replace(current.command, points_m=points_m[1:])
            self._current = replace(current, command=shorter)

    def way_m(self, here_m: Vec3) -> tuple[Vec3, ...]:
        """Return the rest of its way from `here_m`, or nothing."""
        match self.command:
            case Follow(position_m=place):
                return (here_m, place)
            case FollowPath(points_m=points):
                return (here_m, *points)
            case Land(position_m=place) if place is not None:
                return (here_m, place)
            case _:
                return ()


class StandstillMonitor:
    """Notices by a robot's places that it moves after an order to stop, or after its last order."""

    def __init__(self, config: RobotConfig, robot: str) -> None:
        self._braking_s = config.max_speed_mps / config.max_acceleration_mps2
        self._text = f"{robot} moves without an order or after an order to stop: press its emergency stop"
        self.problem = ""
        """That it does, as one sentence, or `""`."""
        self._due_ns: int | None = None
        """Time from which it stands, or None while it may move."""
        self._place: tuple[int, Vec3] | None = None
        """Place that it may not leave, and since when."""

    def forget(self) -> None:
        """Record that the robot may move, or that its position is unknown."""
        self.problem = ""
        self._due_ns = None
        self._place = None

    def is_left(self, report: RobotReport, now_ns: int) -> bool:
        """Return True if it needs one more order to stop. Call this while it has no order."""
        # At first it may still brake
        if self._due_ns is None:
            self._due_ns = now_ns + round((self._braking_s + REPEAT_S) * NS_PER_S)
        if now_ns < self._due_ns:
            return False
        if self._place is None:
            self._place = (now_ns, report.position_m)
            return False

        # It gets that order at once, and is then judged by a new place
        since_ns, place_m = self._place
        limit_m = MOVED_M + 2.0 * (report.position_sigma_m or 0.0)
        if math.dist(place_m, report.position_m) > limit_m:
            self.problem = self._text
            self._place = None
            self._due_ns = now_ns + round(REPEAT_S * NS_PER_S)
            return True

        # It has stood for the whole window: from now on its present place is the one that it may not leave
        if now_ns - since_ns >= WINDOW_S * NS_PER_S:
            self.problem = ""
            self._place = (now_ns, report.position_m)
        return False


class ProgressMonitor:
    """Notices that a robot that is to take off, to land or to follow a path does not move."""

    def __init__(self) -> None:
        self._order = 0
        self._place: tuple[int, Vec3] = (0, (0.0, 0.0, 0.0))
        """Since when it is about where."""

    def problem(self, command: Command | None, report: RobotReport | None, now_ns: int) -> str:
        """Return that it has not moved for `STUCK_S` by `command`, its order, as one sentence, or `""`."""
        if report is None or not isinstance(command, TakeOff | Land | FollowPath):
            return ""

        # Time and place count from the last movement, or from a new order
        since_ns, place_m = self._place
        has_moved = math.dist(place_m, report.position_m) > MOVED_M
        if command.order != self._order or has_moved:
            self._order = command.order
            self._place = (now_ns, report.position_m)
            return ""
        if now_ns - since_ns < STUCK_S * NS_PER_S:
            return ""
        if isinstance(command, FollowPath):
            return f"the robot has not moved for {STUCK_S:.0f} s: see what holds it, or send it elsewhere"
        result = "landed: look at it"
        if isinstance(command, TakeOff):
            result = "taken off: see that it is armed"
        return f"the robot has not moved for {STUCK_S:.0f} s and not {result}, and take it again"
