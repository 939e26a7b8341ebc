"""Reliability of the choice of a robot, by simulated people of whom a share points beside all robots.

Robots stand in a row, in a column or in a circle. A person turns to one of them, or to a place on the floor
near one, presses, and points on. The choice is that of the service `goal`.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal

import numpy as np

from pointit.schemas import NS_PER_S, PointingRay, RobotState, UserPose
from pointit.services.goal.robot_choice import PENDING_NS, RobotChoice
from pointit_lab.evaluation.recordings.row import ALL
from pointit_lab.evaluation.robots.identification import share
from pointit_lab.evaluation.robots.simulated_follower import RATE_HZ, Array, SimulatedFollower
from pointit_lab.evaluation.selection.difference import Interval

Layout = Literal["lone", "row", "column", "circle"]

LAYOUTS: tuple[tuple[Layout, int], ...] = (
    ("lone", 1),
    *((layout, count) for layout in ("row", "column", "circle") for count in (2, 3, 5)),
)
"""Arrangements, and numbers of robots."""

SHARES = (0.2, 0.5, 0.8)
"""Shares of pointings that are beside all robots."""

AIM_SIGMA_DEG = (3.0, 8.0)
"""Range of people's standard deviation of the aim: the constant error of one pointing, sideways."""

UPWARDS = 0.6
"""The same upwards, as a share of it."""

NEAREST_M, FARTHEST_M = 1.5, 3.5
"""Distances of the middle of the robots, or of the nearest one of a column."""

APART_M = (0.8, 1.5)
"""Range of the distances between neighbours."""

BESIDE_M = (0.5, 1.5)
"""Range of the distance of a place beside a robot. It is as far from the others, at least."""

POSITION_SIGMA_M, YAW_SIGMA_RAD = 0.15, math.radians(4.0)
"""Errors of the pose, drawn and stated."""

PRESS_S = 2.0
"""Time of the press after the arm began to move."""

AGAIN_S = 0.8
"""Time after which a person who means a robot presses again if asked to."""

STEP_S = 0.2
"""Time between two identifications after the press."""

SURE = 0.9
"""Probability from which the choice is judged."""

BEGIN_NS = 1000 * NS_PER_S

STILL: dict[str, Any] = {"velocity_mps": (0.0, 0.0, 0.0), "radius_m": 0.2}


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Result of one pointing."""

    seed: int
    layout: Layout
    robots: int
    is_beside: bool
    stated: float
    """Probability of the likeliest robot at the press."""
    is_right: bool
    """That robot is meant."""
    result: Literal["right", "wrong", "none"]
    """Robot that was taken by the press, or by pointing on."""
    is_asked: bool
    """The person was asked to press again, and did."""


@dataclass(frozen=True, kw_only=True)
class Reliability:
    """Rates of one arrangement, or of all, with 95 % intervals (Wilson)."""

    robots: str
    n: int
    """Pointings: half of them beside all robots."""
    right: Interval | None
    """Share of robots stated to be meant with `SURE` or more at the press that were meant."""
    stated: int
    """Number of these."""
    taken_right: tuple[float | None, ...]
    """Share of robots taken that were meant, by share of pointings beside (`SHARES`)."""
    at_once: Interval
    """Share of robots meant that the first press took, or pointing on."""
    taken: Interval
    """Share of robots meant that were taken, if a second press that was asked for counts, too."""
    started: Interval
    """Share of pointings beside that took a robot."""


def choices(seeds: Iterable[int], layouts: Sequence[tuple[Layout, int]] | None = None) -> list[Choice]:
    """Return the results of people, one a seed: each points at a robot, and beside, in each arrangement."""
    return [
        _chosen(seed, layout, count, is_beside=is_beside)
        for seed, (layout, count), is_beside in product(seeds, layouts or LAYOUTS, (False, True))
    ]


def reliabilities(results: Sequence[Choice]) -> list[Reliability]:
    """Return a row for each arrangement, and one for all."""
    groups: dict[str, list[Choice]] = {}
    for each in results:
        for name in (f"{each.robots} {each.layout}".removeprefix("1 "), ALL):
            groups.setdefault(name, []).append(each)
    return [_row(name, groups[name]) for name in (*(each for each in groups if each != ALL), ALL)]


def _row(name: str, group: Sequence[Choice]) -> Reliability:
    is_right = [each.result == "right" for each in group if not each.is_beside]
    right, wrong = sum(is_right), sum(each.result == "wrong" and not each.is_beside for each in group)
    started = sum(each.result != "none" and each.is_beside for each in group)
    sure = [each.is_right for each in group if each.stated >= SURE]
    taken = [right + wrong + started * beside / (1.0 - beside) for beside in SHARES]
    at_once = sum(each.result == "right" and not each.is_asked for each in group)
    return Reliability(
        robots=name,
        n=len(group),
        right=share(sum(sure), len(sure)) if sure else None,
        stated=len(sure),
        taken_right=tuple(right / count if count else None for count in taken),
        at_once=share(at_once, len(is_right)),
        taken=share(right, len(is_right)),
        started=share(started, len(group) - len(is_right)),
    )


def _chosen(seed: int, layout: Layout, count: int, *, is_beside: bool) -> Choice:
    rng = np.random.default_rng([seed, *layout.encode(), count, is_beside])
    follower = SimulatedFollower.drawn(rng)
    aim_deg = float(np.random.default_rng(seed).uniform(*AIM_SIGMA_DEG))
    follower = replace(
        follower,
        aim_rad=math.radians(float(rng.normal(0.0, aim_deg))),
        bias_rad=math.radians(float(rng.normal(0.0, UPWARDS * aim_deg))),
    )
    places = _places(follower, layout, count, rng)
    is_right = int(rng.integers(count))
    place = _beside(places, is_right, rng) if is_beside else places[is_right]
    times_s = np.arange(0.0, PRESS_S + PENDING_NS / NS_PER_S + 0.1, 1.0 / RATE_HZ)
    directions = follower.directions(lambda at: np.tile(place, (len(at), 1)), times_s, rng)
    choice = RobotChoice("press", 1.0)
    x_m, y_m = (float(value) for value in rng.normal((follower.x_m, follower.y_m), POSITION_SIGMA_M))
    covariance = np.diag([POSITION_SIGMA_M**2, POSITION_SIGMA_M**2, YAW_SIGMA_RAD**2]).ravel().tolist()
    yaw_rad = float(rng.normal(follower.yaw_rad, YAW_SIGMA_RAD))
    pose = UserPose(stamp_ns=0, position_m=(x_m, y_m, 0.0), yaw_rad=yaw_rad, covariance=tuple(covariance))
    choice.on_pose(pose)
    stated, likeliest, robot, next_s, again_s = 0.0, "", "", PRESS_S, math.inf
    is_asked = False
    for time_s, direction in zip(times_s.tolist(), directions, strict=True):
        now_ns = BEGIN_NS + round(time_s * NS_PER_S)
        ray = PointingRay(stamp_ns=now_ns, origin_m=(0.0, 0.0, follower.eyes_m), direction=_vec3(direction))
        choice.on_ray(ray)
        if time_s < next_s:
            continue
        for number, at in enumerate(places):
            state = RobotState(
                stamp_ns=now_ns, kind="ground", phase="idle", position_m=_vec3(at), yaw_rad=0.0, **STILL
            )
            choice.on_robot(str(number), state)
        if next_s == PRESS_S:
            robot, problem = choice.press(now_ns)
            again_s = PRESS_S + AGAIN_S if "press again" in problem and not is_beside else math.inf
            if choice.candidates:
                stated, likeliest = choice.candidates[0].probability, choice.candidates[0].object_id
        else:
            found = choice.step(now_ns)
            robot = "" if found is None else found.robot
        if not robot and time_s >= again_s:
            robot, again_s, is_asked = choice.press(now_ns).robot, math.inf, True
        next_s += STEP_S
        if robot:
            break
    is_intended = not is_beside and robot == str(is_right)
    return Choice(
        seed=seed,
        layout=layout,
        robots=count,
        is_beside=is_beside,
        stated=stated,
        is_right=not is_beside and likeliest == str(is_right),
        result="none" if not robot else "right" if is_intended else "wrong",
        is_asked=is_asked,
    )


def _places(follower: SimulatedFollower, layout: Layout, count: int, rng: np.random.Generator) -> list[Array]:
    """Return the places of robots on the floor."""
    way, reach_m = rng.uniform(-math.pi, math.pi), rng.uniform(NEAREST_M, FARTHEST_M)
    apart_m = rng.uniform(*APART_M)
    ahead = np.array([math.cos(way), math.sin(way), 0.0])
    aside = np.array([-ahead[1], ahead[0], 0.0])
    feet = np.array([follower.x_m, follower.y_m, 0.0])
    if layout == "circle":
        radius_m = 0.5 * apart_m / math.sin(math.pi / count)
        turns = rng.uniform(0.0, math.tau) + math.tau * np.arange(count) / count
        middle = feet + (reach_m + max(0.0, radius_m - 0.5)) * ahead
        return [middle + radius_m * (math.cos(turn) * ahead + math.sin(turn) * aside) for turn in turns]
    steps = apart_m * (np.arange(count) - (0.0 if layout == "column" else 0.5 * (count - 1)))
    along = ahead if layout == "column" else aside
    return [feet + reach_m * ahead + step * along for step in steps]


def _beside(places: Sequence[Array], robot: int, rng: np.random.Generator) -> Array:
    """Return a place near one of the robots, and at none."""
    while True:
        way, away_m = rng.uniform(-math.pi, math.pi), rng.uniform(*BESIDE_M)
        place = places[robot] + away_m * np.array([math.cos(way), math.sin(way), 0.0])
        if min(math.dist(place, each) for each in places) >= BESIDE_M[0]:
            return place


def _vec3(values: Array) -> tuple[float, float, float]:
    return (float(values[0]), float(values[1]), float(values[2]))
