"""Offsets of people, and the baselines of localization."""

import math
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from pointit.runtime.errors import ConfigError
from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.datasets import read_trials
from pointit_lab.evaluation.datasets.vr_eyefinger import read_wall_trials
from pointit_lab.evaluation.localization import baselines
from pointit_lab.evaluation.localization.trial import LocalizationTrial
from pointit_lab.evaluation.pointing.offset import offset_rows
from pointit_lab.evaluation.recordings.row import ALL, Row
from tests.support import there
from tests.support.data import data_file
from tests.support.published_recordings import Stand, write_motion

HEADER = (
    "subject,session,feedback,tar_x,tar_y,index_x,index_y,index_z,efrc_dir_x,efrc_dir_y,efrc_dir_z,t_confirm"
)
EYE_M = np.array([0.05, 1.65, -1.5])
"""x right, y up, z ahead."""
BIAS_DEG = 4.0


def write_set(folder: Path, *, noise_deg: float = 0.0) -> Path:
    """Write two people who point 4 deg too low, and 3 deg to the right, at nine places, twice each."""
    rng = np.random.default_rng(1)
    lines = [HEADER]
    for subject in ("a", "b"):
        for feedback in ("hand", "none", "cursor"):
            for _ in range(2):
                for x in (-1.0, 0.0, 1.0):
                    for y in (0.8, 1.8, 2.8):
                        way = np.array([x, y, 2.0]) - EYE_M
                        right = math.atan2(way[0], way[2]) + math.radians(3.0)
                        up = math.atan2(way[1], math.hypot(way[0], way[2])) - math.radians(
                            BIAS_DEG + noise_deg * rng.standard_normal()
                        )
                        ray = np.array(
                            [math.cos(up) * math.sin(right), math.sin(up), math.cos(up) * math.cos(right)]
                        )
                        finger = EYE_M + 0.6 * ray
                        numbers = ",".join(f"{value:.6f}" for value in (x, y, *finger, *ray))
                        lines.append(f"{subject},1,{feedback},{numbers},0.0")
    (folder / "vr_eyefinger").mkdir(parents=True)
    path = folder / "vr_eyefinger" / "wall_targets.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def one(rows: list[Row], condition: str, solver: str, subject: str = ALL, name: str = "vr_eyefinger") -> Row:
    (row,) = [
        row
        for row in rows
        if (row.set, row.condition, row.solver, row.subject) == (name, condition, solver, subject)
    ]
    return row


def pitch_deg(row: Row) -> float:
    return there(row.pitch_deg).rms


def test_the_reader_finds_the_eyes_and_turns_the_axes(tmp_path: Path) -> None:
    write_set(tmp_path)
    trials = read_wall_trials(tmp_path / "vr_eyefinger")
    assert [(each.subject, each.feedback) for each in trials][:3] == [
        ("a", "hand"),
        ("a", "none"),
        ("a", "cursor"),
    ]
    for each in trials:
        # ahead 3.5 m, to the left minus x, up
        up_deg = np.degrees(np.arcsin(each.ways[:, 2]) - np.arcsin(each.directions[:, 2]))
        left_deg = np.degrees(
            np.arctan2(each.ways[:, 1], each.ways[:, 0])
            - np.arctan2(each.directions[:, 1], each.directions[:, 0])
        )
        assert np.allclose(up_deg, BIAS_DEG, atol=1e-3)
        assert np.allclose(left_deg, 3.0, atol=1e-3)
        assert len(set(each.targets.tolist())) == 9


def test_a_constant_error_is_gone_but_for_the_prior(tmp_path: Path) -> None:
    write_set(tmp_path)
    told: list[str] = []
    rows = offset_rows(tmp_path, told.append)
    assert told == [f"vr_eyefinger {subject}" for subject in ("a", "a", "b", "b")]
    assert pitch_deg(one(rows, "no anchor, hand seen", "none")) == pytest.approx(BIAS_DEG, abs=1e-3)
    assert pitch_deg(one(rows, "1 anchor, hand seen", "none")) == pytest.approx(BIAS_DEG, abs=1e-3)
    left = pitch_deg(one(rows, "1 anchor, hand seen", "pitch"))
    assert left == pytest.approx(BIAS_DEG / 17.0, abs=1e-3)
    ladder = one(rows, "8 anchors, nothing seen", "ladder", "b")
    assert there(ladder.angle_deg).rms < 0.1
    assert (ladder.within_2_sigma, ladder.refused) == (1.0, 0)
    assert pitch_deg(one(rows, "1 anchor, hand seen", "bound")) == pytest.approx(0.0, abs=1e-3)
    assert not any("cursor" in row.condition for row in rows)


def test_each_run_is_the_same_and_scatter_is_the_bound(tmp_path: Path) -> None:
    write_set(tmp_path, noise_deg=1.0)
    rows = offset_rows(tmp_path, lambda _: None)
    assert rows == offset_rows(tmp_path, lambda _: None)
    for count in ("1 anchor", "2 anchors", "4 anchors"):
        found = pitch_deg(one(rows, f"{count}, hand seen", "pitch"))
        bound = pitch_deg(one(rows, f"{count}, hand seen", "bound"))
        assert 0.8 * bound < found < 1.2 * bound


def test_damage_is_told_with_its_line(tmp_path: Path) -> None:
    path = write_set(tmp_path)
    path.write_text(path.read_text(encoding="utf-8") + "a,1,hand,0,1,0,1,-1,0,0,2,0\n", encoding="utf-8")
    with pytest.raises(
        ConfigError, match="line 110, columns 'efrc_dir_…': a unit vector was expected"
    ) as error:
        offset_rows(tmp_path, lambda _: None)
    assert str(error.value).startswith(str(path))


def test_rays_that_do_not_tell_where_the_eyes_are_are_refused(tmp_path: Path) -> None:
    path = write_set(tmp_path)
    path.write_text(HEADER + "\n" + "a,1,hand,0,1,0,1,-1,0,0,1,0\n" * 9, encoding="utf-8")
    with pytest.raises(ConfigError, match="subject a are too few, or too similar"):
        read_wall_trials(tmp_path / "vr_eyefinger")


@pytest.mark.long
def test_recorded_people() -> None:
    """Pitch of a new person, held-out targets, rms; target of the issue: at most 1.5 deg after one anchor."""
    rows = offset_rows(data_file("recordings"), lambda _: None)
    assert pitch_deg(one(rows, "no anchor, hand seen", "none")) > 2.0
    assert pitch_deg(one(rows, "1 anchor, hand seen", "pitch")) < 1.0
    ladder = one(rows, "8 anchors, hand seen", "ladder")
    before = one(rows, "no anchor, hand seen", "none")
    assert there(ladder.angle_deg).rms < 0.33 * there(before.angle_deg).rms
    for anchors in ("1 anchor", "2 anchors", "4 anchors", "8 anchors"):
        for seen, solver in product(("hand seen", "nothing seen"), ("pitch", "ladder")):
            within = one(rows, f"{anchors}, {seen}", solver).within_2_sigma
            assert within is not None
            assert within >= 0.88
    floor = "proximity_feedback"
    assert pitch_deg(one(rows, "no anchor", "none", name=floor)) > 3.4
    # the scatter within these people alone allows 1.74 deg
    found = pitch_deg(one(rows, "1 anchor", "pitch", name=floor))
    assert found < 1.06 * pitch_deg(one(rows, "1 anchor", "bound", name=floor)) < 1.06 * 1.8


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


def test_an_elevation_bias_becomes_metres_with_the_floor_fixed_and_height_without(tmp_path: Path) -> None:
    stand = Stand(yaw_deg=10.0, bias_deg=8.0)
    pointings = window(tmp_path, stand).pointings
    fixed, free = baselines.mean_angle_z0(pointings), baselines.mean_angle_4dof(pointings)
    fixed_m = math.hypot(fixed.x_m - stand.x, fixed.y_m - stand.y)
    free_m = math.hypot(free.x_m - stand.x, free.y_m - stand.y)
    assert fixed_m > 0.3
    assert free_m < fixed_m / 2.0
    assert free.z_m < -0.1
