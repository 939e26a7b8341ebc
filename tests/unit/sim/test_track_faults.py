"""Lost markers that are written as numbers, jumps and swaps of recorded bodies, and lost cells."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.runtime.errors import ConfigError
from pointit.sim.recordings import ImuRecording, read_imu_csv

HEADER = ["t", "qw", "qx", "qy", "qz", "robot_x", "robot_y", "robot_z", "head_x", "head_y", "head_z"]
ROWS, RATE_HZ = 160, 80
Array = NDArray[np.float64]
ROBOT, HEAD, ARM = slice(5, 8), slice(8, 11), slice(1, 5)


def moving(noise_m: float = 4e-4) -> Array:
    """Return rows of an arm that waves, a robot on a curve and a head that sways."""
    t = np.arange(ROWS) / RATE_HZ
    turn = 0.3 * np.sin(2.5 * t)
    noise = np.random.default_rng(11).normal(0.0, noise_m, (ROWS, 6))
    robot = np.column_stack([1.8 + 0.5 * t, 0.4 * np.sin(t) - 1.0, 0.25 + 0 * t])
    head = np.column_stack([0.03 * np.sin(2 * t), 0.2 + 0 * t, 1.68 + 0 * t])
    arm = np.column_stack([np.cos(turn), 0 * t, np.sin(turn), 0 * t])
    return np.column_stack([t, arm, np.column_stack([robot, head]) + noise])


def standing() -> Array:
    """Return rows of bodies whose positions are exactly the same in all rows."""
    rows = moving()
    rows[:, 5:] = rows[0, 5:].round(3)
    return rows


def read(
    folder: Path, rows: Array | Sequence[Sequence[object]], header: Sequence[str] = HEADER
) -> ImuRecording:
    path = folder / "take.csv"
    lines = [",".join(header), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_imu_csv(path)


def lost_rows(vectors: Array | None) -> list[int]:
    assert vectors is not None
    return [int(row) for row in np.flatnonzero(np.isnan(vectors).all(axis=1))]


RUNS = {
    "one gap": [*range(40, 52)],
    "several gaps": [9, 40, 41, 42, 120],
    "every second row": [*range(30, 130, 2)],
    "most rows": [*range(20, 140)],
}


@pytest.mark.parametrize("rows", RUNS.values(), ids=RUNS)
@pytest.mark.parametrize(
    "mark", [(-1, -1, -1), (0.25, 0.125, -3.5), (-100, 50, 0), (1, 1, 1), (-999, -999, -999)]
)
@pytest.mark.parametrize("body", ["robot", "head"])
def test_a_constant_of_a_lost_marker_is_a_gap_and_noted(
    tmp_path: Path, body: str, mark: tuple[float, float, float], rows: list[int]
) -> None:
    motion = moving()
    motion[rows, ROBOT if body == "robot" else HEAD] = mark
    recording = read(tmp_path, motion)
    both = {"robot": recording.robot_m, "head": recording.head_m}
    assert lost_rows(both.pop(body)) == rows
    assert lost_rows(next(iter(both.values()))) == []
    (note,) = recording.notes
    text = ", ".join(f"{value:g}" for value in mark)
    assert note.startswith(
        f"{body} ('{body}_x' to '{body}_z'): {text}, far from the rows around, in {len(rows)} of"
    )
    assert f"the first in line {rows[0] + 2}; taken as lost and left out" in note


@pytest.mark.parametrize("rows", [range(12), range(150, ROWS)])
def test_minus_ones_at_the_begin_and_end_are_gaps(tmp_path: Path, rows: range) -> None:
    motion = standing()
    motion[list(rows), ROBOT] = -1.0
    assert lost_rows(read(tmp_path, motion).robot_m) == list(rows)


def test_a_constant_is_lost_also_if_the_body_stands_still(tmp_path: Path) -> None:
    motion = standing()
    motion[[30, 31, 32, 70, 71], ROBOT] = (0.5, 0.25, 3.0)
    assert lost_rows(read(tmp_path, motion).robot_m) == [30, 31, 32, 70, 71]


def test_a_position_that_is_held_until_a_jump_is_kept_and_noted(tmp_path: Path) -> None:
    motion = moving()
    motion[:60, HEAD] = (-2.0, 1.5, 1.7)
    recording = read(tmp_path, motion)
    assert lost_rows(recording.head_m) == []
    (note,) = recording.notes
    assert "head ('head_x' to 'head_z'): jumps to another course in 1 of 160 rows" in note
    assert "the first in line 62; used as it is, look for swapped or shifted markers" in note


def shifted(motion: Array) -> None:
    motion[50:90, ROBOT] += (0.12, 0.0, 0.09)


def swapped(motion: Array) -> None:
    motion[50:90, 5:11] = motion[50:90, [8, 9, 10, 5, 6, 7]]


def mirrored(motion: Array) -> None:
    motion[50:90, 6] *= -1.0


@pytest.mark.parametrize("damage", [shifted, swapped, mirrored])
def test_markers_that_are_shifted_or_swapped_are_noted_and_kept(
    tmp_path: Path, damage: Callable[[Array], None]
) -> None:
    motion = moving()
    damage(motion)
    recording = read(tmp_path, motion)
    assert recording.robot_m is not None
    np.testing.assert_allclose(recording.robot_m, motion[:, ROBOT])
    assert "robot ('robot_x' to 'robot_z'): jumps to another course in 2 of 160 rows" in recording.notes[0]
    assert len(recording.notes) == (2 if damage is swapped else 1)


def test_jumps_of_one_row_are_gaps_in_every_body(tmp_path: Path) -> None:
    motion = moving()
    motion[[20, 77], 7] += (0.4, -3.0)
    motion[90, HEAD], motion[90, ROBOT] = motion[90, ROBOT].copy(), motion[90, HEAD].copy()
    motion[30, ARM] = (0.0, 0.0, 0.0, 1.0)
    recording = read(tmp_path, motion)
    assert lost_rows(recording.robot_m) == [20, 77, 90]
    assert lost_rows(recording.head_m) == [90]
    assert lost_rows(recording.orientation_xyzw) == [30]
    assert [note.partition(":")[2].partition(",")[0] for note in recording.notes] == [
        f" jumps away for one row in {count} of 160 rows" for count in (1, 3, 1)
    ]


def test_quaternions_of_minus_ones_are_gaps(tmp_path: Path) -> None:
    motion = moving()
    motion[40:44, ARM] = -1.0
    assert lost_rows(read(tmp_path, motion).orientation_xyzw) == [40, 41, 42, 43]


def negated(motion: Array) -> None:
    motion[80:, ARM] *= -1.0


def stop_and_go(motion: Array) -> None:
    motion[:, 5] = np.cumsum(np.where(np.arange(ROWS) // 40 % 2, 6.0 / RATE_HZ, 0.0))


def held(motion: Array) -> None:
    motion[:, ROBOT] = motion[np.arange(ROWS) // 8 * 8][:, ROBOT] * (4.0, 1.0, 1.0)


def jittering(motion: Array) -> None:
    motion[1:, 0] += np.random.default_rng(2).uniform(-0.005, 0.005, ROWS - 1)


def interrupted(motion: Array) -> None:
    motion[100:, 0] += 3.0
    motion[100:, ROBOT] += 1.5


@pytest.mark.parametrize("change", [negated, stop_and_go, held, jittering, interrupted])
def test_real_motion_has_no_faults(tmp_path: Path, change: Callable[[Array], None]) -> None:
    motion = moving()
    change(motion)
    recording = read(tmp_path, motion)
    assert recording.notes == ()
    assert lost_rows(recording.robot_m) == lost_rows(recording.head_m) == []


LOST_CELLS = (
    *(
        "#DIV/0!",
        "#N/A",
        "#NV",
        "#WERT!",
        "#NAME?",
        "#VALUE!",
        "Err:502",
        "<NA>",
        ".",
        "NaT",
        "(null)",
        "\\N",
    ),
    *("-3.697314E+028", "-3.4028235E+38", "1.7976931348623157e+308", "-2147483648", "1.#QNAN", "-1.#IND00"),
)


@pytest.mark.parametrize("cell", LOST_CELLS)
@pytest.mark.parametrize("columns", [(5, 6, 7), (6,), (8, 9, 10), (1, 2, 3, 4)])
def test_words_and_numbers_of_programs_for_lost_values_are_gaps(
    tmp_path: Path, cell: str, columns: tuple[int, ...]
) -> None:
    rows: list[list[object]] = [list(row) for row in moving()]
    for column in columns:
        rows[25][column] = cell
    recording = read(tmp_path, rows)
    vectors = {5: recording.robot_m, 6: recording.robot_m, 8: recording.head_m, 1: recording.orientation_xyzw}
    assert lost_rows(vectors[columns[0]]) == [25]
    assert "missing in 1 of 160 rows, 1 gap of up to 0.03 s, the first in line 27" in recording.notes[0]


def test_a_row_whose_time_is_an_error_of_a_spreadsheet_is_no_comment(tmp_path: Path) -> None:
    rows: list[list[object]] = [list(row) for row in moving()]
    rows[25][0] = "#DIV/0!"
    with pytest.raises(ConfigError, match=r"line 27, column 't': a number .* got '#DIV/0!'; write seconds"):
        read(tmp_path, rows)


TIMES: dict[str, tuple[Callable[[int], float], str]] = {
    "frames": (lambda row: 1 + row, "likely frame numbers: divide them by the frame rate"),
    "dropped frames": (lambda row: row + 7 * (row > 50), "likely frame numbers"),
    "ticks of .net": (
        lambda row: 638_900_000_000_000_000 + row * 125_000,
        r"ticks of 100 ns \(80 Hz\): divide",
    ),
    "file times": (lambda row: 133_900_000_000_000_000 + row * 125_000, r"ticks of 100 ns \(80 Hz\): divide"),
    "a stopwatch": (lambda row: 4_000 + row * 125_000, r"us \(8 Hz\) or ticks of 100 ns \(80 Hz\)"),
    "days of a spreadsheet": (
        lambda row: 45_990.5 + row / 80 / 86_400,
        r"likely in days \(.* name the column t_d",
    ),
    "hours": (lambda row: row / 80 / 3600, r"likely in hours \(80 Hz\)"),
    "minutes": (lambda row: row / 80 / 60, r"likely in min \(80 Hz\): name the column t_min"),
}


@pytest.mark.parametrize("name", TIMES)
def test_frame_numbers_ticks_and_days_are_named(tmp_path: Path, name: str) -> None:
    time_of, message = TIMES[name]
    rows: list[list[object]] = [[time_of(row), *each[1:]] for row, each in enumerate(moving())]
    with pytest.raises(ConfigError, match=message):
        read(tmp_path, rows)


def test_times_in_days_are_read_if_their_name_states_it(tmp_path: Path) -> None:
    rows: list[list[object]] = [[row / 80 / 86_400, *each[1:]] for row, each in enumerate(moving())]
    assert read(tmp_path, rows, ["t [days]", *HEADER[1:]]).duration_s == pytest.approx((ROWS - 1) / 80)


@pytest.mark.parametrize(
    ("robot", "head", "units"),
    [
        ((2400.0, -1500.0, 500.0), None, "mm"),
        ((400.0, 300.0, 0.0), None, "cm or mm"),
        ((400.0, 300.0, 0.0), (100.0, 50.0, 1700.0), "mm"),
        ((240.0, 150.0, 50.0), (10.0, 5.0, 170.0), "cm"),
        ((95.0, 60.0, 60.0), (4.0, 5.0, 67.0), "in"),
        ((8e6, 1e5, 0.0), None, ""),
    ],
)
def test_only_units_that_explain_the_positions_of_bodies_that_stand_are_named(
    tmp_path: Path, robot: Sequence[float], head: Sequence[float] | None, units: str
) -> None:
    motion = standing()
    motion[:, ROBOT] = np.array(robot) / (10.0 if robot[0] > 1e6 else 1.0)
    motion[:, HEAD] = head or motion[:, HEAD]
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, motion)
    message = str(caught.value)
    robots = message[message.index("'robot_x' to") :]
    expected = (
        f"they are likely in {units}: name them robot_x_" if units else "write metres, or name them robot_x_m"
    )
    assert expected in robots


@given(st.lists(st.sampled_from([-1.0, 0.0, 0.5, 2.0, 30.0, math.nan]), min_size=1, max_size=40))
def test_any_course_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, places: list[float]) -> None:
    folder = tmp_path_factory.getbasetemp()
    rows = moving()[: len(places)]
    rows[:, 5] = places
    rows[:, 6:8] = 0.0
    sentence = ""
    try:
        assert len(read(folder, rows).t_s) == len(places)
    except ConfigError as error:
        sentence = str(error)
    assert "\n" not in sentence
