"""A CSV file of an arm as a recording."""

import csv
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from pointit.cli.main import command
from pointit.conversion.import_csv import EPOCH_NS, csv_entries
from pointit.geometry import rotation, vector
from pointit.recording.reader import Recording
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S, ImuSample, PointingRay, TrackedObjects
from pointit.schemas.topics import CONFIGURATION, IMU, LOCALIZATION, OBJECTS, PROFILE, RAY
from tests.support.data import data_file
from tests.support.published_recordings import Stand, write_motion, write_track


def invoke(*arguments: str) -> str:
    result = CliRunner().invoke(command, [*arguments], standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    return result.stdout


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    return write_motion(tmp_path, Stand(), duration_s=3.0)


def test_arm_robot_and_head_are_streams_in_order_of_time(motion: Path) -> None:
    entries = list(csv_entries(motion, user="anna", mounting="minus_x"))
    counts = {key: sum(entry.key == key for entry in entries) for key in {entry.key for entry in entries}}
    assert counts == {
        PROFILE.at("anna"): 1,
        LOCALIZATION.at("anna"): 1,
        CONFIGURATION.at("pointing.anna"): 1,
        CONFIGURATION.at("localizer.anna"): 1,
        IMU.at("anna"): 91,
        OBJECTS.at("robot"): 91,
        OBJECTS.at("mocap"): 91,
    }
    times = [entry.time_ns for entry in entries]
    assert times == sorted(times)
    assert (times[0], times[-1]) == (EPOCH_NS, EPOCH_NS + 3 * NS_PER_S)


def test_the_mounting_is_taken_off(motion: Path) -> None:
    stand = Stand()
    entries = list(csv_entries(motion, user="anna", mounting="minus_x"))
    robot = next(entry.body for entry in entries if entry.key == OBJECTS.at("robot"))
    arm = next(entry.body for entry in entries if entry.key == IMU.at("anna"))
    assert isinstance(robot, TrackedObjects)
    assert isinstance(arm, ImuSample)
    azimuth = vector.azimuth(rotation.rotate(arm.orientation_xyzw, (1.0, 0.0, 0.0)))
    expected = stand.rays(np.array([robot.objects[0].position_m]))[0, 0]
    assert abs(vector.wrap(azimuth - float(expected))) < 1e-6


def test_points_on_the_floor_become_rays_from_the_eyes(tmp_path: Path) -> None:
    stand = Stand()
    track = write_track(tmp_path, stand, duration_s=3.0)
    entries = list(csv_entries(track, user="anna", mounting="minus_x"))
    rays = [entry.body for entry in entries if entry.row is RAY]
    robots = {entry.time_ns: entry.body for entry in entries if entry.key == OBJECTS.at("robot")}
    with track.open(newline="") as file:
        assert len(rays) == sum(bool(row["px"]) for row in csv.DictReader(file))
    for ray in rays:
        assert isinstance(ray, PointingRay)
        assert ray.origin_m == pytest.approx((0.0, 0.0, stand.eyes_m))
        robot = robots[ray.stamp_ns]
        assert isinstance(robot, TrackedObjects)
        azimuth, elevation = stand.rays(np.array([robot.objects[0].position_m]))[0].tolist()
        assert vector.angle_between(ray.direction, vector.direction(azimuth, elevation)) < 1e-6

    assert {entry.key for entry in entries} >= {LOCALIZATION.at("anna"), CONFIGURATION.at("localizer.anna")}
    assert CONFIGURATION.at("pointing.anna") not in {entry.key for entry in entries}


def test_the_command_writes_a_recording_that_is_not_overwritten(motion: Path, tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    assert invoke("import", str(motion), "--to", str(path), "--user", "anna") == f"{path}: 277 entries\n"
    with Recording.open(path) as recording:
        assert recording.counts[IMU.at("anna")] == 91
        assert recording.problem == ""
    with pytest.raises(ConfigError, match="exists already; give another file, or --overwrite"):
        invoke("import", str(motion), "--to", str(path))
    invoke("import", str(motion), "--to", str(path), "--overwrite")


LOST = {"robot_x": "-99", "robot_y": "-99", "robot_z": "-99.0"}, {"head_x": "", "head_y": "", "head_z": ""}
LOST_ARM = dict.fromkeys(("qw", "qx", "qy", "qz"), "NaN")


def test_lost_markers_have_no_entries_and_their_gaps_are_printed(motion: Path, tmp_path: Path) -> None:
    with motion.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for lost, gap in zip((*LOST, LOST_ARM), (range(10, 20), range(30, 35), range(40, 43)), strict=True):
        for row in gap:
            rows[row] |= lost
    path = motion.with_name("gaps.csv")
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0], delimiter=";")
        writer.writeheader()
        writer.writerows(rows)

    result = CliRunner().invoke(
        command, ["import", str(path), "--to", str(tmp_path / "gaps.mcap"), "--lost", "-99"]
    )
    assert result.exit_code == 0

    times: dict[str, list[int]] = {}
    with Recording.open(tmp_path / "gaps.mcap") as recording:
        for entry in recording.entries():
            times.setdefault(entry.key, []).append(round((entry.time_ns - EPOCH_NS) * 30 / NS_PER_S))
            if isinstance(entry.body, TrackedObjects):
                assert vector.norm(entry.body.objects[0].position_m) > 0.5

    every = set(range(91))
    assert set(times[OBJECTS.at("robot")]) == every - {*range(10, 20)}
    assert set(times[OBJECTS.at("mocap")]) == every - {*range(30, 35)}
    assert set(times[IMU.at("user1")]) == every - {*range(40, 43)}

    gaps = (("orientation ('qx' to 'qw')", 3, 0.13, 42), ("robot ('robot_x' to 'robot_z')", 10, 0.37, 12))
    assert result.stderr.splitlines() == [
        f"note: {body}: missing in {count} of 91 rows, 1 gap of up to {gap_s:.2f} s, "
        f"the first in line {line}; left out"
        for body, count, gap_s, line in (*gaps, ("head ('head_x' to 'head_z')", 5, 0.2, 32))
    ]


@pytest.mark.parametrize("name", ["arm.tsv", "arm.txt", "ARM.CSV"])
def test_tables_with_tabs_are_imported_whatever_their_suffix(motion: Path, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(motion.read_text().replace(",", "\t"))
    assert invoke("import", str(path), "--to", str(tmp_path / "session.mcap")).endswith(": 277 entries\n")


def test_mistakes_are_told_and_nothing_is_written(motion: Path, tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    with pytest.raises(ConfigError, match="there is no such mounting; there are plus_x, minus_x"):
        invoke("import", str(motion), "--to", str(path), "--mounting", "knee")
    with pytest.raises(ConfigError, match=r"nothing\.csv: there is no such file or folder"):
        invoke("import", str(tmp_path / "nothing.csv"), "--to", str(path))
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(ConfigError, match=r"notes\.txt: no line names the columns t, qx"):
        invoke("import", str(tmp_path / "notes.txt"), "--to", str(path))
    assert not path.exists()


def test_a_public_recording_is_imported_whole(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    source = data_file("recordings/motion_relloc/triangle-s1.csv")
    invoke("import", str(source), "--to", str(path))
    with Recording.open(path) as recording:
        assert recording.counts[IMU.at("user1")] == 1132
        assert recording.counts[OBJECTS.at("mocap")] == 1132
