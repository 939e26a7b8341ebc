"""Rays and a tracker with shifted stamps: the latency is found where it can be, and sigma covers the rest."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pointit.schemas import TrackedObjects
from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.moving_target import MovingTarget
from tests.unit.localizer.person import EYES_M, Person, config, poses, solved, yaw_difference
from tests.unit.localizer.test_moving_target import drone, error_m, fly

Array = NDArray[np.float64]

PUNCTUAL = SolverSettings(latency_sigma_s=0.0)


def circle(t_s: Array, centre: tuple[float, float], period_s: float, rise_m: float = 0.4) -> Array:
    """A robot on a circle of 1 m, up and down."""
    angle = math.tau * t_s / period_s
    x, y = centre[0] + np.cos(angle), centre[1] + np.sin(angle)
    return np.column_stack([x, y, 0.7 + rise_m * np.sin(2.0 * angle)])


def following(
    seed: int, late_s: float, period_s: float = 8.0, rise_m: float = 0.4
) -> tuple[Pointings, Person]:
    """Rays of one person at a robot for 10 s, reported `late_s` late: 2° of unrest, an elevation bias."""
    generator = np.random.default_rng(seed)
    x, y = generator.uniform(-2.0, 2.0, 2)
    person = Person(float(x), float(y), float(generator.uniform(-3.0, 3.0)))
    away, towards = generator.uniform(1.8, 3.5), generator.uniform(0.0, math.tau)
    centre = (person.x + away * math.cos(towards), person.y + away * math.sin(towards))
    t_s = np.arange(500) / 50.0
    steps = generator.normal(0.0, 1.0, (500, 2)) * np.radians([2.0, 1.5]) * math.sqrt(1.0 - 0.96**2)
    unrest = np.zeros((500, 2))
    for index in range(1, 500):
        unrest[index] = 0.96 * unrest[index - 1] + steps[index]
    reach = circle(t_s, centre, period_s, rise_m) - np.array([person.x, person.y, EYES_M])
    azimuths = np.arctan2(reach[:, 1], reach[:, 0]) - person.yaw_rad + unrest[:, 0]
    elevations = np.arctan2(reach[:, 2], np.hypot(reach[:, 0], reach[:, 1])) + unrest[:, 1]
    elevations += generator.normal(0.0, math.radians(4.0))
    level = np.cos(elevations)
    directions = np.column_stack([level * np.cos(azimuths), level * np.sin(azimuths), np.sin(elevations)])
    origins = np.tile([0.0, 0.0, EYES_M], (500, 1))
    return Pointings(t_s, origins, directions, circle(t_s - late_s, centre, period_s, rise_m)), person


def is_outside(solution: Solution, off_m: float, turned_rad: float) -> bool:
    """Whether a pose errs by more than twice what it states."""
    return off_m > 2.0 * solution.position_sigma_m or abs(turned_rad) > 2.0 * solution.yaw_sigma_rad


def test_a_level_circle_at_constant_speed_tells_no_latency_and_a_robot_that_rises_does() -> None:
    """A latency turns the pose about the middle of a level circle, and no residual shows it."""
    level, rising = (following(3, 0.2, 12.0, rise_m)[0] for rise_m in (0.0, 1.0))
    hidden, seen = (solved(each, SolverSettings(latency_sigma_s=0.15)) for each in (level, rising))
    assert hidden.latency_sigma_s > 0.12
    assert abs(hidden.latency_s) < 0.1
    assert seen.latency_sigma_s < 0.7 * hidden.latency_sigma_s
    assert seen.latency_s == pytest.approx(0.2, abs=2.0 * seen.latency_sigma_s)


def test_residual_is_without_the_latency_that_the_rays_show() -> None:
    late, punctual = (following(3, late_s, 12.0, 1.0)[0] for late_s in (0.25, 0.0))
    one, other = (solved(each, SolverSettings()) for each in (late, punctual))
    assert one.late_s == pytest.approx(0.25, abs=0.1)
    assert other.late_s == 0.0
    assert one.residual_rad < 1.2 * other.residual_rad < 0.6 * solved(late, PUNCTUAL).residual_rad


def test_known_latency_is_as_good_as_none() -> None:
    punctual, late = (following(5, late_s)[0] for late_s in (0.0, 0.3))
    one = solved(punctual, PUNCTUAL)
    other = solved(late, SolverSettings(latency_s=0.3, latency_sigma_s=0.0))
    assert (other.x_m, other.y_m) == pytest.approx((one.x_m, one.y_m), abs=0.1)
    assert abs(yaw_difference(other.yaw_rad, one.yaw_rad)) < math.radians(1.5)
    assert other.latency_s == pytest.approx(0.3)


@pytest.mark.parametrize("stated_s", [None, 0.0, 0.5])
def test_tracker_states_its_latency_with_every_report(stated_s: float | None) -> None:
    def stating(t_s: float) -> dict[str, TrackedObjects]:
        return {"room": drone(t_s)["room"].model_copy(update={"latency_sigma_s": stated_s})}

    pose = poses(fly(MovingTarget(config(autostart=True)), 15.0, reports=stating))[-1]
    assert error_m(pose) < 0.1
    sigma_rad = math.sqrt(pose.covariance[8])
    # 2.2° without a latency, 3.9° and 4.3° with: what of it the rays tell adds nothing
    assert (sigma_rad > math.radians(3.0)) == (stated_s != 0.0)


def test_refusal_names_the_latency_when_it_alone_makes_the_pose_uncertain() -> None:
    gathered, _ = following(1, 0.0, period_s=3.0, rise_m=0.0)
    assert isinstance(solve(gathered, PUNCTUAL), Solution)
    result = solve(gathered, SolverSettings())
    assert isinstance(result, Refusal)
    assert "uncertain by 0.15 s; have the tracker state its `latency_sigma_s`" in result.reason
    stricter = solve(gathered, SolverSettings(body_sigma_m=2.0))
    assert isinstance(stricter, Refusal)
    assert "latency" not in stricter.reason
