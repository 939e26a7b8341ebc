"""The baselines do what their description says, its weaknesses included."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.datasets import read_trials
from pointit_lab.evaluation.localization.baselines import (
    BaselineEstimate,
    mean_angle,
    mean_angle_4dof,
    mean_angle_z0,
)
from pointit_lab.evaluation.localization.trial import Trial
from tests.support.published_recordings import Stand, write_motion


def window(folder: Path, stand: Stand) -> Trial:
    write_motion(folder, stand)
    return next(trial for trial in read_trials(folder).trials if trial.condition == "8 s")


def test_the_mean_angle_is_that_of_each_ray(tmp_path: Path) -> None:
    pointings = window(tmp_path, Stand()).pointings
    x, y, z, yaw = 0.4, -0.3, 0.2, 1.1
    angles: list[float] = []
    for origin, ray, target in zip(
        pointings.origins_m, pointings.directions, pointings.targets_m, strict=True
    ):
        turned = [
            math.cos(yaw) * ray[0] - math.sin(yaw) * ray[1],
            math.sin(yaw) * ray[0] + math.cos(yaw) * ray[1],
        ]
        away = target - (x, y, z) - origin  # the origin is over the feet, so it does not turn
        cosine = float(np.dot([*turned, ray[2]], away) / np.linalg.norm(away))
        angles.append(math.acos(cosine))
    assert mean_angle(pointings, x, y, z, yaw) == pytest.approx(float(np.mean(angles)))


@pytest.mark.parametrize("solver", [mean_angle_4dof, mean_angle_z0])
def test_perfect_rays_give_the_true_pose(
    solver: Callable[[Pointings], BaselineEstimate], tmp_path: Path
) -> None:
    stand = Stand(x=-1.5, y=-1.0, yaw_deg=10.0)
    guess = solver(window(tmp_path, stand).pointings)
    assert (guess.x_m, guess.y_m, guess.z_m) == pytest.approx((stand.x, stand.y, 0.0), abs=0.01)
    assert math.degrees(guess.yaw_rad) == pytest.approx(stand.yaw_deg, abs=0.5)


def test_an_elevation_bias_becomes_metres_with_the_floor_fixed_and_height_without(tmp_path: Path) -> None:
    stand = Stand(yaw_deg=10.0, bias_deg=8.0)
    pointings = window(tmp_path, stand).pointings
    fixed, free = mean_angle_z0(pointings), mean_angle_4dof(pointings)
    fixed_m = math.hypot(fixed.x_m - stand.x, fixed.y_m - stand.y)
    free_m = math.hypot(free.x_m - stand.x, free.y_m - stand.y)
    assert fixed_m > 0.3
    assert free_m < fixed_m / 2.0
    assert free.z_m < -0.1


def test_they_begin_at_zero_and_may_end_in_a_wrong_place(tmp_path: Path) -> None:
    stand = Stand(x=2.5, y=2.5, yaw_deg=170.0)
    trial = window(tmp_path, stand)
    guess = mean_angle_z0(trial.pointings)
    reached = mean_angle(trial.pointings, guess.x_m, guess.y_m, 0.0, guess.yaw_rad)
    assert reached < mean_angle(trial.pointings, 0.0, 0.0, 0.0, 0.0)  # downhill at least
