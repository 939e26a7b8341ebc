"""Point clouds of surveys, trackers, R and PCL: first columns that are no coordinates, and their headers."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from pointit.maps.cloud_file import read_cloud
from pointit.runtime.errors import ConfigError

POINTS = np.array([[0.25, 1.5, 2.0], [-3.0, 0.75, 1.25], [4.5, -2.25, 0.5], [1.5, 1.25, 0.125]])
PLAIN = [f"{x:g},{y:g},{z:g}" for x, y, z in POINTS]
NUMBERS = (101, 205, 17, 300)
STAMPS = np.cumsum(np.random.default_rng(5).uniform(0.004, 0.03, 40))
PATH = [[time, np.sin(9 * row), np.cos(7 * row), 1.5] for row, time in enumerate(STAMPS)]


def numbered(numbers: Iterable[int], tail: str = ",WALL", rows: list[str] = PLAIN) -> str:
    return "".join(f"{n},{row}{tail}\n" for n, row in zip(numbers, rows, strict=False))


def tracked(tail: str = "", figures: int = 4) -> str:
    return "".join(f"{t:.{figures}f} {x:.4f} {y:.4f} {z:.4f}{tail}\n" for t, x, y, z in PATH)


SUSPECT = {
    "total_station.csv": numbered(range(1, 5)),
    "numbers_with_gaps.csv": numbered(NUMBERS),
    "numeric_codes.csv": numbered(range(1, 5), ",7"),
    "codes_with_blanks.csv": numbered(range(1, 5), ",40OFFSET 26"),
    "one_point.csv": numbered(range(1, 2)),
    "two_points.csv": numbered(range(7, 9), ""),
    "whole_millimetres.csv": numbered(NUMBERS, rows=["900,20,3", "100,2,30", "9,9,9", "50,60,70"]),
    "behind_a_comment.txt": "# job 12\n" + numbered(range(1, 5)),
    "decimal_commas.txt": numbered(range(1, 5)).replace(",", ";").replace(".", ","),
    "jittering_time.txt": tracked(),
    "rounded_time.txt": tracked(figures=2),
    "trajectory.txt": tracked(" 0 0 0 1"),
    "time_and_color.txt": tracked(" 255 0 9"),
    "row_names_without_quotes.txt": "x,y,z\n" + numbered((3, 7, 9), ""),
}


@pytest.mark.parametrize("name", SUSPECT)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_first_column_of_numbers_or_times_is_refused_with_the_first_row(
    tmp_path: Path, name: str, encoding: str
) -> None:
    path = tmp_path / name
    path.write_text(SUSPECT[name], encoding=encoding)
    with pytest.raises(ConfigError) as caught:
        read_cloud(path)
    message = str(caught.value)
    assert "\n" not in message
    assert "; its first row is '" in message
    assert "write in the map which are x, y and z by number, such as columns: [2, 3, 4]" in message
    assert len(read_cloud(path, (2, 3, 4))) > 0


def test_names_of_a_map_are_not_applied_to_rows_with_another_column(tmp_path: Path) -> None:
    path = tmp_path / "rows.txt"
    path.write_text(SUSPECT["row_names_without_quotes.txt"])
    with pytest.raises(
        ConfigError, match=r"has 3 names \(x, y, z\) for 4 columns, of which the first counts"
    ):
        read_cloud(path, ("x", "y", "z"))


READ = {
    "sorted_with_colors.xyz": "".join(f"{n / 8} {9 - n} 0.5 {n} 0 255\n" for n in range(8)),
    "sorted_with_normals.xyz": "".join(f"{n / 8} {9 - n} 0.5 0 0.6 -0.8\n" for n in range(8)),
    "number_behind_the_point.txt": "".join(f"{n / 8} {n * n} 1.5 {n} V001\n" for n in range(8)),
    "layers_of_a_grid.xyz": "".join(f"{n // 4 / 8} {n % 4} 0.5 0.25\n" for n in range(16)),
    "label_behind.txt": "".join(f"{n / 8} {9 - n} 0.5 wall\n" for n in range(8)),
    "whole_metres_with_label.txt": "".join(f"{n * n % 5} {9 - n} 3 wall\n" for n in range(8)),
}


@pytest.mark.parametrize("name", READ)
def test_rising_coordinates_are_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(READ[name])
    np.testing.assert_allclose(read_cloud(path), np.loadtxt(path, usecols=(0, 1, 2)))


R_TABLES = {
    "write_csv.csv": '"","x","y","z"\n"3",{}\n"7",{}\n"5",{}\n"9",{}\n',
    "write_table.txt": '"x","y","z"\n"3",{}\n"1",{}\n"12",{}\n"5",{}\n',
    "write_table_blanks.txt": '"x" "y" "z"\n"3" {}\n"1" {}\n"12" {}\n"5" {}\n',
    "row_names_of_letters.csv": '"x","y","z"\n"a",{}\n"b",{}\n"c",{}\n"d",{}\n',
}


@pytest.mark.parametrize("name", R_TABLES)
@pytest.mark.parametrize("wanted", [(), ("x", "y", "z")])
def test_quoted_row_names_of_r_are_no_coordinates(tmp_path: Path, name: str, wanted: tuple[str, ...]) -> None:
    path = tmp_path / name
    rows = [row.replace(",", " ") if "blanks" in name else row for row in PLAIN]
    path.write_text(R_TABLES[name].format(*rows))
    np.testing.assert_array_equal(read_cloud(path, wanted), POINTS)


PCD = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS {fields}
SIZE 4 4 4 4
TYPE F F F F
COUNT {counts}
WIDTH 4
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 4
DATA {kind}
"""


@pytest.mark.parametrize("name", ["scan.pcd", "scan.txt", "scan.xyz"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_pcd_is_read_by_its_fields(tmp_path: Path, name: str, end: str) -> None:
    path = tmp_path / name
    head = PCD.format(fields="intensity _ x y z", counts="1 2 1 1 1", kind="ascii")
    content = head + "".join(f"9 8 7 {row.replace(',', ' ')}\n" for row in PLAIN)
    path.write_text(content, newline=end)
    np.testing.assert_array_equal(read_cloud(path), POINTS)
    np.testing.assert_array_equal(read_cloud(path, (4, 5, 6)), POINTS)


@pytest.mark.parametrize(
    ("fields", "counts", "kind", "message"),
    [
        ("x y z rgb", "1 1 1 1", "binary_compressed", "with the points 'binary_compressed'; save it"),
        ("x y z rgb", "1 1", "ascii", "PCD with 4 FIELDS and COUNT '1 1'; export it again"),
        ("range ring", "1 1", "ascii", r"does not say which columns are x, y and z \(range, ring\)"),
    ],
)  # fmt: skip
def test_a_pcd_that_cannot_be_read_is_refused(
    tmp_path: Path, fields: str, counts: str, kind: str, message: str
) -> None:
    path = tmp_path / "scan.txt"
    path.write_bytes(PCD.format(fields=fields, counts=counts, kind=kind).encode() + b"\xff\xfe\0\1")
    with pytest.raises(ConfigError, match=message):
        read_cloud(path)


HEADERS = {
    "numbers_of_pandas.csv": "0,1,2\n",
    "survey_of_a_program.csv": "East (m),North (m),Elev (m)\n",
    "german_survey.csv": "Rechtswert,Hochwert,Höhe\n",
    "viewer_of_a_lidar.csv": '"Points_m_XYZ:0","Points_m_XYZ:1","Points_m_XYZ:2"\n',
}


@pytest.mark.parametrize("name", HEADERS)
def test_headers_of_programs_are_no_points(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(HEADERS[name] + "\n".join(PLAIN) + "\n", encoding="utf-8")
    np.testing.assert_array_equal(read_cloud(path), POINTS)


def test_a_mesh_whose_faces_look_like_points_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mesh.txt"
    path.write_text("OFF\n4 1 0\n" + "\n".join(PLAIN).replace(",", " ") + "\n3 0 1 2\n")
    with pytest.raises(ConfigError, match=r"mesh.txt: is an OFF mesh, whose faces are no points; export it"):
        read_cloud(path)
