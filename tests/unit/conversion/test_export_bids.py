"""Datasets of BIDS, there and back."""

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from pointit.cli.main import command
from pointit.conversion.export_bids import bids_label, export_bids, subject_label
from pointit.conversion.import_csv import csv_entries
from pointit.runtime.errors import ConfigError
from pointit.schemas import Cursor, ImuSample, SelectionEvent, TrackedObject, TrackedObjects, topics
from pointit.sim.motion_table import MotionForm
from pointit.sim.recordings import read_imu_csv
from tests.unit.conversion.session import at, said, session, write

LEVEL = (0.0, 0.0, 0.0, 1.0)


def table(path: Path) -> list[list[str]]:
    return [line.split("\t") for line in path.read_text(encoding="utf-8").splitlines()]


def motion(folder: Path, person: str, system: str, session: str = "") -> dict[str, list[str]]:
    """Return the columns of a file of motion by the names of its channels."""
    place = folder / f"sub-{person}" / (f"ses-{session}" if session else "") / "motion"
    (data,) = place.glob(f"*_tracksys-{system}_motion.tsv")
    (channels,) = place.glob(f"*_tracksys-{system}_channels.tsv")
    names = [row[0] for row in table(channels)[1:]]
    rows = table(data)
    assert {len(row) for row in rows} == {len(names)}
    return dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))


def test_samples_keep_their_values_and_times(tmp_path: Path) -> None:
    export_bids(session("anna"), tmp_path)
    arm = motion(tmp_path, "anna", "imu")
    assert arm["latency"][:3] == ["0.000000", "0.020000", "0.040000"]
    assert arm["arm_ORNT_quat_w"][0] == "1.000000"
    assert float(arm["arm_ORNT_quat_z"][1]) ** 2 + float(arm["arm_ORNT_quat_w"][1]) ** 2 == pytest.approx(1)
    pose = motion(tmp_path, "anna", "pose")
    assert (pose["latency"], pose["feet_POS_y"], pose["feet_ORNT_z"]) == (
        ["0.400000"],
        ["2.000000"],
        ["0.700000"],
    )


def test_missing_values_are_those_of_the_standard(tmp_path: Path) -> None:
    export_bids(session("anna"), tmp_path)
    assert motion(tmp_path, "anna", "imu")["arm_GYRO_z"][:5] == ["n/a"] * 4 + ["1.000000"]
    points = motion(tmp_path, "anna", "cursor")["cursor_POS_y"]
    assert points[6:9] == ["0.600000", "n/a", "0.800000"]
    cup = motion(tmp_path, "anna", "mocap")["red cup_POS_z"]
    assert (cup[0], cup[1], cup[10]) == ("n/a", "0.500000", "n/a")


def test_channels_have_types_units_and_frames_of_the_standard(tmp_path: Path) -> None:
    export_bids(session("anna"), tmp_path)
    (channels,) = tmp_path.rglob("*tracksys-imu_channels.tsv")
    header, latency, first, *_ = table(channels)
    assert header[:5] == ["name", "component", "type", "tracked_point", "units"]
    assert latency[:5] == ["latency", "n/a", "LATENCY", "n/a", "s"]
    assert first == ["arm_ORNT_quat_x", "quat_x", "ORNT", "arm", "n/a", "forearm", "person"]

    levels = json.loads(channels.with_suffix(".json").read_text(encoding="utf-8"))["reference_frame"][
        "Levels"
    ]
    assert set(levels) == {"person", "arm"}

    (sidecar,) = tmp_path.rglob("*tracksys-imu_motion.json")
    content = json.loads(sidecar.read_text(encoding="utf-8"))
    assert (content["SamplingFrequency"], content["SamplingFrequencyEffective"]) == (50.0, 50.0)
    assert (content["TaskName"], content["MotionChannelCount"], content["GYROChannelCount"]) == (
        "pointing",
        8,
        3,
    )


def rates_hz(folder: Path, system: str) -> tuple[float, float]:
    (sidecar,) = folder.rglob(f"*tracksys-{system}_motion.json")
    content = json.loads(sidecar.read_text(encoding="utf-8"))
    return content["SamplingFrequency"], content["SamplingFrequencyEffective"]


def test_single_pose_has_a_rate_of_one_per_session(tmp_path: Path) -> None:
    export_bids(session("anna"), tmp_path / "short")
    assert rates_hz(tmp_path / "short", "pose") == (1.0, 1.0)  # the session lasts 0.78 s
    late = Cursor(stamp_ns=at(10_000.5), point_m=None)
    export_bids([*session("anna"), said(10_000.5, topics.CURSOR, "anna", late)], tmp_path / "long")
    assert rates_hz(tmp_path / "long", "pose") == (0.0001, 0.0001)
    assert rates_hz(tmp_path / "long", "imu") == (50.0, 50.0)


def test_each_person_has_their_own_body_and_all_objects(tmp_path: Path) -> None:
    export_bids(session("anna", "bob_2"), tmp_path)
    anna = motion(tmp_path, "anna", "mocap")
    bob = motion(tmp_path, "bobX5f2", "mocap")
    assert "red cup_POS_x" in anna
    assert "red cup_POS_x" in bob
    assert ("anna_POS_x" in anna, "bob_2_POS_x" in anna) == (True, False)
    assert ("anna_POS_x" in bob, "bob_2_POS_x" in bob) == (False, True)
    assert [row[0] for row in table(tmp_path / "participants.tsv")] == [
        "participant_id",
        "sub-anna",
        "sub-bobX5f2",
    ]


def test_selections_are_events_on_the_same_time_axis(tmp_path: Path) -> None:
    export_bids(session("anna", "bob"), tmp_path)
    (events,) = (tmp_path / "sub-anna").rglob("*_events.tsv")
    assert table(events) == [
        ["onset", "duration", "trial_type", "object", "object_kind", "cause"],
        ["0.700000", "n/a", "selected", "red cup", "cup", "dwell"],
    ]
    (scans,) = tmp_path.glob("sub-anna/*_scans.tsv")
    assert {row[1] for row in table(scans)[1:]} == {"1970-01-01T00:16:40.500000Z"}


def test_samples_that_were_recorded_late_are_in_order_of_capture(tmp_path: Path) -> None:
    entries = [
        said(time_s, topics.IMU, "anna", ImuSample(stamp_ns=at(stamp_s), orientation_xyzw=LEVEL))
        for time_s, stamp_s in ((1.0, 0.9), (1.1, 0.7), (1.2, 0.8))
    ]
    export_bids(entries, tmp_path)
    assert motion(tmp_path, "anna", "imu")["latency"] == ["0.000000", "0.100000", "0.200000"]


def test_people_whom_only_cameras_saw_are_exported(tmp_path: Path) -> None:
    head = TrackedObject(id="anna", kind="person", position_m=(1.0, 2.0, 1.7))
    objects = TrackedObjects(stamp_ns=at(1.0), objects=(head,))
    export_bids([said(1.0, topics.OBJECTS, "imu", objects)], tmp_path)
    assert motion(tmp_path, "anna", "imuobjects")["anna_POS_z"] == ["1.700000"]


def test_people_of_other_days_whose_names_differ_are_other_subjects(tmp_path: Path) -> None:
    for day, name in enumerate(("P-1", "P1", "P_1", "PX2d1", "P-1")):
        export_bids(session(name), tmp_path, session=f"{day}")
    subjects = {path.name for path in tmp_path.glob("sub-*")}
    assert subjects == {"sub-PX2d1", "sub-P1", "sub-PX5f1", "sub-PX582d1"}
    assert {row[0] for row in table(tmp_path / "participants.tsv")[1:]} == subjects


@given(st.sets(st.text(max_size=6), min_size=2))
def test_names_have_labels_of_letters_and_digits_of_their_own(names: set[str]) -> None:
    labels = {subject_label(name) for name in names}
    assert len(labels) == len(names)
    assert all(re.fullmatch("[0-9A-Za-z]*", label) for label in labels)


def test_labels_of_tasks_and_sessions_have_letters_and_digits() -> None:
    assert bids_label("Jörg-2") == "Jorg2"
    with pytest.raises(ConfigError, match="has no letter or digit"):
        bids_label("_-.")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("participant_id\tcity\nsub-zoë\tKöln\n".encode("latin-1"), "is not UTF-8 text; save it as tab-sep"),
        ("participant_id\tage\nsub-zoe\t31\n".encode("utf-16"), "is not UTF-8 text; save it as tab-sep"),
        (
            b"participant_id,age\nsub-zoe,31\n",
            "begins with 'participant_id,age'; save it as tab-separated text",
        ),
        (b"", "begins with ''; save it as tab-separated text"),
    ],
)
@pytest.mark.parametrize("name", ["participants.tsv", "sub-anna/sub-anna_scans.tsv"])
def test_table_saved_otherwise_by_another_program_is_refused_and_kept(
    tmp_path: Path, name: str, content: bytes, problem: str
) -> None:
    export_bids(session("anna"), tmp_path)
    (tmp_path / name).write_bytes(content)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(ConfigError, match=problem):
        export_bids(session("anna"), tmp_path, overwrite=True)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_ids_of_objects_are_no_formulas(tmp_path: Path) -> None:
    name = '=HYPERLINK("http://a.example")'
    thing = TrackedObject(id=name, kind="@cup", position_m=(1.0, 2.0, 0.5))
    event = SelectionEvent(stamp_ns=at(1.0), event="selected", object_id=name, user="anna", kind="@cup")
    objects = TrackedObjects(stamp_ns=at(1.0), objects=(thing,))
    entries = [said(1.0, topics.OBJECTS, "mocap", objects), said(1.0, topics.SELECTION_EVENTS, "", event)]
    export_bids([*session("anna"), *entries], tmp_path)
    cells = [cell for path in tmp_path.rglob("*.tsv") for row in table(path) for cell in row]
    assert f"'{name}" in cells
    assert f"'{name}_POS_x" in cells
    assert not [cell for cell in cells if cell.startswith(("=", "+", "@"))]


def test_more_recordings_join_a_dataset_and_keep_peoples_edits(tmp_path: Path) -> None:
    export_bids(session("anna"), tmp_path)
    participants = tmp_path / "participants.tsv"
    participants.write_text("participant_id\tage\nsub-anna\t31\n", encoding="utf-8")
    (tmp_path / "README").with_suffix(".md").write_text("ours\n", encoding="utf-8")
    export_bids(session("bob"), tmp_path)
    export_bids(session("anna"), tmp_path, session="second day")
    export_bids(session("anna"), tmp_path, task="waving")
    assert table(participants) == [["participant_id", "age"], ["sub-anna", "31"], ["sub-bob", "n/a"]]
    assert (tmp_path / "README").with_suffix(".md").read_text(encoding="utf-8") == "ours\n"
    assert len(motion(tmp_path, "anna", "imu", "secondday")["latency"]) == 40
    (scans,) = tmp_path.glob("sub-anna/*_scans.tsv")
    files = [row[0] for row in table(scans)[1:]]
    assert len(files) == len(set(files)) == 8
    assert all((scans.parent / name).is_file() for name in files)


def test_a_file_that_is_there_is_replaced_with_overwrite_only(tmp_path: Path) -> None:
    export_bids(session("anna"), tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    arm_only = [each for each in session("anna") if each.row is topics.IMU]
    with pytest.raises(ConfigError, match="give --session a label, another folder, or --overwrite"):
        export_bids(arm_only, tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    export_bids(arm_only, tmp_path, overwrite=True)
    assert {path.name for path in tmp_path.rglob("*_motion.tsv")} == {
        "sub-anna_task-pointing_tracksys-imu_motion.tsv"
    }


def test_recordings_of_other_modalities_and_their_scans_stay(tmp_path: Path) -> None:
    export_bids(session("anna"), tmp_path)
    others = [
        tmp_path / "sub-anna" / "eeg" / "sub-anna_task-pointing_eeg.edf",
        tmp_path / "derivatives" / "clean" / "sub-anna" / "sub-anna_task-pointing_eeg.edf",
    ]
    for other in others:
        other.parent.mkdir(parents=True)
        other.write_text("EEG", encoding="utf-8")
    (scans,) = tmp_path.glob("sub-anna/*_scans.tsv")
    eeg = ["eeg/sub-anna_task-pointing_eeg.edf", "2026-01-01T10:00:00", "Bea"]
    scans.write_text("filename\tacq_time\toperator\n" + "\t".join(eeg) + "\n", encoding="utf-8")

    export_bids(session("anna"), tmp_path, overwrite=True)
    assert all(other.read_text(encoding="utf-8") == "EEG" for other in others)
    header, first, *new = table(scans)
    assert (header, first) == (["filename", "acq_time", "operator"], eeg)
    assert [row[2] for row in new] == ["n/a"] * 4


def test_folder_with_other_files_or_recording_without_people_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="has no motion of a person"):
        export_bids([], tmp_path / "new")
    (tmp_path / "imu.csv").write_text("x\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="has files and is no BIDS dataset; give an empty folder"):
        export_bids(session("anna"), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["imu.csv"]


def test_the_command_names_the_files_and_what_has_none(tmp_path: Path) -> None:
    recording = write(tmp_path / "session.mcap", session("anna"))
    options = ["--to", f"{tmp_path / 'bids'}", "--format", "motion-bids", "--task", "put that there"]
    done = CliRunner().invoke(command, ["export", f"{recording}", *options])
    assert done.exit_code == 0, done.output
    assert "sub-anna_task-putthatthere_tracksys-imu_motion.tsv: 40 rows" in done.output
    assert "Messages without a table: 1 of users/{user}/hover." in done.output


@pytest.mark.parametrize("option", [("--task", "reach"), ("--session", "2")])
def test_options_of_the_dataset_are_refused_for_tables(option: tuple[str, str], tmp_path: Path) -> None:
    done = CliRunner().invoke(command, ["export", "any.mcap", "--to", f"{tmp_path}", *option])
    assert done.exit_code == 2
    assert "are of --format motion-bids" in done.output


def test_an_export_can_be_imported_again(tmp_path: Path) -> None:
    export_bids(session("anna", "bo"), tmp_path / "bids", task="reach")
    for person in ("anna", "bo"):
        (path,) = tmp_path.glob(f"bids/sub-{person}/motion/*_tracksys-imu_motion.tsv")
        sent = [each.body for each in session("anna", "bo") if each.name == person]
        samples = [each for each in sent if isinstance(each, ImuSample)]
        imported = [each.body for each in csv_entries(path, user=person)]
        entries = [each for each in imported if isinstance(each, ImuSample)]
        assert len(entries) == len(samples) > 0
        for again, sample in zip(entries, samples, strict=True):
            assert again.orientation_xyzw == pytest.approx(sample.orientation_xyzw, abs=1e-5)
            passed_ns = sample.stamp_ns - samples[0].stamp_ns
            assert again.stamp_ns - entries[0].stamp_ns == pytest.approx(passed_ns, abs=1000)


CHANNELS = "name\tcomponent\ttype\ttracked_point\tunits\n"
WRIST = "".join(f"w_{axis}\tquat_{axis}\tORNT\twrist\tn/a\n" for axis in "xyzw")
DRONE = "".join(f"d_{axis}\t{axis}\tPOS\tdrone\tmm\n" for axis in "xyz")
STEPS = range(8)


def write_motion(folder: Path, channels: str, rows: list[list[str]], sidecar: str = "{}") -> Path:
    path = folder / "sub-1_task-reach_tracksys-cap_motion.tsv"
    path.write_text("".join("\t".join(row) + "\n" for row in rows))
    path.with_name("sub-1_task-reach_tracksys-cap_channels.tsv").write_text(CHANNELS + channels)
    path.with_suffix(".json").write_text(sidecar)
    return path


def test_foreign_motion_is_read_by_its_channels_and_units(tmp_path: Path) -> None:
    rows = [["0", "0", "0.6", "0.8", f"{1500 + n}", "n/a" if n == 3 else "0.5", "800"] for n in STEPS]
    path = write_motion(tmp_path, WRIST + DRONE, rows, '{"SamplingFrequency": 50}')
    form = MotionForm(columns="robot_x=d_x,robot_y=d_y,robot_z=d_z")
    recording = read_imu_csv(path, form)
    assert recording.t_s.tolist() == pytest.approx([n / 50 for n in STEPS])
    assert recording.orientation_xyzw[1].tolist() == pytest.approx([0.0, 0.0, 0.6, 0.8])
    assert recording.robot_m is not None
    assert recording.robot_m[1].tolist() == pytest.approx([1.501, 0.0005, 0.8])
    assert [n for n in STEPS if recording.robot_m[n, 0] != recording.robot_m[n, 0]] == [3]
    assert "1 of 8 rows, 1 gap of up to 0.04 s, the first in line 4;" in recording.notes[0]


@pytest.mark.parametrize(
    ("channels", "sidecar", "message"),
    [
        (
            WRIST,
            "{}",
            r"_motion.json: has no SamplingFrequency above 0, and .*_channels.tsv no LATENCY; add one",
        ),
        (WRIST, '{"SamplingFrequency": 0}', "has no SamplingFrequency above 0"),
        (DRONE, '{"SamplingFrequency": 50}', r"no line names the columns .*1 'd_x', .*; set columns to"),
        (
            WRIST + WRIST.replace("w_", "v_"),
            '{"SamplingFrequency": 50}',
            r"no line names the columns .*1 'w_x', .*5 'v_x', .*; set columns to",
        ),
        (
            WRIST + "time\tn/a\tLATENCY\tn/a\tfortnight\n",
            "{}",
            "the unit 'fortnight'; set columns to its size",
        ),
    ],
)
def test_channels_that_do_not_describe_a_wrist_are_refused(
    tmp_path: Path, channels: str, sidecar: str, message: str
) -> None:
    count = channels.count("\n")
    path = write_motion(tmp_path, channels, [["0"] * count for _ in STEPS], sidecar)
    with pytest.raises(ConfigError, match=message):
        read_imu_csv(path)


def test_motion_without_channels_is_refused(tmp_path: Path) -> None:
    path = write_motion(tmp_path, WRIST, [["0", "0", "0", "1"]])
    path.with_name("sub-1_task-reach_tracksys-cap_channels.tsv").unlink()
    with pytest.raises(ConfigError, match=r"_channels\.tsv: cannot be read"):
        read_imu_csv(path)
