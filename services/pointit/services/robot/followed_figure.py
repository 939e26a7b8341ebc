"""Figures that a robot flies or drives while a person follows it with the arm, to find where they stand.

The figure is chosen for information: the smallest standard deviation of the person's position that any
unbiased estimate could have (Cramér and Rao) from the directions of the robot, with yaw, elevation bias and
latency unknown as well (pointing.md §4). Pure.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.vector import Vec3

Array = NDArray[np.float64]

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

    name: str
    points_m: tuple[Vec3, ...]
    sigma_m: float
    """1 sigma of the position, along the worse direction, that the figure permits; mean over the people."""


def figures(
    start_m: Vec3, people: Sequence[AssumedPerson], *, length_m: float, is_flying: bool
) -> list[FollowedFigure]:
    """Return the figures through `start_m` that keep away from `people`, the most informative first.

    Args:
        start_m: place of the robot, {W}.
        people: places at which the person may stand, equally probable; at least one.
        length_m: length of the course.
        is_flying: True if the height may change.
    """
    named = list(_courses(length_m, is_flying=is_flying))
    courses = np.stack([course for _, course in named]) + start_m
    places = np.array([person.place_m for person in people])
    apart = np.linalg.norm(courses[:, None, :, :2] - places[:, None, :2], axis=3).min(axis=2)
    is_clear = (apart >= [person.keep_out_m for person in people]).all(axis=1)
    if is_flying:
        is_clear &= courses[:, :, 2].min(axis=1) >= min(LOWEST_M, start_m[2])
    sigmas = position_sigmas_m(courses[is_clear], places).mean(axis=1)
    found = [
        FollowedFigure(named[index][0], tuple(_vec3(point) for point in courses[index]), float(sigma_m))
        for index, sigma_m in zip(np.flatnonzero(is_clear).tolist(), sigmas, strict=True)
    ]
    return sorted(found, key=lambda each: each.sigma_m)


def best_figure(
    ranked: Sequence[FollowedFigure], is_permitted: Callable[[Sequence[Vec3]], bool]
) -> FollowedFigure | None:
    """Return the first of `ranked` whose way is permitted, or None."""
    return next((figure for figure in ranked if is_permitted(figure.points_m)), None)


def position_sigmas_m(courses_m: Array, places_m: Array, duration_s: float = 5.0) -> Array:
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
    slope[0, ..., 0], slope[0, ..., 1] = away[..., 1] / (level * reach), -away[..., 0] / (level * reach)
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


def _courses(length_m: float, *, is_flying: bool) -> Iterator[tuple[str, Array]]:
    """Yield named courses (n x 3) from the origin and back, each of `length_m`."""
    share = np.linspace(0.0, math.tau, POINTS)
    shapes = [
        (("line", "ellipse", "circle")[index], np.stack([1.0 - np.cos(share), aspect * np.sin(share)]))
        for index, aspect in enumerate(ASPECTS)
    ]
    shapes.append(("eight", np.stack([np.sin(share), 0.5 * np.sin(2.0 * share)])))
    for name, (along, aside) in shapes:
        for rise_m in RISES_M if is_flying else RISES_M[:1]:
            for rate in (1.0, 2.0) if rise_m else (1.0,):
                if 2.0 * rate * rise_m > MAX_VERTICAL * length_m:
                    continue
                up = rise_m * 0.5 * (1.0 - np.cos(rate * share))
                level_m = _level_length(along, aside, up, length_m)
                for turn in np.arange(TURNS) * math.tau / TURNS:
                    x = level_m * (along * math.cos(turn) - aside * math.sin(turn))
                    y = level_m * (along * math.sin(turn) + aside * math.cos(turn))
                    yield name, np.stack([x, y, up], axis=1)


def _level_length(along: Array, aside: Array, up: Array, length_m: float) -> float:
    """Return the factor on `along` and `aside` that makes the course `length_m` long."""
    low, high = 0.0, length_m
    for _ in range(30):
        middle = 0.5 * (low + high)
        steps = np.diff(np.stack([middle * along, middle * aside, up]), axis=1)
        is_longer = float(np.linalg.norm(steps, axis=0).sum()) > length_m
        low, high = (low, middle) if is_longer else (middle, high)
    return low


def _vec3(values: Array) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
