"""Readers of recordings: frames and signs, repeats, windows, other people's files, damage."""

import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets import SETS, read_trials
from pointit_lab.evaluation.localization.baselines import mean_angle
from pointit_lab.evaluation.localization.trial import LocalizationTrial
from pointit_lab.evaluation.recordings.data_folder import recordings_folder
from tests.support.data import data_file
from tests.support.published_recordings import Stand, write_acts, write_motion, write_track

STAND = Stand()


def miss_rad(trial: LocalizationTrial) -> float:
    """Return by how much the rays miss the targets at the true pose."""
    assert trial.yaw_rad is not None
    return mean_angle(trial.pointings, trial.x_m, trial.y_m, 0.0, trial.yaw_rad)


def test_a_forearm_sensor_gives_rays_at_the_robot(tmp_path: Path) -> None:
    write_motion(tmp_path, STAND, repeat=10_000)
    trials = read_trials(tmp_path, ["motion_relloc"]).trials
    assert max(miss_rad(trial) for trial in trials) < 1e-6
    assert {(trial.subject, round(trial.eye_height_m, 3)) for trial in trials} == {("M9", 1.69)}
    assert (trials[0].x_m, trials[0].y_m) == pytest.approx((STAND.x, STAND.y))


def test_repeated_quaternions_are_dropped(tmp_path: Path) -> None:
    write_motion(tmp_path, STAND, repeat=4)
    trials = read_trials(tmp_path, ["motion_relloc"]).trials
    assert max(miss_rad(trial) for trial in trials) < 1e-6  # a repeated one would be late
    assert {len(trial.pointings) for trial in trials if trial.condition == "10 s"} <= {225, 226}


def test_points_on_the_floor_give_rays_at_the_robot(tmp_path: Path) -> None:
    write_track(tmp_path, Stand(bias_deg=-6.0))
    trials = read_trials(tmp_path, ["proximity_waypoints"]).trials
    assert {trial.subject for trial in trials} == {"user9"}
    for trial in trials:
        assert miss_rad(trial) == pytest.approx(math.radians(6.0), abs=1e-4)


def test_rays_that_miss_the_floor_are_left_out(tmp_path: Path) -> None:
    write_track(tmp_path, Stand(bias_deg=26.0))
    trials = read_trials(tmp_path).trials
    rays = np.concatenate([trial.pointings.directions for trial in trials])
    assert np.all(np.isfinite(rays))
    assert np.all(rays[:, 2] < 0.0)
    whole = max(len(trial.pointings) for trial in trials if trial.condition == "1 s")
    assert min(len(trial.pointings) for trial in trials if trial.condition == "1 s") < whole


def test_missing_eye_height_is_derived_from_the_marker(tmp_path: Path) -> None:
    path = write_track(tmp_path, STAND).parent / "index.json"
    index = json.loads(path.read_text())
    del index["files"][1]["eye_height_guess_m"]
    path.write_text(json.dumps(index))
    assert read_trials(tmp_path).trials[0].eye_height_m == pytest.approx(1.69)


def test_acts_give_rays_at_different_targets(tmp_path: Path) -> None:
    write_acts(tmp_path, {"1": (1.6, STAND), "13": (1.9, Stand(x=0.3))})
    trials = read_trials(tmp_path).trials
    assert Counter((trial.subject, trial.condition) for trial in trials) == {
        (subject, f"{count} targets"): 100 for subject in ("1", "13") for count in (2, 3, 4, 6)
    }
    for trial in trials:
        assert miss_rad(trial) < 1e-6
        targets = np.unique(trial.pointings.targets_m, axis=0)
        assert f"{len(targets)} targets" == trial.condition
        assert trial.pointings.span_s < 2.0 * len(targets)  # pauses between the holds
    yaws = [trial.yaw_rad for trial in trials if trial.yaw_rad is not None]
    assert len(set(yaws)) == len(trials)  # nobody starts at the truth by chance
    assert {round(one.eye_height_m, 3) for one in trials} == {round(1.64 * h / 1.835, 3) for h in (1.6, 1.9)}


def test_the_same_acts_are_drawn_whoever_else_is_there(tmp_path: Path) -> None:
    write_acts(tmp_path / "both", {"1": (1.6, STAND), "13": (1.9, STAND)})
    write_acts(tmp_path / "one", {"13": (1.9, STAND)})
    both = read_trials(tmp_path / "both", subjects=["13"]).trials
    one = read_trials(tmp_path / "one").trials
    assert len(both) == len(one) == 400
    for a, b in zip(both, one, strict=True):
        np.testing.assert_array_equal(a.pointings.targets_m, b.pointings.targets_m)
    drawn = {tuple(trial.pointings.targets_m[:: len(trial.pointings) // 2].ravel()) for trial in one[:100]}
    assert len(drawn) > 20


def test_the_data_may_be_the_root_or_the_recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inner = tmp_path / "recordings"
    inner.mkdir()
    assert recordings_folder(tmp_path) == inner
    assert recordings_folder(inner) == inner
    monkeypatch.setenv("POINTIT_DATA", str(tmp_path))
    assert recordings_folder(None) == inner
    monkeypatch.delenv("POINTIT_DATA")
    with pytest.raises(ConfigError, match="--data DIR or set POINTIT_DATA"):
        recordings_folder(None)
    with pytest.raises(ConfigError, match="not a folder"):
        recordings_folder(tmp_path / "nowhere")


def test_missing_datasets_are_named_and_skipped(tmp_path: Path) -> None:
    write_motion(tmp_path, STAND)
    reading = read_trials(tmp_path)
    assert len(reading.notes) == 3
    for name in ("lost.csv", "proximity_waypoints", "vr_arm_pointing"):
        assert sum(name in note for note in reading.notes) == 1
    assert {trial.set for trial in reading.trials} == {"motion_relloc"}


def test_nothing_to_evaluate_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="has none of the folders"):
        read_trials(tmp_path)
    (tmp_path / "vr_arm_pointing").mkdir()
    with pytest.raises(ConfigError, match=r"nothing to evaluate.*endpoints.csv"):
        read_trials(tmp_path)
    write_track(tmp_path, STAND, subject=7)
    with pytest.raises(ConfigError, match="no subject 'anna'; there are 7"):
        read_trials(tmp_path, subjects=["anna"])


@pytest.mark.parametrize("name", SETS)
def test_published_recordings_are_read(name: str) -> None:
    folder = data_file(f"recordings/{name}")
    trials = read_trials(folder.parent, [name]).trials
    assert len(trials) >= 100
    assert np.median([miss_rad(trial) for trial in trials]) < math.radians(20.0)
