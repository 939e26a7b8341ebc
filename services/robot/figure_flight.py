"""The figure of a robot that nobody steers, while a person is localized by following it. Pure.

Figures that a robot flies or drives while a person follows it with the arm, to find where they stand.

The figure is chosen for information: the smallest standard deviation of the person's position that any
unbiased estimate could have (Cramér and Rao) from the directions of the robot, with yaw, elevation bias and
latency unknown as well (pointing.md §4). Pure.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Localization, UserPose
from pointit.schemas.text import all_of
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.current_order import CurrentOrder
from pointit.services.robot.robot_driver import Command, FollowPath, Land, RobotReport, Stop, TakeOff
from pointit.services.robot.safety.safety import Safety

POINTS = 25
"""Way-points of a figure."""

EYES_M = 1.64
"""Height of people's eyes."""

SIGMA_RAD = (math.radians(2.0), math.radians(3.0))
"""1 sigma of one pointing at a robot that moves, sideways and upwards."""

INDEPENDENT_HZ = 2.0
"""Independent pointings per second."""


UNKNOWN_M = 100.0
"""Standard deviation of a position that the figure does not determine."""

PRIOR = np.array([UNKNOWN_M, UNKNOWN_M, math.pi, math.radians(10.0), 0.15]) ** -2
"""Information about x, y (1/m²), yaw, elevation bias (1/rad²) and latency (1/s²) before any ray."""

ASPECTS = (0.0, 0.5, 1.0)
"""Widths of ellipses as a share of their length: there and back, an ellipse, a circle."""

TURNS = 8
"""Number of directions in which each shape is tried."""

RISES_M = (0.0, 0.5)
"""Vertical amplitudes of a quadrotor's figures."""

MAX_VERTICAL = 0.7
"""Largest share of a course that may be vertical."""

LOWEST_M = 0.3
"""Smallest height of a quadrotor in a figure."""

AROUND_M = 2.5
"""Assumed distance from the robot of a person with unknown position, m."""

PERSON_SIGMA_M = 0.5
"""Distance kept from an assumed place of a person besides `keep_out_m`, m."""

DIRECTIONS = 8
"""Number of directions in which they may."""

PAUSE_S = 1.0
"""Least time from one figure to the next: one that is refused is not repeated at every step."""

FOUND_M = 0.9
"""Distance from a configured place within which a person who was found stands at it."""

LONGEST_S = 120.0
"""A localization that began longer ago is over, even if nothing has said so, s."""

NO_FIGURE = "there is no room for a figure that a person could follow: steer the robot to a free place first"


@dataclass(frozen=True)
class AssumedPerson:
    """Possible place of a person who is to be found."""

    place_m: Vec3
    """Place of the feet, {W}."""
    keep_out_m: float
    """Distance that the robot keeps, on the floor."""


@dataclass(frozen=True)
class FollowedFigure:
    """A closed course from the robot's place, which takes the time given."""

    points_m: tuple[Vec3, ...]
    sigma_m: float
    """1 sigma of the position, along the worse direction, that the figure permits; mean over the people."""


def figures(
    start_m: Vec3, people: Sequence[AssumedPerson], *, speed_mps: float, duration_s: float, is_flying: bool
) -> list[FollowedFigure]:
    """Return the figures through `start_m` that keep away from `people`, the most informative first.

    Args:
        start_m: place of the robot, {W}.
        people: places at which the person may stand, equally probable; at least one.
        speed_mps: of the robot along the course.
        duration_s: time that it takes for it.
        is_flying: True if the height may change.
    """
    courses = np.stack(list(_courses(speed_mps * duration_s, is_flying=is_flying))) + start_m
    places = np.array([person.place_m for person in people])
    apart = np.linalg.norm(courses[:, None, :, :2] - places[:, None, :2], axis=3).min(axis=2)
    is_clear = (apart >= [person.keep_out_m for person in people]).all(axis=1)
    if is_flying:
        is_clear &= courses[:, :, 2].min(axis=1) >= min(LOWEST_M, start_m[2])
    sigmas = position_sigmas_m(courses[is_clear], places, duration_s).mean(axis=1)
    found = [
        FollowedFigure(tuple((x, y, z) for x, y, z in courses[index].tolist()), float(sigma_m))
        for index, sigma_m in zip(np.flatnonzero(is_clear).tolist(), sigmas, strict=True)
    ]
    return sorted(found, key=lambda each: each.sigma_m)


def position_sigmas_m(courses_m: Array, places_m: Array, duration_s: float) -> Array:
    """Return Cramér-Rao bounds of positions (f x k): 1 sigma along the worse direction, at most `UNKNOWN_M`.

    Args:
        courses_m: places of the robot at equal intervals, f x n x 3, {W}.
        places_m: where the person may stand, k x 3.
        duration_s: from the first to the last place of a course.
    """
    count = courses_m.shape[1]
    eyes = places_m + np.array([0.0, 0.0, EYES_M])
    away = courses_m[:, None] - eyes[:, None]
    level = np.maximum(np.hypot(away[..., 0], away[..., 1]), 1e-3)
    reach = np.hypot(level, away[..., 2])
    slope = np.zeros((2, *level.shape, 5))  # sideways, upwards; by x, y, yaw, bias, latency
    slope[0, ..., 0] = away[..., 1] / (level * reach)
    slope[0, ..., 1] = -away[..., 0] / (level * reach)
    slope[0, ..., 2] = -level / reach
    slope[1, ..., :2] = away[..., 2:] * away[..., :2] / (level * reach**2)[..., None]
    slope[1, ..., 3] = 1.0
    moved = np.gradient(courses_m, duration_s / (count - 1), axis=1)[:, None]
    slope[..., 4] = -(slope[..., :2] * moved[..., :2]).sum(axis=-1)
    slope[1, ..., 4] += level / reach**2 * moved[..., 2]
    slope /= np.reshape(SIGMA_RAD, (2, 1, 1, 1, 1))
    share = INDEPENDENT_HZ * duration_s / count
    squares: Array = np.einsum("afkni,afknj->fkij", slope, slope)
    information = np.asarray(share * squares + np.diag(PRIOR), dtype=np.float64)
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    variances = np.linalg.eigvalsh(covariance[..., :2, :2])[..., -1]
    return np.asarray(np.minimum(UNKNOWN_M, np.sqrt(variances)), dtype=np.float64)


def _courses(length_m: float, *, is_flying: bool) -> Iterator[Array]:
    """Yield courses (n x 3) from the origin and back, each of `length_m`: ellipses, then figures of eight."""
    share = np.linspace(0.0, math.tau, POINTS)
    shapes = [np.stack([1.0 - np.cos(share), aspect * np.sin(share)]) for aspect in ASPECTS]
    shapes.append(np.stack([np.sin(share), 0.5 * np.sin(2.0 * share)]))
    for along, aside in shapes:
        for rise_m in RISES_M if is_flying else RISES_M[:1]:
            for rate in (1.0, 2.0) if rise_m else (1.0,):
                if 2.0 * rate * rise_m > MAX_VERTICAL * length_m:
                    continue
                up = rise_m * 0.5 * (1.0 - np.cos(rate * share))
                level_m = _level_length(along, aside, up, length_m)
                for turn in np.arange(TURNS) * math.tau / TURNS:
                    x = level_m * (along * math.cos(turn) - aside * math.sin(turn))
                    y = level_m * (along * math.sin(turn) + aside * math.cos(turn))
                    yield np.stack([x, y, up], axis=1)


def _level_length(along: Array, aside: Array, up: Array, length_m: float) -> float:
    """Return the factor on `along` and `aside` that makes the course `length_m` long."""
    low = 0.0
    high = length_m
    for _ in range(30):
        middle = 0.5 * (low + high)
        steps = np.diff(np.stack([middle * along, middle * aside, up]), axis=1)
        is_longer = float(np.linalg.norm(steps, axis=0).sum()) > length_m
        low, high = (low, middle) if is_longer else (middle, high)
    return low


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
        are = "is" if len(others) == 1 else "are"
        return f"{self._name} moves until {all_of(others)} {are} found: take it then"

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
        """Record that the localizer of `user` has ended."""
        self.followers.pop(user, None)
        self._poses.pop(user, None)

    def forget(self) -> None:
        """End the figure, since a user steers the robot now, or since it was stopped."""
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
        ranked = figures(
            report.position_m, people,
            speed_mps=self._config.max_speed_mps,
            duration_s=self._config.figure.duration_s,
            is_flying=self._config.kind == "quadrotor",
        )  # fmt: skip
        chosen = next((each for each in ranked if not safety.way_problem(each.points_m)), None)
        if chosen is None:
            self.problem = NO_FIGURE
            return None
        self._is_begun = True
        self.problem = ""
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
        apart_m = config.keep_out_m + PERSON_SIGMA_M + config.radius_m
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
