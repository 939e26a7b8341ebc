"""Recordings that cannot be: other units, rows out of order; never a figure from them."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets import read_trials
from pointit_lab.evaluation.datasets.proximity_feedback import read_floor_trials
from tests.support.published_recordings import Stand, write_acts, write_motion, write_track

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


def write_act(folder: Path, stand: Stand) -> Path:
    return write_acts(folder, {"1": (1.7, stand)})


@pytest.mark.parametrize(
    ("write", "columns", "factor", "said"),
    [
        pytest.param(write_track, ["t"], -1.0, "time goes backwards", id="time goes forwards"),
        (write_motion, ["robot_x"], 1000.0, "mm (0.677 m away)"),
        (write_motion, ["robot", "head"], 1000.0, "mm (1.23 m away)"),
        (write_track, ["head_x"], 1000.0, "line 2: robot"),
        (write_track, ["px", "py"], 1000.0, "columns 'px', 'py': half of the points on the floor"),
        (write_act, ["stature"], 100.0, "line 2, column 'stature': metres were expected, got 170"),
        (
            write_act,
            ["forearm", "hand"],
            1000.0,
            "line 2, columns 'hand_…', 'forearm_…': they are 250 m apart",
        ),
        (write_act, ["target"], 1000.0, "line 2: target"),
        (write_act, ["forearm", "hand"], 0.0, "they are 0 m apart"),
    ],
)
def test_values_that_nobody_measures_are_refused(
    tmp_path: Path, write: Callable[..., Path], columns: list[str], factor: float, said: str
) -> None:
    path = write(tmp_path, STAND)
    scaled(path, factor, *columns)
    assert said in refused(lambda: read_trials(tmp_path), path)


def test_the_height_of_the_eyes_below_a_marker_is_somebodys(tmp_path: Path) -> None:
    path = write_track(tmp_path, STAND)
    (path.parent / "index.json").write_text('[{"file": "track_9.csv", "subject": "a"}]')
    scaled(path, 10.0, "head_z")
    assert "column 'head_z': the eyes" in refused(lambda: read_trials(tmp_path), path)


def test_too_many_people_are_refused(tmp_path: Path) -> None:
    path = write_act(tmp_path, STAND)
    header, row, *_ = path.read_text().splitlines()
    path.write_text("\n".join([header, *(f"p{i}{row[1:]}" for i in range(2_000))]))
    assert "has 2000 subjects" in refused(lambda: read_trials(tmp_path), path)


PHASES = ("open_loop_reach", "open_loop_hold", "feedback_reach", "feedback_hold")
FLOOR = "trial,target_id,target_x,target_y,phase,t,x,y,trial_len_samples\n"


def floor_rows(number: int = 0, target: str = "1,2,-1") -> list[str]:
    return [f"{number},{target},{phase},{i / 50.0},2,-1,2000" for phase in PHASES for i in range(20)]


def write_floor(folder: Path, rows: list[str], name: str = "user_1.csv") -> Path:
    (folder / name).write_text(FLOOR + "\n".join(rows) + "\n")
    return folder / name


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["0,1,2,-1,open_loop_reach,9,2,-1,2000"], "line 82, column 'phase': open_loop_reach comes after"),
        (["0,1,2,1,feedback_hold,9,2,-1,2000"], "line 82, column 'target_y': 1.0 was expected to be -1.0"),
        (["0,1,2,-1,feedback_hold,5000,2,-1,2000"], "is it in seconds?"),
        (["0.5,1,2,-1,feedback_hold,0,2,-1,2000"], "line 82, column 'trial': 0.5 is not an integer"),
        (["1,1,2,-1,feedback_hold,-1,2,-1,2000"], "line 82, column 't': seconds since feedback_hold began"),
        (["1,1,0,0,feedback_hold,0,2,-1,2000"], "the target is 0 m from the feet"),
        (["1,1,2000,-1000,feedback_hold,0,2,-1,2000"], "is it in metres?"),
        (["1,1,2,-1,feedback_hold,0,2,-1,1e8"], "at most 4.32e+06, a day, got 1e+08"),
        (["0,1,2,-1,sleeping,9,2,-1,2000"], "line 82, column 'phase': one of open_loop_reach"),
        (["0,1,2,-1,feedback_hold,0,2,-1,2000"], "column 't' must increase"),
        pytest.param([*floor_rows(1), *floor_rows()], "line 162, column 'trial'", id="in two pieces"),
    ],
)
def test_rows_out_of_order_are_refused(tmp_path: Path, rows: list[str], said: str) -> None:
    path = write_floor(tmp_path, [*floor_rows(), *rows])
    assert said in refused(lambda: read_floor_trials(tmp_path), path)


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
