"""Recorded motion: documented columns, declared names, units, axes and lost values, and refusals."""

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry.rotation import inverse, multiply, rotate
from pointit.maps.units import UP_AXES
from pointit.runtime.errors import ConfigError
from pointit.sim.motion_table import MotionForm
from pointit.sim.recordings import ImuRecording, is_floor_csv, read_floor_csv, read_imu_csv

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


def read(folder: Path, content: str, **form: str) -> ImuRecording:
    path = folder / "take.csv"
    path.write_bytes(content.encode())
    return read_imu_csv(path, MotionForm.model_validate(form))


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
    ("title", "columns", "per_s"),
    [
        ("t", "t=ms", 1e3), ("time", "t=time/us", 1e6), ("Time [ms]", "t=1/ms", 1e3), ("T", "", 1.0),
        ("frame", "t=frame/0.01", 100.0), ("stamp", "t=stamp/ns", 1e9), ("ticks", "t=ticks/1e-7", 1e7),
    ],
)  # fmt: skip
@pytest.mark.parametrize("start_s", [0.0, 1_732_600_000.0])
def test_times_are_read_in_the_declared_unit(
    tmp_path: Path, title: str, columns: str, per_s: float, start_s: float
) -> None:
    rows: list[Row] = [[f"{(float(row[0]) + start_s) * per_s:.6f}", *row[1:]] for row in motion()]
    check(read(tmp_path, text_of((title, *ARM[1:], *BODIES), rows), columns=columns))


@pytest.mark.parametrize(("unit", "per_m"), [("mm", 1e3), ("cm", 1e2), ("in", 1 / 0.0254), ("0.001", 1e3)])
def test_positions_are_read_in_the_declared_unit(tmp_path: Path, unit: str, per_m: float) -> None:
    rows: list[Row] = [[*row[:5], *(float(cell) * per_m for cell in row[5:])] for row in motion()]
    columns = ",".join(f"{name}={name.upper()} POS/{unit}" for name in BODIES)
    header = (*ARM, *(f"{name.upper()} POS" for name in BODIES))
    check(read(tmp_path, text_of(header, rows), columns=columns))


STAMPS: list[Callable[[float], str]] = [
    lambda time_s: f"2026-11-21 12:30:{7 + time_s:09.6f}",
    lambda time_s: f"2026-11-21T12:30:{7 + time_s:06.3f}+01:00",
]


@pytest.mark.parametrize("stamp", STAMPS)
def test_dates_with_times_are_read_where_they_are_declared(
    tmp_path: Path, stamp: Callable[[float], str]
) -> None:
    rows: list[Row] = [[stamp(float(row[0])), *row[1:]] for row in motion()]
    text = text_of((*ARM, *BODIES), rows)
    with pytest.raises(ConfigError, match=r"line 2: .* has no number for t; .* such as .* t=1/iso for dates"):
        read(tmp_path, text)
    check(read(tmp_path, text, columns="t=iso"))


@pytest.mark.parametrize("up", ["y", "-y", "x", "-x", "-z"])
def test_declared_axis_points_up(tmp_path: Path, up: str) -> None:
    """Motion is that of a file whose axes are turned, so that `up` is the room's z."""
    back = inverse(UP_AXES[up])
    rows: list[Row] = []
    for row in motion():
        w, x, y, z, *places = map(float, row[1:])
        x, y, z, w = multiply(back, (x, y, z, w))
        robot = rotate(back, (places[0], places[1], places[2]))
        head = rotate(back, (places[3], places[4], places[5]))
        rows.append([row[0], w, x, y, z, *robot, *head])

    text = text_of((*ARM, *BODIES), rows)
    with pytest.raises(
        ConfigError,
        match=rf"the head is .* above the floor, .* up to the axis that points up, .*(?<![-\w]){up}(,|$)",
    ):
        read(tmp_path, text)
    check(read(tmp_path, text, up=up))


DIALECTS: list[Callable[[Sequence[str], Sequence[Row]], str]] = [
    lambda header, rows: "\ufeff" + text_of(header, rows, end="\r\n"),
    lambda header, rows: text_of(header, rows, ";").replace(".", ","),
    lambda header, rows: "sep=;\r\n" + text_of(header, rows, ";", "\r\n").replace(".", ","),
    lambda header, rows: text_of(header, rows, "\t"),
    lambda header, rows: "# " + text_of(header, rows, " "),
    lambda header, rows: text_of([f'"{each}"' for each in header], rows, ", "),
    lambda header, rows: text_of([each.upper() for each in header], [*rows[:9], [], *rows[9:], ["# end"]]),
    lambda header, rows: "Take,3\nDate,2026-11-21\n\n" + text_of(header, rows, ",", ",\n"),
]


@pytest.mark.parametrize("dialect", DIALECTS)
def test_documented_separators_are_read(
    tmp_path: Path, dialect: Callable[[Sequence[str], Sequence[Row]], str]
) -> None:
    check(read(tmp_path, dialect((*ARM, *BODIES), motion())))


@pytest.mark.parametrize(("unit", "cell"), [("km", "1001"), ("m", "-1e7"), ("m", "Inf")])
def test_positions_beyond_the_limit_are_refused_in_any_unit(tmp_path: Path, unit: str, cell: str) -> None:
    rows = motion()
    rows[5][5] = cell
    with pytest.raises(ConfigError, match=r"line 7, column 'robot_x': .* not within 1e.06; set columns"):
        read(
            tmp_path, text_of((*ARM, *BODIES), rows), columns=f"robot_x={unit},robot_y={unit},robot_z={unit}"
        )


@pytest.mark.parametrize("separator", [" ", "    "])
def test_lost_value_hidden_by_blanks_is_refused(tmp_path: Path, separator: str) -> None:
    rows = motion()
    rows[5][5:8] = ["", "", ""]
    with pytest.raises(ConfigError, match=r"line 7: has 8 cells .*, and there are 11 columns; correct"):
        read(tmp_path, text_of((*ARM, *BODIES), rows, separator))


def test_quote_without_an_end_gives_a_short_message(tmp_path: Path) -> None:
    text = text_of((*ARM, *BODIES), motion())
    with pytest.raises(ConfigError, match="line 7: has 1 cells") as caught:
        read(tmp_path, text.replace("\n0.1,", '\n"0.1,'))
    assert len(str(caught.value)) < len(str(tmp_path)) + 400


@pytest.mark.parametrize(
    ("columns", "factor", "part"),
    [
        (
            [0],
            1e3,
            r"column 't': samples are 20 s apart, .* set columns to its unit: t=t/ms \(0\.02 s apart\)$",
        ),
        ([0], 50.0, r"1 s apart, .*: t=t/ms \(0\.001 s apart\) or t=t/0\.01 for numbers of frames at 100 Hz"),
        ([0], 15.0, "samples are 0.3 s apart, plausible are 0.0004 to 0.25 s; record at another rate$"),
        (
            [5, 6, 7],
            1e3,
            r"is 2549.51 m away, limit 100 m; .* robot_x=robot_x/cm,.* plausible are cm \(26.7 m away\), mm",
        ),
        (
            [8, 9, 10],
            1e2,
            "the head is 173.612 m away, limit 100 m; set columns to their unit, such as head_x=",
        ),
        (
            [8, 9, 10],
            1 / 0.3048,
            r"the head is 5.61024 m above .*, plausible are 0.5 to 3 m; .*, ft \(.* away\), .*, or up to",
        ),
        ([5, 6, 7], 1 / 0.0254, "the robot is 100.374 m away, limit 100 m"),
    ],
)
def test_implausible_units_are_refused_with_the_declaration(
    tmp_path: Path, columns: list[int], factor: float, part: str
) -> None:
    rows: list[Row] = [
        [float(cell) * factor if index in columns else cell for index, cell in enumerate(row)]
        for row in motion()
    ]
    with pytest.raises(ConfigError, match=part):
        read(tmp_path, text_of((*ARM, *BODIES), rows))


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9, 1 / 60, 1 / 3600])
def test_file_is_read_with_the_unit_that_its_refusal_names(tmp_path: Path, factor: float) -> None:
    text = text_of((*ARM, *BODIES), [[float(row[0]) * factor, *row[1:]] for row in motion()])
    with pytest.raises(ConfigError, match="set columns to its unit") as caught:
        read(tmp_path, text)
    proposals = re.findall(r"(t=t/\w+) \((\S+) s apart\)", str(caught.value))
    for columns, period_s in proposals:
        times_s = read(tmp_path, text, columns=columns).t_s
        assert np.median(np.diff(times_s)) == pytest.approx(float(period_s), rel=1e-3)
    assert any(float(period_s) == 1 / RATE_HZ for _, period_s in proposals)


def test_robot_in_centimetres_is_refused_as_too_fast(tmp_path: Path) -> None:
    rows: list[Row] = [[*row[:5], 40.0 * float(row[0]), 30.0, 5.0] for row in motion()]
    with pytest.raises(
        ConfigError, match=r"the robot moves at 40 m/s, limit 30 m/s; set columns to their unit, .*cm"
    ):
        read(tmp_path, text_of((*ARM, *BODIES[:3]), rows))


def test_millimetre_head_with_y_up_is_refused_with_both_remedies(tmp_path: Path) -> None:
    """Columns are those of OptiTrack's Motive."""
    rows: list[Row] = [[*row[:5], 1000 * float(row[8]), 1000 * float(row[10]), 300.0] for row in motion()]
    with pytest.raises(ConfigError, match=r"the head is .* m away, .* or both, plausible are .*mm with up y"):
        read(tmp_path, text_of((*ARM, *BODIES[3:]), rows))


@pytest.mark.parametrize(("cell", "is_read"), [("2,000", False), ("2,0005", True), ("0,200", True)])
def test_comma_of_thousands_is_no_decimal_comma(tmp_path: Path, cell: str, *, is_read: bool) -> None:
    rows: list[Row] = [[*row[:5], "999", cell, "500"] for row in motion()]
    text = text_of((*ARM, *BODIES[:3]), rows, "\t")
    columns = ",".join(f"{name}=mm" for name in BODIES[:3])
    if is_read:
        robot_m = read(tmp_path, text, columns=columns).robot_m
        assert robot_m is not None
        assert robot_m[0][1] == pytest.approx(float(cell.replace(",", ".")) / 1000)
        return
    with pytest.raises(ConfigError, match=r"line 2: 2,000 may have decimals or thousands behind its comma"):
        read(tmp_path, text, columns=columns)


def test_robot_with_another_axis_up_is_refused_below_the_floor(tmp_path: Path) -> None:
    rows: list[Row] = [[*row[:5], row[5], row[7], -4.0] for row in motion()]
    text = text_of((*ARM, *BODIES[:3]), rows)
    with pytest.raises(ConfigError, match=r"the robot is 4 m below the floor, limit 3 m; .* up to .*, y, "):
        read(tmp_path, text)
    recording = read(tmp_path, text, up="y")
    assert recording.robot_m is not None
    assert recording.robot_m[0].tolist() == pytest.approx([2.0, 4.0, 0.5])


def test_partial_columns_of_a_body_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"there is no column robot_z; set columns .* robot_x=1,robot_y=2"):
        read(tmp_path, text_of((*ARM, *BODIES[:2]), [row[:7] for row in motion()]))


def test_columns_without_use_are_noted(tmp_path: Path) -> None:
    recording = read(tmp_path, text_of((*ARM, "note", "lux"), [[*row[:5], "hi", 3] for row in motion()]))
    assert recording.notes == ("columns note, lux are not used",)


GROUPS = {"orientation": slice(1, 5), "robot": slice(5, 8), "head": slice(8, 11)}


@pytest.mark.parametrize("body", GROUPS)
@pytest.mark.parametrize(
    ("cell", "lost"),
    [("", ""), ("NaN", ""), ("-nan", ""), ("n/a", ""), ("0", "0"), ("-9999.00", "-9999"), ("null", "null")],
)
def test_lost_values_are_gaps_in_every_column(tmp_path: Path, body: str, cell: str, lost: str) -> None:
    rows = motion()
    for row in [*range(10, 20), 39]:
        rows[row][GROUPS[body]] = [cell] * len(rows[row][GROUPS[body]])
    text = text_of((*ARM, *BODIES), rows)
    if lost:
        with pytest.raises(ConfigError, match=r"line 12, column.* lost to"):
            read(tmp_path, text)

    recording = read(tmp_path, text, lost=lost)
    values = {"orientation": recording.orientation_xyzw, "robot": recording.robot_m, "head": recording.head_m}
    for name, vectors in values.items():
        assert vectors is not None
        is_lost = np.isnan(vectors).all(axis=1)
        assert np.flatnonzero(is_lost).tolist() == ([*range(10, 20), 39] if name == body else [])
        assert np.isfinite(vectors[~is_lost]).all()
    (note,) = recording.notes

    assert note.startswith(f"{body} (")
    assert note.endswith("missing in 11 of 40 rows, 2 gaps of up to 0.22 s, the first in line 12; left out")


def test_zeros_may_be_declared_as_positions(tmp_path: Path) -> None:
    rows: list[Row] = [[*row[:5], 0.0, 0.0, 0.0] for row in motion()]
    recording = read(tmp_path, text_of((*ARM, *BODIES[:3]), rows), lost="nan")
    assert recording.robot_m is not None
    assert (recording.robot_m == 0.0).all()


def test_marker_is_lost_by_missing_coordinates_but_not_zeros(tmp_path: Path) -> None:
    rows = motion()
    rows[3][6] = ""
    for row in rows:
        row[7] = 0.0
    recording = read(tmp_path, text_of((*ARM, *BODIES), rows))
    assert recording.robot_m is not None
    assert np.flatnonzero(np.isnan(recording.robot_m).all(axis=1)).tolist() == [3]


def test_body_lost_in_all_rows_is_omitted_and_noted(tmp_path: Path) -> None:
    rows: list[Row] = [[*row[:5], "", "", "", *row[8:]] for row in motion()]
    recording = read(tmp_path, text_of((*ARM, *BODIES), rows))
    assert recording.robot_m is None
    assert recording.head_m is not None
    assert "robot ('robot_x' to 'robot_z'): missing in 40 of 40 rows" in recording.notes[0]


def test_points_on_the_floor_have_units_and_gaps(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    rows: list[Row] = [[row[0], 1200.0, 10.0 * index, *row[5:]] for index, row in enumerate(motion())]
    rows[4][1:3] = ["", ""]
    rows[5][8] = "NaN"
    path.write_text(text_of(("Time", "X", "Y", *BODIES), rows, ";"))
    form = MotionForm(columns="t=time,px=x/mm,py=y/mm")
    assert is_floor_csv(path, form)
    recording = read_floor_csv(path, form)
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
