"""Baselines of localization."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.datasets import read_trials
from pointit_lab.evaluation.localization import baselines
from pointit_lab.evaluation.localization.trial import LocalizationTrial
from tests.support.published_recordings import Stand, write_motion


def window(folder: Path, stand: Stand) -> LocalizationTrial:
    write_motion(folder, stand)
    return next(trial for trial in read_trials(folder).trials if trial.condition == "8 s")


@pytest.mark.parametrize("solver", [baselines.mean_angle_4dof, baselines.mean_angle_z0])
def test_perfect_rays_give_the_true_pose(
    solver: Callable[[Pointings], baselines.BaselineEstimate], tmp_path: Path
) -> None:
    stand = Stand(x=-1.5, y=-1.0, yaw_deg=10.0)
    guess = solver(window(tmp_path, stand).pointings)
    assert (guess.x_m, guess.y_m, guess.z_m) == pytest.approx((stand.x, stand.y, 0.0), abs=0.01)
    assert math.degrees(guess.yaw_rad) == pytest.approx(stand.yaw_deg, abs=0.5)


def test_elevation_bias_becomes_metres_with_a_fixed_floor_only(tmp_path: Path) -> None:
    stand = Stand(yaw_deg=10.0, bias_deg=8.0)
    pointings = window(tmp_path, stand).pointings
    fixed = baselines.mean_angle_z0(pointings)
    free = baselines.mean_angle_4dof(pointings)
    fixed_m = math.hypot(fixed.x_m - stand.x, fixed.y_m - stand.y)
    free_m = math.hypot(free.x_m - stand.x, free.y_m - stand.y)
    assert fixed_m > 0.3
    assert free_m < fixed_m / 2.0
    assert free.z_m < -0.1
