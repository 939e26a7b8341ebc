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
    length_m = speed_mps * duration_s
    courses = np.stack(list(_courses(length_m, is_flying=is_flying))) + start_m

    # Courses that keep away from all people and above the ground
    places = np.array([person.place_m for person in people])
    keep_out_m = [person.keep_out_m for person in people]
    floor_courses = courses[..., :2]
    floor_places = places[:, :2]
    offsets = floor_courses[:, None] - floor_places[:, None]
    distances_m = np.linalg.norm(offsets, axis=3)
    is_clear = (distances_m.min(axis=2) >= keep_out_m).all(axis=1)
    if is_flying:
        lowest_m = courses[:, :, 2].min(axis=1)
        is_clear &= lowest_m >= min(LOWEST_M, start_m[2])

    # The person may be at any of the places: the mean over them counts
    sigmas = position_sigmas_m(courses[is_clear], places, duration_s).mean(axis=1)
    candidates: list[FollowedFigure] = []
    for course, sigma_m in zip(courses[is_clear].tolist(), sigmas, strict=True):
        points = tuple((x, y, z) for x, y, z in course)
        candidates.append(FollowedFigure(points, float(sigma_m)))
    return sorted(candidates, key=lambda figure: figure.sigma_m)


def position_sigmas_m(courses_m: Array, places_m: Array, duration_s: float) -> Array:
    """Return Cramér-Rao bounds of positions (f x k): 1 sigma along the worse direction, at most `UNKNOWN_M`.

    Args:
        courses_m: places of the robot at equal intervals, f x n x 3, {W}.
        places_m: where the person may stand, k x 3.
        duration_s: from the first to the last place of a course.
    """
    # From the eyes at each place to the robot at each point of each course
    count = courses_m.shape[1]
    eyes = places_m + np.array([0.0, 0.0, EYES_M])
    offset = courses_m[:, None] - eyes[:, None]
    x = offset[..., 0]
    y = offset[..., 1]
    z = offset[..., 2]
    level = np.maximum(np.hypot(x, y), 1e-3)
    reach = np.hypot(level, z)

    # Jacobian of the direction, sideways and upwards, by x, y, yaw and elevation bias
    jacobian = np.zeros((2, *level.shape, 5))
    level_reach = level * reach
    level_reach_2 = level * reach**2
    jacobian[0, ..., 0] = y / level_reach
    jacobian[0, ..., 1] = -x / level_reach
    jacobian[0, ..., 2] = -level / reach
    jacobian[1, ..., 0] = z * x / level_reach_2
    jacobian[1, ..., 1] = z * y / level_reach_2
    jacobian[1, ..., 3] = 1.0

    # By latency: the robot moves on meanwhile
    interval_s = duration_s / (count - 1)
    velocity = np.gradient(courses_m, interval_s, axis=1)[:, None]
    level_changes = jacobian[..., :2] * velocity[..., :2]
    rise = level / reach**2 * velocity[..., 2]
    jacobian[..., 4] = -level_changes.sum(axis=-1)
    jacobian[1, ..., 4] += rise

    # Fisher information of all independent pointings, and the bound on the position from its inverse
    jacobian /= np.reshape(SIGMA_RAD, (2, 1, 1, 1, 1))
    share = INDEPENDENT_HZ * duration_s / count
    squares: Array = np.einsum("afkni,afknj->fkij", jacobian, jacobian)
    information = np.asarray(share * squares + np.diag(PRIOR), dtype=np.float64)
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    variances = np.linalg.eigvalsh(covariance[..., :2, :2])[..., -1]
    sigmas_m = np.minimum(UNKNOWN_M, np.sqrt(variances))
    return np.asarray(sigmas_m, dtype=np.float64)


def _courses(length_m: float, *, is_flying: bool) -> Iterator[Array]:
    """Yield courses (n x 3) from the origin and back, each of `length_m`: ellipses, then figures of eight."""
    phase = np.linspace(0.0, math.tau, POINTS)
    shapes: list[Array] = []
    for aspect in ASPECTS:
        shapes.append(np.stack([1.0 - np.cos(phase), aspect * np.sin(phase)]))
    shapes.append(np.stack([np.sin(phase), 0.5 * np.sin(2.0 * phase)]))
    rises_m = RISES_M if is_flying else RISES_M[:1]
    turns_rad = np.arange(TURNS) * math.tau / TURNS
    for along, aside in shapes:
        for rise_m in rises_m:
            # A flying robot rises once or twice in each course
            rates = (1.0, 2.0) if rise_m else (1.0,)
            for rate in rates:
                if 2.0 * rate * rise_m > MAX_VERTICAL * length_m:
                    continue
                up = rise_m * 0.5 * (1.0 - np.cos(rate * phase))
                level_m = _level_length(along, aside, up, length_m)
                for turn_rad in turns_rad:
                    cos = math.cos(turn_rad)
                    sin = math.sin(turn_rad)
                    x = level_m * (along * cos - aside * sin)
                    y = level_m * (along * sin + aside * cos)
                    yield np.stack([x, y, up], axis=1)


def _level_length(along: Array, aside: Array, up: Array, length_m: float) -> float:
    """Return the factor on `along` and `aside` that makes the course `length_m` long."""
    low = 0.0
    high = length_m
    for _ in range(30):
        middle = 0.5 * (low + high)
        course = np.stack([middle * along, middle * aside, up])
        steps = np.diff(course, axis=1)
        if float(np.linalg.norm(steps, axis=0).sum()) > length_m:
            high = middle
        else:
            low = middle
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
        """Return the people who are localized by this robot."""
        longest_ns = LONGEST_S * NS_PER_S
        return [user for user, since_ns in self.followers.items() if abs(now_ns - since_ns) < longest_ns]

    def take_problem(self, user: str, now_ns: int) -> str:
        """Return the reason not to let `user` end the figure that others follow, or `""`."""
        if self.problem or not self._is_begun:  # a robot that stands still delays nobody
            return ""
        others = [follower for follower in self._waiting(now_ns) if follower != user]
        if not others:
            return ""
        verb = "is" if len(others) == 1 else "are"
        return f"{self._name} moves until {all_of(others)} {verb} found: take it then"

    def on_pose(self, user: str, pose: UserPose) -> None:
        """Update a person's pose: who is found needs no figure."""
        self._poses[user] = pose

    def on_localization(self, user: str, localization: Localization) -> None:
        """Update whether `user` is localized by this robot."""
        self.followers.pop(user, None)
        if localization.phase != "sampling" or localization.purpose != "pose":
            return
        if localization.target_id == self._name and not localization.ahead:
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
        # The end of the last localization interrupts a figure, and begins the landing after it
        is_requested = bool(self._waiting(now_ns))
        if not is_requested and isinstance(order.command, FollowPath | TakeOff):
            return self._interrupt(order)
        if order.command is not None:
            return None
        if self._tried_ns is not None and abs(now_ns - self._tried_ns) < PAUSE_S * NS_PER_S:
            return None
        if not is_requested:
            return self._end(report, order, now_ns)

        # A quadrotor takes off first
        self._tried_ns = now_ns
        if self._config.kind == "quadrotor" and not report.is_flying:
            x, y, z = report.position_m
            height_m = self._config.figure.height_m
            self.problem = safety.way_problem(((x, y, z + height_m),))
            if self.problem:
                return None
            self._is_begun = True
            return TakeOff(order.next(), height_m)

        # The most informative figure that keeps clear of everything; a course begins where the robot is
        people = self.people(report.position_m, is_flying=report.is_flying)
        ranked = figures(
            report.position_m,
            people,
            speed_mps=self._config.max_speed_mps,
            duration_s=self._config.figure.duration_s,
            is_flying=self._config.kind == "quadrotor",
        )
        chosen = next((figure for figure in ranked if not safety.way_problem(figure.points_m)), None)
        if chosen is None:
            self.problem = NO_FIGURE
            return None
        self._is_begun = True
        self.problem = ""
        speed_mps = safety.speed_limit_mps(chosen.points_m)
        return FollowPath(order.next(), chosen.points_m[1:], None, speed_mps)

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
            places = self._free_places() or config.figure.people_m
            return [AssumedPerson(place_m, apart_m) for place_m in places]
        floor_m = here_m[2]
        if is_flying:
            floor_m -= config.figure.height_m
        people: list[AssumedPerson] = []
        for number in range(DIRECTIONS):
            turn_rad = math.tau * number / DIRECTIONS
            x = here_m[0] + AROUND_M * math.cos(turn_rad)
            y = here_m[1] + AROUND_M * math.sin(turn_rad)
            people.append(AssumedPerson((x, y, floor_m), apart_m))
        return people

    def _free_places(self) -> list[Vec3]:
        """Return the configured places at which nobody stands who was found."""
        taken: list[tuple[float, float]] = []
        for user, pose in self._poses.items():
            if user not in self.followers:
                taken.append(pose.position_m[:2])
        places: list[Vec3] = []
        for place_m in self._config.figure.people_m:
            if all(math.dist(place_m[:2], position_m) > FOUND_M for position_m in taken):
                places.append(place_m)
        return places
