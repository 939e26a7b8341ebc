"""The order that a robot carries out, as far as it has told."""

import math
from dataclasses import dataclass, replace

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land, OrderStatus, Stop


@dataclass(frozen=True)
class _Given:
    command: Command
    first: int
    """Number of the first of commands to follow that came without a break, else its own."""
    since_ns: int
    goal_ns: int
    is_answered: bool = False


class CurrentOrder:
    """Numbers commands, and knows which of them is not over yet."""

    def __init__(self) -> None:
        """Start without an order."""
        self._count = 0
        self._given: _Given | None = None

    @property
    def command(self) -> Command | None:
        """Return the command that is not over, or None. Passed points of its way are left out."""
        return None if self._given is None else self._given.command

    @property
    def goal_ns(self) -> int:
        """Return the stamp of the goal that it carries out, or 0."""
        return 0 if self._given is None else self._given.goal_ns

    def next(self) -> int:
        """Return the number of the next command."""
        self._count += 1
        return self._count

    def give(self, command: Command, now_ns: int, goal_ns: int = 0) -> None:
        """Note that the driver is told `command`, for the goal of the stamp `goal_ns`."""
        before = self._given
        goes_on = isinstance(command, Follow) and before is not None and isinstance(before.command, Follow)
        first = before.first if goes_on and before is not None else command.order
        self._given = _Given(command, first, now_ns, goal_ns)

    def drop(self) -> None:
        """Forget it: it is over, or replaced."""
        self._given = None

    def end(self, status: OrderStatus) -> Command | None:
        """Note what became of an order. Return the present command if that has ended; earlier ones have."""
        given = self._given
        if given is None:
            return None
        first = given.first if status.state in ("refused", "failed") else given.command.order
        if not first <= status.order <= given.command.order:
            return None
        if status.state in ("accepted", "active"):
            self._given = replace(given, is_answered=True)
            return None
        self._given = None
        return given.command

    def unanswered_s(self, now_ns: int) -> float:
        """Return for how long the driver has not answered an order that wants an answer, s."""
        given = self._given
        if given is None or given.is_answered or isinstance(given.command, Follow | Stop):
            return 0.0
        return (now_ns - given.since_ns) / NS_PER_S

    def pass_points(self, here_m: Vec3, near_m: float) -> None:
        """Shorten its way by the points that are passed at `here_m`."""
        given = self._given
        if given is None or not isinstance(command := given.command, FollowPath):
            return
        if len(command.points_m) > 1 and math.dist(command.points_m[0], here_m) < near_m:
            self._given = replace(given, command=replace(command, points_m=command.points_m[1:]))

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
