"""Reading recordings: what is read, and the sentence for every fault."""

from pathlib import Path

import numpy as np
import pytest

from pointit.runtime.errors import ConfigError
from pointit.sim.motion_table import MAX_BYTES
from pointit.sim.recordings import read_imu_csv
from tests.support.data import data_file

HEADER = "t,qw,qx,qy,qz"
ROBOT = ",robot_x,robot_y,robot_z"


def write(folder: Path, text: str) -> Path:
    path = folder / "person.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_in_any_order_with_time_from_zero(tmp_path: Path) -> None:
    text = "note,qx,qy,qz,qw,t,robot_z,robot_y,robot_x\nhi,0,0,0,1,7.5,3,2,1\nho,0,0,0.6,0.8,7.75,6,5,4\n\n"
    recording = read_imu_csv(write(tmp_path, text))
    assert recording.t_s.tolist() == [0.0, 0.25]
    assert recording.duration_s == 0.25
    assert np.allclose(recording.orientation_xyzw, [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.6, 0.8]])
    assert recording.robot_m is not None
    assert recording.robot_m.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert recording.head_m is None


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ["no line names the columns t, qx, qy, qz, qw", "set columns"]),
        (HEADER + ",qx\n0,1,0,0,0,0\n", ["line 1", "6 'qx'", "once each", "such as t=1,qx=2"]),
        (HEADER + "\n", ["line 1", "no samples"]),
        (HEADER + "\n0,1,0,0,0\n1,1,much,0,0\n", ["line 3", "'qx'", "'much'", "set lost to 'much'"]),
        (HEADER + "\n0,1,0,0,0\n1,1,5_0,0,0\n", ["line 3", "'qx'", "'5_0'"]),
        (HEADER + "\n0,1,0,0,0\n1e13,1,0,0,0\n", ["line 3", "'t'", "not within 1e+12"]),
        (HEADER + "\n0,1,0,0,0\n2e9,1,0,0,0\n", ["line 3", "'t'", "2e+09 s long", "t=ms"]),
        (HEADER + ROBOT + "\n0,1,0,0,0,1,1e7,3\n", ["line 2", "'robot_y'", "10000000", "1e+06"]),
        (HEADER + "\n0,,0,0,0\n1,nan,nan,nan,nan\n", ["line 2", "'qw' to 'qz'", "missing in all rows"]),
        (HEADER + "\n,1,0,0,0\n", ["line 2", "set columns"]),
        (HEADER + "\n0,1,0,0,0\nnan,1,0,0,0\n", ["line 3", "'t'", "nan is not within"]),
        (
            HEADER + "\n0,1,0,0,0\n.1,1,0,0,0\n.1,1,0,0,0\n",
            ["line 4", "'t'", "does not increase", "0.1 after 0.1"],
        ),
        (HEADER + "\n0,02,1,0,0,0\n", ["line 2", "6 cells", "there are 5 columns"]),
        ("t;qw;qx;qy;qz\n0;1.000,0;0;0;0\n", ["line 2", "'qw'", "'1.000,0'"]),
        ("t [ms],qw,qx,qy,qz\n0,1,0,0,0\n", ["line 1", "1 't [ms]'", "set columns"]),
        ("t,yaw_deg,pitch,roll\n0,1,0,0\n", ["2 'yaw_deg'", "angles are not read"]),
        (HEADER + "\n0,1,1,0,0\n", ["line 2", "'qw' to 'qz'", "norm 1.41421", "set columns"]),
    ],
)
def test_faults_name_file_line_column_and_value(tmp_path: Path, text: str, parts: list[str]) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        read_imu_csv(path)
    sentence = str(caught.value)
    for part in [str(path), *parts]:
        assert part in sentence, sentence
    assert "\n" not in sentence


def test_files_that_are_no_text_or_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        read_imu_csv(tmp_path / "none.csv")
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ConfigError, match="is not UTF-8 text; save it as CSV in UTF-8"):
        read_imu_csv(binary)


def test_file_beyond_the_size_limit_is_not_read(tmp_path: Path) -> None:
    huge = tmp_path / "huge.csv"
    with huge.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(ConfigError, match=r"huge\.csv: has 64.1 MB and at most 64 MB are read; cut it"):
        read_imu_csv(huge)


def test_published_recording_is_read() -> None:
    recording = read_imu_csv(data_file("recordings/motion_relloc/triangle-s3.csv"))
    assert len(recording.t_s) == 1185
    assert recording.duration_s == pytest.approx(39.4658, abs=1e-3)
    assert recording.robot_m is not None
    assert recording.head_m is not None
    assert recording.head_m[:, 2].mean() == pytest.approx(1.82, abs=0.01)
