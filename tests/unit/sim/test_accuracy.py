"""Poses against motion capture: errors, signs, buckets, the index beside a recording."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from pointit.runtime.errors import ConfigError
from pointit.schemas import UserPose
from pointit.sim.accuracy import Accuracy, reference_yaw_deg
from pointit.sim.recordings import ImuRecording

START_NS = 1_000_000_000


def recording(*, head: bool = True) -> ImuRecording:
    """A head that walks along x with 1 m/s."""
    t_s = np.linspace(0.0, 20.0, 201)
    head_m = np.column_stack([t_s, np.full_like(t_s, 2.0), np.full_like(t_s, 1.8)]) if head else None
    orientation = np.tile([0.0, 0.0, 0.0, 1.0], (201, 1))
    return ImuRecording(path=Path("walk.csv"), t_s=t_s, orientation_xyzw=orientation, head_m=head_m)


def pose(t_s: float, x: float, y: float, yaw_deg: float = 0.0) -> UserPose:
    return UserPose(
        stamp_ns=START_NS + round(t_s * 1e9),
        position_m=(x, y, 0.0),
        yaw_rad=math.radians(yaw_deg),
        covariance=(0.04, 0.0, 0.0, 0.0, 0.09, 0.0, 0.0, 0.0, math.radians(2.0) ** 2),
        samples=30,
    )


def test_a_pose_is_compared_with_the_head_at_its_own_time() -> None:
    row = Accuracy(recording(), START_NS, yaw_deg=-170.0).add(pose(4.05, 4.05 + 0.3, 2.4, yaw_deg=175.0))
    assert row.position_error_m == pytest.approx(0.5)
    assert row.yaw_error_deg == pytest.approx(-15.0)  # 175 is 15 short of 190
    assert row.position_sigma_m == pytest.approx(0.3)
    assert row.yaw_sigma_deg == pytest.approx(2.0)


def test_nothing_is_invented_without_ground_truth() -> None:
    accuracy = Accuracy(recording(head=False), START_NS)
    row = accuracy.add(pose(1.0, 0.0, 0.0))
    assert row.position_error_m is None
    assert row.yaw_error_deg is None
    assert accuracy.overall()["position_error_m_median"] is None


def test_buckets_of_five_seconds() -> None:
    accuracy = Accuracy(recording(), START_NS, yaw_deg=0.0)
    for t_s, error_m in ((1.0, 0.1), (2.0, 0.3), (4.9, 0.2), (11.0, 1.0)):
        accuracy.add(pose(t_s, t_s, 2.0 + error_m, yaw_deg=-4.0))
    first, third = accuracy.buckets()
    assert (first["from_s"], first["to_s"], first["poses"]) == (0.0, 5.0, 3)
    assert first["position_error_m_median"] == pytest.approx(0.2)
    assert first["position_error_m_p90"] == pytest.approx(0.28)
    assert first["yaw_error_deg_median"] == pytest.approx(4.0)
    assert (third["from_s"], third["poses"]) == (10.0, 1)
    assert accuracy.overall()["poses"] == 4


def test_the_reference_yaw_changes_sign(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    assert reference_yaw_deg(path) is None
    index = tmp_path / "index.json"
    index.write_text(
        json.dumps([{"file": "b.csv"}, {"file": "a.csv", "ref_yaw_deg_human_minus_world": 19.5}])
    )
    assert reference_yaw_deg(path) == -19.5
    assert reference_yaw_deg(tmp_path / "b.csv") is None


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("[", "JSON list"),
        ("{}", "list"),
        ('[{"file": "a.csv", "ref_yaw_deg_human_minus_world": "west"}]', "'west'"),
    ],
)
def test_a_broken_index_is_named(tmp_path: Path, text: str, what: str) -> None:
    (tmp_path / "index.json").write_text(text)
    with pytest.raises(ConfigError, match=r"index\.json") as caught:
        reference_yaw_deg(tmp_path / "a.csv")
    assert what in str(caught.value)
