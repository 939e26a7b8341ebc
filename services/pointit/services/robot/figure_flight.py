"""The figure of a robot that nobody steers, while a person is localized by following it. Pure."""

import math

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Localization, UserPose
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.current_order import CurrentOrder
from pointit.services.robot.followed_figure import AssumedPerson, best_figure, figures
from pointit.services.robot.robot_driver import Command, FollowPath, Land, RobotReport, Stop, TakeOff
from pointit.services.robot.safety.safety import Safety

AROUND_M = 2.5
"""Distance from the robot at which a person stands of whom nothing is known."""

DIRECTIONS = 8
"""Number of directions in which they may."""

PAUSE_S = 1.0
"""Least time from one figure to the next: one that is refused is not repeated at every step."""

FOUND_M = 0.9
"""Distance from a configured place within which a person who was found stands at it."""

LONGEST_S = 120.0
"""A localization that began longer ago is over, even if nothing has said so, s."""

NO_FIGURE = "there is no room for a figure that a person could follow: steer the robot to a free place first"


class FigureFlight:
    """Begins a figure when a localization names the robot, repeats it, and ends it with the localization."""

    def __init__(self, config: RobotConfig, name: str) -> None:
        self._config = config
        self._name = name
        self.followers: dict[str, int] = {}
        """People who are localized by this robot, and since when, ns."""
        self._poses: dict[str, UserPose] = {}
        self._is_begun = False
        self._tried_ns: int | None = None
        """Time of the last figure."""
        self.problem = ""
        """Reason for which there is no figure, or `""`."""

    def _waiting(self, now_ns: int) -> list[str]:
        longest_ns = LONGEST_S * NS_PER_S
        return [user for user, since_ns in self.followers.items() if abs(now_ns - since_ns) < longest_ns]

    def take_problem(self, user: str, now_ns: int) -> str:
        """Return the reason not to let `user` end the figure that others follow, or `""`."""
        others = [each for each in self._waiting(now_ns) if each != user]
        if not others or self.problem or not self._is_begun:  # one that stands still delays nobody
            return ""
        who = f"{others[0]} is" if len(others) == 1 else f"{', '.join(others[:-1])} and {others[-1]} are"
        return f"{self._name} moves until {who} found: take it then"

    def on_pose(self, user: str, pose: UserPose) -> None:
        """Update a person's pose: who is found needs no figure."""
        self._poses[user] = pose

    def on_localization(self, user: str, localization: Localization) -> None:
        """Update whether `user` is localized by this robot."""
        is_ours = (
            localization.phase == "sampling"
            and localization.purpose == "pose"
            and localization.target_id == self._name
        )
        self.followers.pop(user, None)
        if is_ours and not localization.ahead:
            self.followers[user] = localization.since_ns

    def on_gone(self, user: str) -> None:
        """Note that the localizer of `user` has ended."""
        self.followers.pop(user, None)
        self._poses.pop(user, None)

    def forget(self) -> None:
        """Note that somebody steers the robot now, or that it was stopped: the figure is over."""
        self._is_begun = False
        self.problem = ""

    def command(
        self, report: RobotReport, order: CurrentOrder, safety: Safety, now_ns: int
    ) -> Command | None:
        """Return the command to a robot that nobody steers, by its last report and its order, or None."""
        is_wanted = bool(self._waiting(now_ns))
        if not is_wanted and isinstance(order.command, FollowPath | TakeOff):
            return self._interrupt(order)
        is_early = self._tried_ns is not None and abs(now_ns - self._tried_ns) < PAUSE_S * NS_PER_S
        if order.command is not None or is_early:
            return None
        if not is_wanted:
            return self._end(report, order, now_ns)
        self._tried_ns = now_ns
        if self._config.kind == "quadrotor" and not report.is_flying:
            x, y, z = report.position_m
            height_m = self._config.figure.height_m
            self.problem = safety.way_problem(((x, y, z + height_m),))
            if self.problem:
                return None
            self._is_begun = True
            return TakeOff(order.next(), height_m)
        people = self.people(report.position_m, is_flying=report.is_flying)
        length_m = self._config.max_speed_mps * self._config.figure.duration_s
        flies = self._config.kind == "quadrotor"
        ranked = figures(report.position_m, people, length_m=length_m, is_flying=flies)
        chosen = best_figure(ranked, lambda points: not safety.way_problem(points))
        if chosen is None:
            self.problem = NO_FIGURE
            return None
        self._is_begun, self.problem = True, ""
        return FollowPath(order.next(), chosen.points_m[1:], None, safety.speed_limit_mps(chosen.points_m))

    def _interrupt(self, order: CurrentOrder) -> Command | None:
        self.problem = ""
        self._tried_ns = None
        return Stop(order.next()) if self._is_begun else None

    def _end(self, report: RobotReport, order: CurrentOrder, now_ns: int) -> Command | None:
        """Return the command that ends a figure: a quadrotor lands, however often it is halted."""
        self.problem = ""
        self._is_begun = self._is_begun and report.is_flying
        if not self._is_begun:
            return None
        self._tried_ns = now_ns
        return Land(order.next(), None)

    def people(self, here_m: Vec3, *, is_flying: bool) -> list[AssumedPerson]:
        """Return where those who follow may stand: as configured, unless found, else anywhere around."""
        config = self._config
        apart_m = config.keep_out_m + config.figure.person_sigma_m + config.radius_m
        if config.figure.people_m:
            found = [pose.position_m[:2] for user, pose in self._poses.items() if user not in self.followers]
            places = config.figure.people_m
            open_m = [each for each in places if all(math.dist(each[:2], at) > FOUND_M for at in found)]
            return [AssumedPerson(place_m, apart_m) for place_m in open_m or places]
        turns = [math.tau * number / DIRECTIONS for number in range(DIRECTIONS)]
        floor_m = here_m[2] - (config.figure.height_m if is_flying else 0.0)
        return [
            AssumedPerson(
                (here_m[0] + AROUND_M * math.cos(turn), here_m[1] + AROUND_M * math.sin(turn), floor_m),
                apart_m,
            )
            for turn in turns
        ]
