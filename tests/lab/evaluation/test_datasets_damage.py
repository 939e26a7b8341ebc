"""Recordings that cannot be: other units, arrays that lie, rows out of order; never a figure from them."""

import io
import math
import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets import read_trials
from pointit_lab.evaluation.datasets.proximity_feedback import read_floor_trials
from pointit_lab.evaluation.datasets.vr_eyefinger import read_wall_trials
from tests.support.published_recordings import Stand, write_acts, write_motion, write_simulated, write_track

STAND = Stand()


def scaled(path: Path, factor: float, *columns: str) -> None:
    """Multiply the `columns` of a CSV file."""
    header, *lines = path.read_text(encoding="utf-8").splitlines()
    at = [i for i, name in enumerate(header.split(",")) if name.startswith(columns)]
    assert at
    rows = [line.split(",") for line in lines]
    for row in rows:
        for i in at:
            row[i] = repr(float(row[i]) * factor) if row[i] else ""
    path.write_text("\n".join([header, *(",".join(row) for row in rows)]), encoding="utf-8")


def refused(read: Callable[[], object], path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        read()
    said = str(caught.value)
    assert said.startswith(str(path))
    assert said.isprintable()
    assert len(said) < 600
    return said


@pytest.mark.parametrize(
    ("write", "remedy"), [(write_motion, "set columns to its unit"), (write_track, "in seconds")]
)
@pytest.mark.parametrize("factor", [1e6, 1e3, 1.0 / 3600.0], ids=["us", "ms", "h"])
def test_times_in_other_units_are_refused(
    tmp_path: Path, write: Callable[..., Path], remedy: str, factor: float
) -> None:
    path = write(tmp_path, STAND, duration_s=40.0)
    scaled(path, factor, "t")
    said = refused(lambda: read_trials(tmp_path), path)
    assert "column 't'" in said
    assert remedy in said


def test_time_goes_forwards(tmp_path: Path) -> None:
    path = write_track(tmp_path, STAND)
    scaled(path, -1.0, "t")
    assert "time goes backwards" in refused(lambda: read_trials(tmp_path), path)


@pytest.mark.parametrize(
    ("write", "columns", "said"),
    [
        (write_motion, ["robot_x"], "mm (0.677 m away)"),
        (write_motion, ["robot", "head"], "mm (1.23 m away)"),
        (write_track, ["head_x"], "line 2: robot"),
        (write_track, ["px", "py"], "columns 'px', 'py': half of the points on the floor"),
    ],
)
def test_mm_are_refused(tmp_path: Path, write: Callable[..., Path], columns: list[str], said: str) -> None:
    path = write(tmp_path, STAND)
    scaled(path, 1000.0, *columns)
    assert said in refused(lambda: read_trials(tmp_path), path)


def test_the_height_of_the_eyes_below_a_marker_is_somebodys(tmp_path: Path) -> None:
    path = write_track(tmp_path, STAND)
    (path.parent / "index.json").write_text('[{"file": "track_9.csv", "subject": "a"}]')
    scaled(path, 10.0, "head_z")
    assert "column 'head_z': the eyes" in refused(lambda: read_trials(tmp_path), path)


@pytest.mark.parametrize(
    ("columns", "factor", "said"),
    [
        (["stature"], 100.0, "line 2, column 'stature': metres were expected, got 170"),
        (["forearm", "hand"], 1000.0, "line 2, columns 'hand_…', 'forearm_…': they are 250 m apart"),
        (["target"], 1000.0, "line 2: target"),
        (["forearm", "hand"], 0.0, "they are 0 m apart"),
    ],
)
def test_acts_in_odd_units_are_refused(tmp_path: Path, columns: list[str], factor: float, said: str) -> None:
    path = write_acts(tmp_path, {"1": (1.7, STAND)})
    scaled(path, factor, *columns)
    assert said in refused(lambda: read_trials(tmp_path), path)


def test_too_many_people_are_refused(tmp_path: Path) -> None:
    path = write_acts(tmp_path, {"1": (1.7, STAND)})
    header, row, *_ = path.read_text().splitlines()
    path.write_text("\n".join([header, *(f"p{i}{row[1:]}" for i in range(2_000))]))
    assert "has 2000 subjects" in refused(lambda: read_trials(tmp_path), path)


# arrays


def member(values: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, values)
    return buffer.getvalue()


def header(text: str) -> bytes:
    raw = text.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(raw)) + raw


def with_member(path: Path, name: str, content: bytes) -> None:
    with zipfile.ZipFile(path) as file:
        kept = {info: file.read(info) for info in file.namelist() if info != f"{name}.npy"}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for other, raw in {**kept, f"{name}.npy": content}.items():
            file.writestr(other, raw)


def test_packed_arrays_are_read(tmp_path: Path) -> None:
    path = write_simulated(tmp_path, [STAND], t_s=np.arange(100, dtype=np.float32) / 50.0)
    with_member(path, "led_xyz", member(np.asfortranarray([[1.7, -2.6, 0.85], [0.8, -0.2, 0.1]])))
    trial = read_trials(tmp_path).trials[0]
    np.testing.assert_array_equal(trial.pointings.targets_m[[0, -1]], [[1.7, -2.6, 0.85], [0.8, -0.2, 0.1]])


def test_a_damaged_stream_is_refused(tmp_path: Path) -> None:
    path = write_simulated(tmp_path, [STAND])
    with_member(path, "ray_az_rad", member(np.random.default_rng(0).normal(size=(1, 100))))
    with zipfile.ZipFile(path) as file:
        at = file.getinfo("ray_az_rad.npy").header_offset + 30 + len("ray_az_rad.npy")
    raw = bytearray(path.read_bytes())
    raw[at : at + 4] = b"\xff\xff\xff\xff"  # no block of deflate begins so
    with pytest.raises(zlib.error):
        zlib.decompress(bytes(raw[at : at + 200]), -15)
    path.write_bytes(raw)
    assert "array 'ray_az_rad': is damaged" in refused(lambda: read_trials(tmp_path), path)


def test_any_damaged_byte_is_one_sentence_or_none(tmp_path: Path) -> None:
    step = 29
    path = write_simulated(tmp_path, [STAND])
    whole = path.read_bytes()
    sentences: list[str] = []
    for at in range(0, len(whole), step):
        raw = bytearray(whole)
        raw[at] ^= 0xFF
        path.write_bytes(raw)
        try:
            read_trials(tmp_path)
        except ConfigError as error:
            sentences.append(str(error))
    for length in range(0, len(whole), 397):
        path.write_bytes(whole[:length])
        refused(lambda: read_trials(tmp_path), path)
    assert len(sentences) > len(whole) / step / 2
    assert all(sentence.startswith(str(path)) for sentence in sentences)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 1000000000000), }", "at most 1e+07 values"),
        (
            "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 100), }",
            "800 bytes were expected, and there are less",
        ),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 100), }", "has the shape (-1, 100)"),
        ("{'descr': '|O', 'fortran_order': False, 'shape': (1, 100), }", "got 'object'"),
        ("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (1,), }", "real numbers were expected"),
        ("(" * 3000, "is damaged"),
    ],
)
def test_headers_are_looked_at_before_arrays(tmp_path: Path, text: str, said: str) -> None:
    path = write_simulated(tmp_path, [STAND])
    with_member(path, "ray_az_rad", header(text))
    sentence = refused(lambda: read_trials(tmp_path), path)
    assert "array 'ray_az_rad'" in sentence
    assert said in sentence


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("ray_az_rad", np.zeros((1, 100), np.complex128), "real numbers were expected, got 'complex128'"),
        ("t_s", np.arange(100).astype("m8[s]"), "real numbers"),
        ("scenario_names", np.array([b"a", b"b"]), "texts"),
        ("scenario_names", np.array(["x" * 300, "b"]), "texts of at most 255"),
        ("scenario_names", np.array(["a", "a"]), "contains a name twice"),
        ("scenario_names", np.array(["\x1b[2J", "b"]), "printable"),
        ("scenario_names", np.array("ab"), "a row of names was expected"),
        ("ray_el_rad", np.full((1, 100), np.nan), "finite numbers were expected, got nan at [0, 0]"),
        ("led_xyz", np.array([[1.0, 2.0, np.inf], [0.0, 0.0, 1.0]]), "got inf at [0, 2]"),
        ("truth_yaw_rad", np.array([np.finfo(np.longdouble).max]), "-12.57 to 12.57 radians"),
        ("ray_el_rad", np.full((1, 100), -20.0), "-1.571 to 1.571 radians were expected, got -20"),
        ("eye_height_m", np.array(1690.0), "0.3 to 3 metres"),
        ("led_of_sample", np.full(100, 0.5), "that count the lamps were expected, got 0.5"),
        ("led_of_sample", np.full(100, 2), "that count the lamps were expected, got 2"),
        ("scenario", np.array([-1]), "that count 'scenario_names'"),
        ("scenario_names", np.array([{"a": 1}], dtype=object), "texts of at most 255"),
        ("led_xyz", np.array([[1700.0, -2600.0, 850.0], [800.0, -200.0, 100.0]]), "are they in metres"),
        ("led_xyz", np.zeros((2, 2)), "the shape (2, 3)"),
        ("led_xyz", np.zeros((0, 3)), "array 'led_of_sample'"),
        ("t_s", np.arange(100) * 20.0, "array 't_s': the samples are 20 s apart"),
        ("t_s", np.arange(100)[::-1] / 50.0, "time goes backwards"),
        ("ray_az_rad", np.zeros((0, 100)), "1 to 100000 trials of at least 2 samples"),
    ],
)
def test_arrays_that_cannot_be_are_refused(tmp_path: Path, name: str, value: NDArray[Any], said: str) -> None:
    path = write_simulated(tmp_path, [STAND], **{name: value})
    assert said in refused(lambda: read_trials(tmp_path), path)


# places on the floor and on a wall

PHASES = ("open_loop_reach", "open_loop_hold", "feedback_reach", "feedback_hold")
FLOOR = "trial,target_id,target_x,target_y,phase,t,x,y,trial_len_samples\n"


def floor_rows(number: int = 0, target: str = "1,2,-1") -> list[str]:
    return [f"{number},{target},{phase},{i / 50.0},2,-1,2000" for phase in PHASES for i in range(20)]


def write_floor(folder: Path, rows: list[str], name: str = "user_1.csv") -> Path:
    (folder / name).write_text(FLOOR + "\n".join(rows) + "\n")
    return folder / name


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("0,1,2,-1,open_loop_reach,9,2,-1,2000", "line 82, column 'phase': open_loop_reach comes after"),
        ("0,1,2,1,feedback_hold,9,2,-1,2000", "line 82, column 'target_y': 1.0 was expected to be -1.0"),
        ("0,1,2,-1,feedback_hold,5000,2,-1,2000", "is it in seconds?"),
        ("0.5,1,2,-1,feedback_hold,0,2,-1,2000", "line 82, column 'trial': 0.5 is not an integer"),
        ("1,1,2,-1,feedback_hold,-1,2,-1,2000", "line 82, column 't': seconds since feedback_hold began"),
        ("1,1,0,0,feedback_hold,0,2,-1,2000", "the target is 0 m from the feet"),
        ("1,1,2000,-1000,feedback_hold,0,2,-1,2000", "is it in metres?"),
        ("1,1,2,-1,feedback_hold,0,2,-1,1e8", "at most 4.32e+06, a day, got 1e+08"),
        ("0,1,2,-1,sleeping,9,2,-1,2000", "line 82, column 'phase': one of open_loop_reach"),
        ("0,1,2,-1,feedback_hold,0,2,-1,2000", "column 't' must increase"),
    ],
)
def test_rows_out_of_order_are_refused(tmp_path: Path, row: str, said: str) -> None:
    path = write_floor(tmp_path, [*floor_rows(), row])
    assert said in refused(lambda: read_floor_trials(tmp_path), path)


def test_trials_are_in_one_piece(tmp_path: Path) -> None:
    path = write_floor(tmp_path, [*floor_rows(), *floor_rows(1), *floor_rows()])
    assert "line 162, column 'trial'" in refused(lambda: read_floor_trials(tmp_path), path)


def test_many_short_trials_are_read_fast(tmp_path: Path) -> None:
    rows = [f"{i},{i},2,-1,open_loop_hold,0,2,-1,20" for i in range(8_000)]
    write_floor(tmp_path, rows)
    began_s = time.process_time()
    assert len(read_floor_trials(tmp_path)) == 8_000
    assert time.process_time() - began_s < 5.0, "CPU time; that of each trial must not grow with their number"


@pytest.mark.parametrize("name", ["user_all.csv", "user_.csv", "user_\x1b.csv"])
def test_people_have_names_of_their_own(tmp_path: Path, name: str) -> None:
    write_floor(tmp_path, floor_rows(), name)
    with pytest.raises(ConfigError, match="name of the 'subject'"):
        read_floor_trials(tmp_path)


WALL = "subject,session,feedback,tar_x,tar_y,index_x,index_y,index_z,efrc_dir_x,efrc_dir_y,efrc_dir_z"


def write_wall(folder: Path, eyes_z: float = -1.5, finger: float = 0.6) -> Path:
    lines = [WALL]
    for x in (-1.0, 0.0, 1.0):
        for y in (0.8, 1.8, 2.8):
            way = np.array([x, y - 1.6, 3.5]) / math.hypot(x, y - 1.6, 3.5)
            tip = np.array([0.0, 1.6, eyes_z]) + finger * way
            lines.append(",".join(["a", "1", "hand", *(f"{v:.6f}" for v in (x, y, *tip, *way))]))
    path = folder / "wall_targets.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("eyes_z", "finger", "said"),
    [
        (-1.5, 30.0, "the eyes would be 30 m behind the fingertip"),
        (2.5, 0.6, "m before the wall"),
        (-500.0, 0.6, "target ('tar_x', …) and fingertip"),
    ],
)
def test_eyes_that_cannot_be_are_refused(tmp_path: Path, eyes_z: float, finger: float, said: str) -> None:
    path = write_wall(tmp_path, eyes_z, finger)
    assert said in refused(lambda: read_wall_trials(tmp_path), path)


def test_lines_on_a_wall_are_those_of_the_file(tmp_path: Path) -> None:
    path = write_wall(tmp_path)
    path.write_text(path.read_text().replace("\n", "\n\n") + "a,1,eyes,0,0,0,0,0,0,0,1\n")
    assert "line 21, column 'feedback'" in refused(lambda: read_wall_trials(tmp_path), path)
