"""Localizations in recorded sessions, scored against a tracker, and errors over people."""

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pointit.schemas as models
from pointit.cli.main import command
from pointit.conversion.import_csv import csv_entries
from pointit.conversion.recording_file import write_recording
from pointit.geometry.vector import Vec3
from pointit.recording.entries import Entry
from pointit.recording.reader import Recording
from pointit.replay.playing import plan_replay, replay
from pointit.runtime.errors import ConfigError
from pointit.schemas import Localization, UserPose
from pointit.schemas.topics import ANCHOR, LOCALIZATION, MAP, OBJECTS, POSE, RAY
from pointit_lab.evaluation.localization.over_people import over_people
from pointit_lab.evaluation.localization.recorded import LIVE, read_sessions
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row
from tests.support import there
from tests.support.data import data_file
from tests.support.invoked import printed
from tests.support.published_recordings import Stand, unit, write_motion
from tests.unit.conversion.session import at, said, write

LAMPS: dict[str, Vec3] = {"one": (3.0, -1.0, 1.0), "two": (3.0, 2.0, 1.0), "three": (0.0, 3.0, 0.5)}
HOLD_S = 6.0


def invoke(*arguments: str) -> tuple[str, str]:
    return printed(command, "evaluate", "localization", "--only-ours", "--jobs", "1", *arguments)


def rows_of(*arguments: str) -> list[dict[str, Any]]:
    out, _ = invoke(*arguments, "--json", "-")
    rows: list[dict[str, Any]] = json.loads(out)["rows"]
    return rows


def room() -> Entry:
    lamps = tuple(models.Lamp(id=name, position_m=place) for name, place in LAMPS.items())
    return said(0.0, MAP, "", models.Environment(stamp_ns=at(0.0), name="room", lamps=lamps))


def pointing_at_lamps(user: str, stand: Stand, begin_s: float = 1.0) -> Iterator[Entry]:
    """Yield a localization: the rays at one lamp after the other, at 50 Hz."""
    for index, (lamp, place) in enumerate(LAMPS.items()):
        lit_s = begin_s + index * HOLD_S
        message = models.Localization(
            stamp_ns=at(lit_s), phase="sampling", target_id=lamp, target_index=index, since_ns=at(begin_s)
        )
        yield said(lit_s, LOCALIZATION, user, message)
        x, y, z = unit(stand.rays(np.array([place])))[0].tolist()
        for tick in range(1, round(HOLD_S * 50)):
            time_s = lit_s + tick / 50
            ray = models.PointingRay(
                stamp_ns=at(time_s), origin_m=(0.0, 0.0, stand.eyes_m), direction=(x, y, z)
            )
            yield said(time_s, RAY, user, ray)
    end_s = begin_s + len(LAMPS) * HOLD_S
    yield said(
        end_s,
        LOCALIZATION,
        user,
        models.Localization(stamp_ns=at(end_s), phase="solved", since_ns=at(begin_s)),
    )


def seen(user: str, stand: Stand, until_s: float = 30.0) -> Iterator[Entry]:
    """Yield the reports of a tracker that sees the person's head."""
    for tick in range(round(until_s * 5)):
        head = models.TrackedObject(id=user, kind="person", position_m=(stand.x, stand.y, 1.8))
        yield said(tick / 5, OBJECTS, "mocap", models.TrackedObjects(stamp_ns=at(tick / 5), objects=(head,)))


def found(user: str, time_s: float, x: float, y: float) -> Entry:
    """Return a pose as the localizer publishes it."""
    pose = models.UserPose(
        stamp_ns=at(time_s), position_m=(x, y, 0.0), yaw_rad=0.0, method="static_targets",
        covariance=(0.04, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.01), anchored_ns=at(time_s),
    )  # fmt: skip
    return said(time_s, POSE, user, pose)


def session(path: Path, *parts: Iterable[Entry]) -> str:
    entries = sorted((entry for part in parts for entry in part), key=lambda entry: entry.time_ns)
    return str(write(path, [room(), *entries]))


def test_localizations_by_lamps_are_recomputed_and_compared_with_the_tracker(tmp_path: Path) -> None:
    anna = Stand(x=0.3, y=0.2)
    ben = Stand(x=-1.0, y=0.5, yaw_deg=-70.0)
    path = session(
        *(tmp_path / "s.mcap", pointing_at_lamps("anna", anna), pointing_at_lamps("ben", ben)),
        *(seen("anna", anna), seen("ben", ben)),
    )
    rows = rows_of("--recording", path)
    assert [(row["condition"], row["subject"], row["n"], row["refused"]) for row in rows] == [
        ("3 lamps", "all", 2, 0),
        ("3 lamps", "anna", 1, 0),
        ("3 lamps", "ben", 1, 0),
    ]
    assert all(row["position_m"]["median"] < 0.02 for row in rows)
    assert all(row["yaw_deg"]["median"] < 0.5 for row in rows)


def test_poses_of_the_session_are_scored_as_they_were_found(tmp_path: Path) -> None:
    stand = Stand(x=1.0, y=0.0)
    poses = [found("anna", 19.5, 1.3, 0.4), found("anna", 19.5, 9.0, 9.0), found("anna", 60.0, 9.0, 9.0)]
    path = session(tmp_path / "s.mcap", seen("anna", stand), poses)
    (everybody, anna) = rows_of("--recording", path)
    assert (anna["subject"], anna["condition"], anna["solver"]) == ("anna", "static targets", "live")
    assert anna["n"] == 1  # of the repeated pose the first; the last was found when no tracker saw her
    assert anna["position_m"]["median"] == pytest.approx(0.5)
    assert anna["within_2_sigma"] == 0.0
    assert everybody["n"] == 1


def test_pointing_at_lamps_afterwards_is_scored_without_a_tracker(tmp_path: Path) -> None:
    anchors = [
        models.Anchor(
            stamp_ns=at(time_s), target_id="one", origin_m=(0.0, 0.0, 1.6), raw_direction=(1.0, 0.0, 0.0),
            direction=(1.0, 0.0, 0.0), azimuth_error_rad=math.radians(3.0),
            elevation_error_rad=math.radians(-4.0),
        )
        for time_s in (1.0, 2.0)
    ]  # fmt: skip

    path = session(
        tmp_path / "s.mcap", [said(each.stamp_ns / 1e9 - 1000, ANCHOR, "anna", each) for each in anchors]
    )
    rows = rows_of("--recording", path)
    assert [(row["subject"], row["condition"], row["n"]) for row in rows] == [
        ("all", "anchors", 2),
        ("anna", "anchors", 2),
    ]
    assert rows[0]["angle_deg"]["median"] == pytest.approx(5.0)
    assert rows[0]["pitch_deg"]["median"] == pytest.approx(4.0)


def test_robot_follower_is_scored_by_windows_of_arm_motion_alone(tmp_path: Path) -> None:
    stand = Stand(x=-1.5, y=-1.0, yaw_deg=35.0)
    motion = write_motion(tmp_path, stand, duration_s=12.0)
    path = str(write(tmp_path / "s.mcap", csv_entries(motion, user="anna", mounting="minus_x")))
    rows = {row["condition"]: row for row in rows_of("--recording", path) if row["subject"] == "anna"}
    assert set(rows) == {"1 s", "2 s", "3 s", "5 s", "8 s", "10 s"}
    assert rows["8 s"]["position_m"]["median"] < 0.05
    assert rows["8 s"]["yaw_deg"]["median"] < 1.0


def test_yaw_is_true_from_a_tracker_that_knows_it(tmp_path: Path) -> None:
    stand = Stand(x=0.3, y=0.2, yaw_deg=35.0)
    true = models.UserPose(
        stamp_ns=at(0.0), position_m=(0.3, 0.2, 0.0), yaw_rad=math.radians(40.0), method="external"
    )
    poses = (
        said(tick / 5, POSE, "anna", true.model_copy(update={"stamp_ns": at(tick / 5)}))
        for tick in range(150)
    )
    path = session(tmp_path / "s.mcap", pointing_at_lamps("anna", stand), poses)
    (_, anna) = rows_of("--recording", path)
    assert anna["position_m"]["median"] < 0.02
    assert anna["yaw_deg"]["median"] == pytest.approx(5.0, abs=0.5)


@pytest.mark.parametrize(("kind", "error_deg"), [("person_frame", 15.0), ("person", 0.0)])
def test_yaw_of_a_person_frame_is_true_unlike_the_facing(tmp_path: Path, kind: str, error_deg: float) -> None:
    stand = Stand(x=0.3, y=0.2)
    yaw_rad = math.radians(20.0)
    heads = [
        models.TrackedObject(id="anna", kind=kind, position_m=(stand.x, stand.y, 1.8), yaw_rad=yaw_rad)
    ] * 150
    reports = [
        said(tick / 5, OBJECTS, "mocap", models.TrackedObjects(stamp_ns=at(tick / 5), objects=(head,)))
        for tick, head in enumerate(heads)
    ]
    path = session(tmp_path / "s.mcap", pointing_at_lamps("anna", stand), reports)
    row = next(each for each in rows_of("--recording", path) if each["subject"] == "anna")
    assert row["yaw_deg"]["median"] == pytest.approx(error_deg, abs=0.5)


def test_missing_truth_unknown_subject_and_conflicting_options_are_reported(tmp_path: Path) -> None:
    nobody = session(tmp_path / "nobody.mcap", pointing_at_lamps("anna", Stand()))
    with pytest.raises(
        ConfigError, match=r"nobody\.mcap: it has no true position of any person; let a tracker"
    ):
        invoke("--recording", nobody)
    stand = Stand(x=0.3, y=0.2)
    whole = session(tmp_path / "whole.mcap", pointing_at_lamps("anna", stand), seen("anna", stand))
    _, err = invoke("--recording", whole, "--recording", nobody)
    assert "note: " in err
    with pytest.raises(ConfigError, match="--subject carla: no person of that name"):
        invoke("--recording", whole, "--subject", "carla")
    with pytest.raises(ConfigError, match="leave it out with --recording"):
        invoke("--recording", whole, "--set", "motion_relloc")


def row(subject: str, solver: str, median_m: float) -> Row:
    spread = MetricSpread(median=median_m, p90=median_m, rms=median_m)
    return Row(set="recordings", subject=subject, condition="3 lamps", solver=solver, n=5, position_m=spread)


def test_each_person_counts_once_and_methods_are_compared_within_people() -> None:
    errors = {"anna": 0.1, "ben": 0.2, "carla": 0.4}
    rows = [row(ALL, "pointit", 9.0), *(row(name, "pointit", each) for name, each in errors.items())]
    rows += [row(name, "other", 2.0 * each) for name, each in errors.items()]
    ours, other = over_people(rows, "pointit")
    assert (ours.people, ours.ratio, ours.without_one) == (3, None, None)
    assert ours.error.value == pytest.approx(0.2)
    assert ours.error_without_one == pytest.approx((0.02**0.5, 0.08**0.5))
    # logarithms are apart by ln 2: s = ln 2, t(0.975, 2) = 4.303
    reach = math.exp(4.303 * math.log(2.0) / math.sqrt(3.0))
    assert ours.error.low == pytest.approx(0.2 / reach, rel=1e-3)
    assert ours.error.high == pytest.approx(0.2 * reach, rel=1e-3)
    assert (there(other.ratio).low, there(other.ratio).high) == pytest.approx((2.0, 2.0))
    assert other.without_one == pytest.approx((2.0, 2.0))


def test_leaving_one_out_shows_a_person_who_carries_a_comparison() -> None:
    errors = {"anna": 0.1, "ben": 0.1, "carla": 0.1, "dora": 0.1}
    rows = [row(name, "pointit", each) for name, each in errors.items()]
    rows += [row(name, "other", 1.6 if name == "dora" else each) for name, each in errors.items()]
    _, other = over_people(rows, "pointit")
    assert there(other.ratio).value == pytest.approx(2.0)
    assert other.without_one == pytest.approx((1.0, 16.0 ** (1 / 3)))


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
    source = data_file("recordings/motion_relloc/index.json")
    index = {each["file"]: each for each in json.loads(source.read_bytes())}
    minus_yaw_deg = index["triangle-s1.csv"]["ref_yaw_deg_human_minus_world"]
    for pose in replayed(tmp_path, "triangle-s1", mounting="metamotion").bodies(POSE):
        off_deg = math.degrees(pose.yaw_rad) + minus_yaw_deg
        assert abs(math.remainder(off_deg, 360.0)) > 45.0


def test_person_who_does_not_point_gets_no_pose(tmp_path: Path) -> None:
    source = data_file("recordings/motion_relloc/idle_4.csv")
    path = tmp_path / "imported.mcap"
    write_recording(csv_entries(source, user="anna", mounting="minus_x"), path, "imported")
    result = Result()
    with Recording.open(path) as recording:
        replay(plan_replay(recording, "edge"), result)
    assert result.bodies(POSE) == []
    told = [each for each in result.bodies(LOCALIZATION) if isinstance(each, Localization)]
    assert any("the rays miss the targets" in each.reason for each in told)
