"""Files of Motion-BIDS, our own and others, read by their channels."""

from pathlib import Path

import pytest

from pointit.conversion.export_bids import export_bids
from pointit.conversion.import_csv import csv_entries
from pointit.runtime.errors import ConfigError
from pointit.schemas import ImuSample
from pointit.sim.motion_table import MotionForm
from pointit.sim.recordings import read_imu_csv
from tests.unit.conversion.bids_session import session


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


def test_motion_of_others_is_read_by_its_channels_and_their_units(tmp_path: Path) -> None:
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
