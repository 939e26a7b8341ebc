"""Recorded motion as motion capture, spreadsheets and loggers write it: units, dialects, gaps."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.errors import ConfigError
from pointit.sim.recordings import ImuRecording, read_floor_csv, read_imu_csv

RATE_HZ = 50
ARM = ("t", "qw", "qx", "qy", "qz")
BODIES = ("robot_x", "robot_y", "robot_z", "head_x", "head_y", "head_z")

Row = list[float | str]


def motion(rows: int = 40) -> list[Row]:
    """Return rows of an arm that turns, a robot that moves at 0.4 m/s, and a head that sways; s, m."""
    found: list[Row] = []
    for row in range(rows):
        time_s = row / RATE_HZ
        arm = (math.cos(time_s / 2), 0.0, 0.0, math.sin(time_s / 2))
        found.append([time_s, *arm, 2.0 + 0.4 * time_s, -1.5, 0.5, 0.01 * row, 0.3, 1.71])
    return found


def text_of(header: Sequence[str], rows: Sequence[Row], separator: str = ",", end: str = "\n") -> str:
    def cell(value: float | str) -> str:
        return value if isinstance(value, str) else f"{value:.9g}"

    every: list[Row] = [[*header], *rows]
    return "".join(separator.join(map(cell, row)) + end for row in every)


def read(folder: Path, content: str | bytes) -> ImuRecording:
    path = folder / "take.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_imu_csv(path)


def check(recording: ImuRecording) -> None:
    """Check that `recording` is that of `motion`."""
    expected = np.array(motion())
    assert np.allclose(recording.t_s, expected[:, 0], atol=1e-6)
    assert np.allclose(recording.orientation_xyzw, expected[:, [2, 3, 4, 1]], atol=1e-6)
    assert recording.robot_m is not None
    assert recording.head_m is not None
    assert np.allclose(recording.robot_m, expected[:, 5:8], atol=1e-5)
    assert np.allclose(recording.head_m, expected[:, 8:11], atol=1e-5)


@pytest.mark.parametrize(
    ("title", "per_s"),
    [
        ("t_s", 1.0), ("t_ms", 1e3), ("t [ms]", 1e3), ("time (us)", 1e6), ("Time [µs]", 1e6),
        ("timestamp_ns", 1e9), ("TIMESTAMP", 1.0), ("timeMs", 1e3), ("Time (Seconds)", 1.0),
        ("time in ms", 1e3),
    ],
)  # fmt: skip
@pytest.mark.parametrize("start_s", [0.0, 1_732_600_000.0])
def test_times_are_read_in_the_unit_of_their_name(
    tmp_path: Path, title: str, per_s: float, start_s: float
) -> None:
    rows: list[Row] = [[f"{(float(row[0]) + start_s) * per_s:.6f}", *row[1:]] for row in motion()]
    check(read(tmp_path, text_of((title, *ARM[1:], *BODIES), rows)))


TITLES: list[tuple[Callable[[str], str], float]] = [
    (lambda name: f"{name}_mm", 1e3),
    (lambda name: f"{name.upper()} [mm]", 1e3),
    (lambda name: f"{name.replace('_', ' pos ').title()} (cm)", 1e2),
    (lambda name: name.replace("_", ".") + "_in", 1 / 0.0254),
    (lambda name: f"{name}/ft", 1 / 0.3048),
    (lambda name: f"{name}_m", 1.0),
]


@pytest.mark.parametrize(("titles", "per_m"), TITLES)
def test_positions_are_read_in_the_unit_of_their_name(
    tmp_path: Path, titles: Callable[[str], str], per_m: float
) -> None:
    rows: list[Row] = [[*row[:5], *(float(cell) * per_m for cell in row[5:])] for row in motion()]
    check(read(tmp_path, text_of((*ARM, *map(titles, BODIES)), rows)))


def test_each_column_has_its_own_unit_and_a_row_of_units_is_one(tmp_path: Path) -> None:
    factors = (1e3, 1, 1, 1, 1, 1e3, 1e2, 1, 1, 1, 1e3)
    rows: list[Row] = [[float(cell) * by for cell, by in zip(row, factors, strict=True)] for row in motion()]
    units: Row = ["ms", "", "", "", "", "mm", "cm", "m", "", "[m]", "mm"]
    check(read(tmp_path, text_of((*ARM, *BODIES), [units, *rows])))


STAMPS: list[Callable[[float], str]] = [
    lambda time_s: f"2026-03-29T01:59:{59 + time_s:012.9f}Z" if time_s < 1 else "",
    lambda time_s: f"2026-11-21 12:30:{7 + time_s:09.6f}",
    lambda time_s: f"2026-11-21T12:30:{7 + time_s:06.3f}+01:00",
    lambda time_s: f"9:05:{7 + time_s:06.3f}",
]


@pytest.mark.parametrize("stamp", STAMPS)
def test_dates_and_times_of_day_are_times(tmp_path: Path, stamp: Callable[[float], str]) -> None:
    rows: list[Row] = [[stamp(float(row[0])), *row[1:]] for row in motion()]
    check(read(tmp_path, text_of((*ARM, *BODIES), rows)))


def decimal_comma(text: str) -> str:
    return text.replace(".", ",")


Dialect = Callable[[Sequence[str], Sequence[Row]], str | bytes]
DIALECTS: list[Dialect] = [
    lambda header, rows: "\ufeff" + text_of(header, rows, end="\r\n"),
    lambda header, rows: decimal_comma(text_of(header, rows, ";")),
    lambda header, rows: "sep=;\r\n" + decimal_comma(text_of(header, rows, ";", "\r\n")),
    lambda header, rows: text_of(header, rows, "\t"),
    lambda header, rows: text_of(header, rows, ", "),
    lambda header, rows: text_of(header, rows, "   "),
    lambda header, rows: "# " + text_of(header, rows, " "),
    lambda header, rows: "%" + text_of(header, rows),
    lambda header, rows: text_of(header, rows, end="\r"),
    lambda header, rows: text_of([f'"{each}"' for each in header], rows),
    lambda header, rows: text_of([f" '{each}' " for each in header], rows),
    lambda header, rows: text_of([each.upper() for each in header], rows),
    lambda header, rows: text_of(header, [*rows[:9], [""] * 11, [], *rows[9:], ["#", "end"]]),
    lambda header, rows: text_of(header, rows, ",", ",\n"),
    lambda header, rows: "Take,3\nDate,2026-11-21\n\n" + text_of(header, rows),
    lambda header, rows: text_of(header, rows).encode("utf-16"),
    lambda header, rows: text_of([f"{header[0]} [s]", *header[1:], "T [°C]"], rows).encode("cp1252"),
    lambda header, rows: text_of(
        header, [[f'"{cell:.9f}"'.replace(".", ",") for cell in row] for row in rows]
    ),
]


@pytest.mark.parametrize("dialect", DIALECTS)
def test_dialects_of_spreadsheets_and_programs_are_read(tmp_path: Path, dialect: Dialect) -> None:
    check(read(tmp_path, dialect((*ARM, *BODIES), motion())))


@pytest.mark.parametrize(("separator", "cell_mark"), [(";", "."), (",", "."), (";", ",")])
@pytest.mark.parametrize("time_mark", [".", ","])
def test_times_of_day_and_numbers_may_have_different_decimal_marks(
    tmp_path: Path, separator: str, cell_mark: str, time_mark: str
) -> None:
    rows: list[Row] = []
    for row in motion():
        time = f'"2026-11-21 12:30:07.{round(float(row[0]) * 1000):03d}"'.replace(".", time_mark)
        rows.append([time, *(f"{cell:.9g}".replace(".", cell_mark) for cell in row[1:])])
    check(read(tmp_path, text_of((*ARM, *BODIES), rows, separator)))


def test_a_file_with_two_decimal_marks_is_refused_with_both(tmp_path: Path) -> None:
    rows = motion()
    later: list[Row] = [[f'"{cell:.6f}"'.replace(".", ",") for cell in row] for row in rows[9:]]
    rows[9:] = later
    with pytest.raises(ConfigError, match=r"line 11.* got '0,180000'; numbers before it have .* mark '\.'"):
        read(tmp_path, text_of((*ARM, *BODIES), rows))


@pytest.mark.parametrize(
    ("unit", "cell"), [("km", "1001"), ("mm", "1000000001"), ("m", "-1e7"), ("m", "Inf")]
)
def test_positions_beyond_the_limit_are_refused_in_any_unit(tmp_path: Path, unit: str, cell: str) -> None:
    rows = motion()
    rows[5][5] = cell
    header = (*ARM, *(f"{name}_{unit}" for name in BODIES))
    with pytest.raises(
        ConfigError, match=f"line 7, column 'robot_x_{unit}': .* within 1e.06 .* got '{cell}'"
    ):
        read(tmp_path, text_of(header, rows))


@pytest.mark.parametrize("lost", ["", "NaN", "inf"])
def test_a_row_without_a_time_is_refused(tmp_path: Path, lost: str) -> None:
    rows = motion()
    rows[5][0] = lost
    with pytest.raises(ConfigError, match=f"line 7, column 't': a number .* got '{lost}'; write seconds"):
        read(tmp_path, text_of((*ARM, *BODIES), rows))


@pytest.mark.parametrize("separator", [" ", "    "])
def test_a_lost_value_that_blanks_hide_is_refused(tmp_path: Path, separator: str) -> None:
    rows = motion()
    rows[5][5:8] = ["", "", ""]
    with pytest.raises(ConfigError, match="line 7: has 8 cells, and the header 11; write NaN for a lost"):
        read(tmp_path, text_of((*ARM, *BODIES), rows, separator))


def test_a_quote_without_an_end_makes_a_short_message(tmp_path: Path) -> None:
    text = text_of((*ARM, *BODIES), motion())
    with pytest.raises(ConfigError, match="line 41, column 't'") as caught:
        read(tmp_path, text.replace("\n0.1,", '\n"0.1,'))
    assert len(str(caught.value)) < len(str(tmp_path)) + 250


def test_the_line_with_most_known_names_is_the_header(tmp_path: Path) -> None:
    preamble = "Time,Timestamp,T [s]\nExported,t qw qx\n\n# head_x is the cap\n"
    check(read(tmp_path, preamble + text_of((*ARM, *BODIES), motion())))
    motive = (
        "Format Version,1.23,Take Name,Take 1\n\n,,Rotation,Rotation\nFrame,Time (Seconds),X,Y\n0,0,0,1\n"
    )
    with pytest.raises(ConfigError, match="line 4: column 'qx' is missing, found Frame, Time"):
        read(tmp_path, motive)


def test_zero_bytes_of_a_logger_without_power_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"has zero bytes"):
        read(tmp_path, text_of(ARM, [row[:5] for row in motion()]) + "\0" * 512)


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("rate_hz", [20, 60, 200, 1000])
@pytest.mark.parametrize("start_s", [0.0, 3600.0, 1_732_600_000.0])
def test_the_likely_unit_of_times_is_named(tmp_path: Path, unit: str, rate_hz: int, start_s: float) -> None:
    per_s = {"ms": 1e3, "us": 1e6, "ns": 1e9}[unit]
    rows: list[Row] = [[f"{(start_s + row / rate_hz) * per_s:.3f}", 1.0, 0.0, 0.0, 0.0] for row in range(30)]
    with pytest.raises(ConfigError, match=r"'t': samples are .* likely ") as caught:
        read(tmp_path, text_of(ARM, rows))
    is_count = rate_hz == 1000 and unit == "ms" and start_s < 1e6  # also frame numbers are such
    assert (f"likely in {unit} (" in str(caught.value)) is not is_count
    assert ("frame numbers" in str(caught.value)) is is_count
    assert f"t_{unit}" in str(caught.value)
    assert read(tmp_path, text_of((f"t_{unit}", *ARM[1:]), rows)).duration_s == pytest.approx(
        29 / rate_hz, abs=1e-6
    )


def test_slow_samples_are_read_if_the_unit_is_stated_and_noted(tmp_path: Path) -> None:
    rows: list[Row] = [[row * 2.0, 1.0, 0.0, 0.0, 0.0] for row in range(9)]
    recording = read(tmp_path, text_of(("t_s", *ARM[1:]), rows))
    assert recording.duration_s == 16.0
    assert recording.notes == (
        "'t_s': samples are 2 s apart, plausible are 0.0004 to 0.25 s; check the unit that it states",
    )


@pytest.mark.parametrize(("unit", "per_m"), [("mm", 1e3), ("cm", 1e2)])
@pytest.mark.parametrize("columns", [range(5, 8), range(8, 11), range(5, 11)])
def test_the_likely_unit_of_positions_is_named(
    tmp_path: Path, unit: str, per_m: float, columns: range
) -> None:
    rows: list[Row] = [
        [float(cell) * per_m if index in columns else cell for index, cell in enumerate(row)]
        for row in motion()
    ]
    header = (*ARM, *BODIES)
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, text_of(header, rows))
    for name in (header[index] for index in columns):
        assert f"{name}_{unit}" in str(caught.value)
    assert str(caught.value).count("likely in") == len(columns) // 3


def test_a_robot_alone_in_millimetres_is_named(tmp_path: Path) -> None:
    rows: list[Row] = [[*row[:5], *(float(cell) * 1e3 for cell in row[5:8])] for row in motion()]
    with pytest.raises(ConfigError, match="the robot moves at 400 m/s, limit 30 m/s; they are likely in mm"):
        read(tmp_path, text_of((*ARM, *BODIES[:3]), rows))


def test_a_room_far_from_the_origin_of_its_map_is_plausible(tmp_path: Path) -> None:
    rows: list[Row] = [
        [*row[:5], float(row[5]) + 5000, *row[6:8], float(row[8]) + 5000, *row[9:]] for row in motion()
    ]
    robot_m = read(tmp_path, text_of((*ARM, *BODIES), rows)).robot_m
    assert robot_m is not None
    assert robot_m[0, 0] == pytest.approx(5002.0)


def test_one_leap_of_a_marker_is_no_other_unit(tmp_path: Path) -> None:
    rows = motion()
    rows[7][5] = 30.0
    recording = read(tmp_path, text_of((*ARM, *BODIES), rows))
    assert recording.robot_m is not None
    assert np.flatnonzero(np.isnan(recording.robot_m[:, 0])).tolist() == [7]
    assert "robot ('robot_x' to 'robot_z'): jumps away for one row in 1 of 40 rows" in recording.notes[0]


GROUPS = {"orientation": slice(1, 5), "robot": slice(5, 8), "head": slice(8, 11)}


@pytest.mark.parametrize("body", GROUPS)
@pytest.mark.parametrize(
    "lost", ["0", "0.000", "-0.0", "", " ", "NaN", "nan", "null", "N/A", "-nan(ind)", "-9999", "9999999.0"]
)
def test_lost_markers_are_gaps_in_every_column(tmp_path: Path, body: str, lost: str) -> None:
    if "9999" in lost and body == "orientation":
        lost = "NaN"
    rows = motion()
    for row in [*range(10, 20), 39]:
        rows[row][GROUPS[body]] = [lost] * len(rows[row][GROUPS[body]])
    recording = read(tmp_path, text_of((*ARM, *BODIES), rows))
    values = {"orientation": recording.orientation_xyzw, "robot": recording.robot_m, "head": recording.head_m}
    for name, vectors in values.items():
        assert vectors is not None
        is_lost = np.isnan(vectors).all(axis=1)
        assert np.flatnonzero(is_lost).tolist() == ([*range(10, 20), 39] if name == body else [])
        assert np.isfinite(vectors[~is_lost]).all()
        assert np.linalg.norm(vectors[~is_lost], axis=1).min() > 0.5
    (note,) = recording.notes
    assert note.startswith(f"{body} (")
    assert note.endswith("missing in 11 of 40 rows, 2 gaps of up to 0.22 s, the first in line 12; left out")


def test_one_missing_coordinate_loses_the_marker_and_one_zero_does_not(tmp_path: Path) -> None:
    rows = motion()
    rows[3][6] = ""
    for row in rows:
        row[7] = 0.0
    recording = read(tmp_path, text_of((*ARM, *BODIES), rows))
    assert recording.robot_m is not None
    assert np.flatnonzero(np.isnan(recording.robot_m).all(axis=1)).tolist() == [3]


def test_a_body_that_is_lost_throughout_is_left_out_and_noted(tmp_path: Path) -> None:
    rows: list[Row] = [[*row[:5], "", "", "", *row[8:]] for row in motion()]
    recording = read(tmp_path, text_of((*ARM, *BODIES), rows))
    assert recording.robot_m is None
    assert recording.head_m is not None
    assert "robot ('robot_x' to 'robot_z'): missing in 40 of 40 rows" in recording.notes[0]


def test_a_last_row_that_is_cut_off_is_left_out_and_noted(tmp_path: Path) -> None:
    whole = text_of((*ARM, *BODIES), motion())
    recording = read(tmp_path, whole[: whole.rindex(",", 0, -12)] + ",-")
    assert len(recording.t_s) == 39
    assert recording.notes == ("line 41: is cut off, left out",)


def test_points_on_the_floor_have_units_and_gaps(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    rows: list[Row] = [[row[0], 1200.0, 10.0 * index, *row[5:]] for index, row in enumerate(motion())]
    rows[4][1:3] = ["0", "0"]
    rows[5][8] = "NaN"
    path.write_text(text_of(("Time", "PX [mm]", "PY [mm]", *BODIES), rows, ";"))
    recording = read_floor_csv(path)
    assert recording.floor_m[7].tolist() == pytest.approx([1.2, 0.07])
    assert np.flatnonzero(np.isnan(recording.floor_m[:, 0])).tolist() == [4]
    assert recording.eye_height_m == pytest.approx(1.71 - 0.115)
    assert len(recording.notes) == 2


CELLS = st.sampled_from(
    ["0", "", "nan", "1", "-1", "0.5", "1e9", "x", "0,5", "1e400", "9999", '"', "\0", "5_0", "ms"]
)


@given(st.lists(st.lists(CELLS, min_size=9, max_size=12), max_size=6), st.sampled_from(",;\t "))
def test_any_file_is_read_or_refused_with_one_sentence(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[str]], separator: str
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    text = "\n".join(separator.join(row) for row in [[*ARM, *BODIES[:3]], *rows])
    path.write_text(text, encoding="utf-8")
    recording: ImuRecording | None = None
    sentence = f"{path}"
    try:
        recording = read_imu_csv(path)
    except ConfigError as error:
        sentence = str(error)
    assert sentence.startswith(str(path))
    assert "\n" not in sentence
    if recording is not None:
        assert (np.diff(recording.t_s) > 0).all()
        known = recording.orientation_xyzw[np.isfinite(recording.orientation_xyzw).all(axis=1)]
        assert np.allclose(np.linalg.norm(known, axis=1), 1.0)
