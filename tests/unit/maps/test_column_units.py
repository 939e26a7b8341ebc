"""Units in names of columns, as scanners, spreadsheets and motion capture write them."""

import pytest

from pointit.maps.column_units import LENGTHS_M, TIMES_S, split_unit


@pytest.mark.parametrize(
    ("column", "name", "unit"),
    [
        ("x", "x", ""),
        ("//X", "x", ""),
        ("# x", "x", ""),
        ("X [mm]", "x", "mm"),
        ("X(m)", "x", "m"),
        (' "Point X ( Feet )" ', "point_x", "feet"),
        ("Y{cm}", "y", "cm"),
        ("z/in", "z", "in"),
        ("X, mm", "x", "mm"),
        ("x in mm", "x", "mm"),
        ("pos_x_mm", "pos_x", "mm"),
        ("pos.x", "pos_x", ""),
        ("Points:0", "points_0", ""),
        ("Points_0", "points_0", ""),
        ("t_us", "t", "us"),
        ("Time (µs)", "time", "us"),
        ("Time (μs)", "time", "us"),
        ("Timestamp [ns]", "timestamp", "ns"),
        ("Z (up)", "z", "up"),
        ("Reflectance []", "reflectance", ""),
        ("qx", "qx", ""),
        ("nx", "nx", ""),
        ("\ufeffX (US ft)", "x", "us_ft"),
        ('X (")', "x", '"'),
        ("", "", ""),
        ("m", "m", ""),
        ("[mm]", "mm", ""),
    ],
)
def test_a_column_is_split_into_its_name_and_its_unit(column: str, name: str, unit: str) -> None:
    assert split_unit(column) == (name, unit)


def test_units_have_their_lengths_and_durations() -> None:
    stated = {column: LENGTHS_M[split_unit(column)[1]] for column in ("x [mm]", "x_cm", "x(ft)", "x/Inches")}
    assert stated == {"x [mm]": 0.001, "x_cm": 0.01, "x(ft)": 0.3048, "x/Inches": 0.0254}
    assert TIMES_S[split_unit("t [ms]")[1]] == 0.001
