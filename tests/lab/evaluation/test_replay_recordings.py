"""A recorded person and robot through the services, imported and replayed, against motion capture."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from pointit.conversion.import_csv import INDEX, csv_entries
from pointit.conversion.recording_file import write_recording
from pointit.recording.entries import Entry
from pointit.recording.reader import Recording
from pointit.replay.playing import plan_replay, replay
from pointit.schemas import Localization, UserPose
from pointit.schemas.topics import LOCALIZATION, POSE, RAY
from pointit_lab.evaluation.localization.recorded import LIVE, read_sessions
from pointit_lab.evaluation.recordings.row import ALL, Row
from tests.support import there
from tests.support.data import data_file


class Result:
    """The entries that a replay yields."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []

    def recorded(self, entry: Entry) -> None:
        pass

    def replayed(self, entry: Entry, *, is_recomputed: bool) -> None:
        del is_recomputed
        self.entries.append(entry)

    def bodies(self, row: Any) -> list[Any]:
        return [entry.body for entry in self.entries if entry.row is row]


def replayed(folder: Path, name: str, mounting: str = "minus_x") -> Result:
    source = data_file(f"recordings/motion_relloc/{name}.csv")
    path = folder / "imported.mcap"
    write_recording(csv_entries(source, user="anna", mounting=mounting), path, "imported")
    result = Result()
    with Recording.open(path) as recording:
        replay(plan_replay(recording, "edge"), result)
    return result


def scored(folder: Path, entries: Sequence[Entry]) -> Row:
    """Return the errors of the poses that were found."""
    path = folder / "replayed.mcap"
    write_recording(entries, path, "replayed")
    (row,) = (row for row in read_sessions([path]).rows() if row.subject == ALL and row.solver == LIVE)
    return row


@pytest.mark.parametrize(
    ("name", "duration_s", "position_m", "yaw_deg"),
    [
        # measured, medians: .15 m 2.0°, .25 m 6.4°, .13 m 1.8°; the second stands 1.2 m from the robot and is
        # found 0.24 m too far from it: the model of the body errs, not the noise
        ("circle-s2", 67.7, 0.28, 4.0),
        ("triangle-s1", 37.7, 0.38, 9.0),
        ("triangle-s3", 39.5, 0.28, 5.0),
    ],
)
def test_the_pose_agrees_with_motion_capture(
    tmp_path: Path, name: str, duration_s: float, position_m: float, yaw_deg: float
) -> None:
    result = replayed(tmp_path, name)
    row = scored(tmp_path, result.entries)
    assert there(row.position_m).median < position_m
    assert there(row.yaw_deg).median < yaw_deg
    assert row.n > duration_s  # nearly twice a second, once it is found
    last = result.bodies(POSE)[-1]
    assert isinstance(last, UserPose)
    assert last.samples > 200  # of 300 in the window: hardly a sample got lost on the way
    assert len(result.bodies(RAY)) > 25.0 * duration_s


def test_the_wrong_mounting_is_noticed(tmp_path: Path) -> None:
    """An arm that points the other way: either nothing is accepted, or not in the right direction."""
    source = data_file(f"recordings/motion_relloc/{INDEX}")
    index = {each["file"]: each for each in json.loads(source.read_bytes())}
    minus_yaw_deg = index["triangle-s1.csv"]["ref_yaw_deg_human_minus_world"]
    for pose in replayed(tmp_path, "triangle-s1", mounting="metamotion").bodies(POSE):
        off_deg = math.degrees(pose.yaw_rad) + minus_yaw_deg
        assert abs(math.remainder(off_deg, 360.0)) > 45.0


def test_who_does_not_point_gets_no_pose(tmp_path: Path) -> None:
    source = data_file("recordings/motion_relloc/idle_4.csv")
    as_if = tmp_path / "idle.csv"  # without the index, which tells that nobody points
    as_if.write_bytes(source.read_bytes())
    path = tmp_path / "imported.mcap"
    write_recording(csv_entries(as_if, user="anna", mounting="minus_x"), path, "imported")
    result = Result()
    with Recording.open(path) as recording:
        replay(plan_replay(recording, "edge"), result)
    assert result.bodies(POSE) == []
    told = [each for each in result.bodies(LOCALIZATION) if isinstance(each, Localization)]
    assert any("the rays miss the targets" in each.reason for each in told)
