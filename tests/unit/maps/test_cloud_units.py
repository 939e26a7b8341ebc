"""Units of point clouds: in names of columns, rows of units and comments."""

from pathlib import Path

import numpy as np
import pytest

from pointit.maps.cloud_file import read_cloud
from pointit.runtime.errors import ConfigError
from tests.unit.maps.test_cloud_columns import MM, POINTS, TEXT, VERTEX, cloud_of, ply, rows

COMMENTS = {
    "coordinates in mm": 0.001,
    "All coordinates are given in millimetres.": 0.001,
    "X Y Z in cm": 0.01,
    "X, Y, Z [mm]": 0.001,
    "points (ft)": 0.3048,
    "Values in feet, exported by hand": 0.3048,
    "positions of the markers are stored in m": 1.0,
    "length unit = inch": 0.0254,
    "UNITS MILLIMETERS": 0.001,
    "LENGTH_UNIT: cm": 0.01,
    "Unit of length: mm": 0.001,
    "1 unit = 0.01 m": 0.01,
    "Units: mm, mm, mm": 0.001,
    "Einheit: mm": 0.001,
    "Koordinaten in Zentimeter": 0.01,
    "unité : millimètre": 0.001,
    "units: US survey feet": 1200 / 3937,
    "coordinates in the frame of the room": 1.0,
    "unit vectors, accuracy in mm: 3": 1.0,
    "voxel size 10 mm": 1.0,
    "scanned in Meter Street": 1.0,
}


@pytest.mark.parametrize("comment", COMMENTS)
@pytest.mark.parametrize("form", ["# {}\n", "// {}\nx y z\n", "x y z\n# {}\n", "ply"])
def test_a_unit_in_a_comment_is_read(tmp_path: Path, comment: str, form: str) -> None:
    path = tmp_path / "scan.xyz"
    content = rows(POINTS / COMMENTS[comment], " ")
    if form == "ply":
        path = tmp_path / "scan.ply"
        head = ply("ascii", VERTEX).replace(b"by hand", comment.encode())
        path.write_bytes(head + content.encode())
    else:
        path.write_text(form.format(comment) + content, encoding="utf-8")
    np.testing.assert_allclose(read_cloud(path), POINTS, rtol=1e-5)


PREAMBLES = {
    "a_line_of_the_program.csv": "Device;Scanner 3000\nUnit;mm\nx;y;z\n" + rows(MM, ";"),
    "units_above_names.csv": "mm,mm,mm\nx,y,z\n" + rows(MM),
    "units_of_the_first_columns_only.csv": "x,y,z,label\n[mm],[mm],[mm],\n" + rows(MM, after=",wall"),
    "units_of_each_column.csv": "t,x,y,z\ns,mm,mm,mm\n" + rows(MM, before="1,"),
    "behind_the_rows.xyz": rows(MM, " ") + "# units: mm\n",
    "the_same_twice.csv": "# units: mm\nx [mm],y [mm],z [mm]\n(mm),(mm),(mm)\n" + rows(MM),
}


@pytest.mark.parametrize("name", PREAMBLES)
def test_a_unit_around_the_names_is_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(PREAMBLES[name])
    np.testing.assert_allclose(read_cloud(path), POINTS, rtol=1e-5)


CONTRADICTIONS = {
    "# Units: mm\n# Units: m\n": "states two units, 'Units: mm' and 'Units: m'; keep the right one",
    "# units in cm\n# coordinates in mm\n": "states two units, 'units in cm' and 'coordinates in mm'",
    "# Units: mm\nx [cm],y [cm],z [cm]\n": "states two units, column 'x [cm]' and 'Units: mm'",
    "x [cm],y [cm],z [cm]\nmm,mm,mm\n": "states two units, column 'x [cm]' and the row mm, mm, mm",
    "x,y,z\nmm,mm,s\n": "the row mm, mm, s is no known length of x, y and z each",
    "x,y,z\n[furlong],[furlong],[furlong]\n": "the row [furlong], [furlong], [furlong] is no known length",
    "# Units: mm, m\nx,y,z\n": "'Units: mm, m' has 2 units for x, y and z",
    "# units: furlongs\nx,y,z\n": "'units: furlongs' has the unit furlongs, which is no known length",
}


@pytest.mark.parametrize("header", CONTRADICTIONS)
def test_contradicting_units_are_refused_with_both_and_a_scale_decides(tmp_path: Path, header: str) -> None:
    content = header + rows(POINTS)
    with pytest.raises(ConfigError) as caught:
        cloud_of(tmp_path, content, "")
    assert f"scan.csv: {CONTRADICTIONS[header]}" in str(caught.value)
    assert str(caught.value).endswith(", or write scale in the map")
    for scale in (1, 0.001):
        np.testing.assert_allclose(cloud_of(tmp_path, content, f", scale: {scale}"), POINTS * scale)


def test_contradicting_units_of_a_ply_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    path.write_bytes(ply("ascii", VERTEX).replace(b"by hand", b"units: mm\ncomment units: cm") + TEXT)
    with pytest.raises(ConfigError, match=r"scan.ply: states two units, 'units: mm' and 'units: cm'"):
        read_cloud(path)


@pytest.mark.parametrize("columns", ["[1, 2, 3]", "[a, b, c]", "['a [mm]', 'b [mm]', 'c [mm]']"])
@pytest.mark.parametrize(
    "header",
    ["a [mm],b [mm],c [mm]\n", "# made by hand\n# a [mm], b [mm], c [mm]\n", "a,b,c\nmm,mm,mm\n",
     "# units: mm\na,b,c\n", "a (mm);b (mm);c (mm)\n"],
)  # fmt: skip
def test_columns_that_a_map_names_have_the_units_of_their_names(
    tmp_path: Path, columns: str, header: str
) -> None:
    if "[mm]" in columns and "[mm]" not in header:
        columns = "[a, b, c]"
    content = header + rows(MM, ";" if ";" in header else ",")
    np.testing.assert_allclose(cloud_of(tmp_path, content, f", columns: {columns}"), POINTS, rtol=1e-5)


@pytest.mark.parametrize(
    ("header", "problem"),
    [
        ("a [mm],b,c\n", "column 'b' has no unit, others have"),
        ("a [deg],b [deg],c [m]\n", "column 'a [deg]' has the unit deg"),
    ],
)
def test_columns_whose_names_state_other_units_need_a_scale(
    tmp_path: Path, header: str, problem: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        cloud_of(tmp_path, header + rows(POINTS), ", columns: [1, 2, 3]")
    assert problem in str(caught.value)
    np.testing.assert_allclose(
        cloud_of(tmp_path, header + rows(POINTS), ", columns: [1, 2, 3], scale: 1"), POINTS
    )


def test_a_scale_that_repeats_the_unit_is_no_second_conversion(tmp_path: Path) -> None:
    content = "X [mm],Y [mm],Z [mm]\n" + rows(MM)
    np.testing.assert_allclose(cloud_of(tmp_path, content, ", scale: 0.001"), POINTS, rtol=1e-5)
    with pytest.raises(
        ConfigError, match=r"states a unit of 0.001 m, and the map has scale 0.5; remove scale"
    ):
        cloud_of(tmp_path, content, ", scale: 0.5")
    np.testing.assert_allclose(
        cloud_of(tmp_path, "X [m],Y [m],Z [m]\n" + rows(POINTS), ", scale: 0.5"), POINTS / 2
    )
