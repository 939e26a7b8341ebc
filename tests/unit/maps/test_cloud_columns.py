"""Point clouds of other programs: columns by name, units, dialects of text, lists of PLY."""

import contextlib
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.maps.checks.check import examined
from pointit.maps.cloud_file import read_cloud
from pointit.maps.file import load_map_and_clouds, read_map_file
from pointit.runtime.errors import ConfigError

POINTS = np.array([[0.25, 1.5, 2.0], [-3.0, 0.75, 1.25], [4.5, -2.0, 0.5], [1.0, 1.0, 1.0]])
MM = POINTS * 1000.0


def rows(points: np.ndarray, delimiter: str = ",", before: str = "", after: str = "") -> str:
    return "".join(f"{before}{delimiter.join(f'{v:g}' for v in point)}{after}\n" for point in points)


def counted(points: np.ndarray, delimiter: str) -> str:
    return "".join(
        f"{number}{delimiter}{line}\n" for number, line in enumerate(rows(points, delimiter).splitlines())
    )


TEXTS = {
    "names_of_two_words.csv": "Frame No,Return Id,X,Y,Z,Gain\n" + rows(POINTS, before="7,1,", after=",9"),
    "bracketed_metres.csv": "X (m),Y (m),Z (m),Range (m)\n" + rows(POINTS, after=",5"),
    "millimetres.csv": "x [mm];y [mm];z [mm]\n" + rows(MM, ";"),
    "centimetres.csv": "PosX(cm),PosY(cm),PosZ(cm)\n" + rows(POINTS * 100.0),
    "inches.csv": "X/in,Y/in,Z/in\n" + rows(POINTS / 0.0254),
    "feet.txt": "X [ft] Y [ft] Z [ft]\n" + rows(POINTS / 0.3048, " "),
    "unit_of_each_axis.csv": "X_mm,Y_mm,Z_m\n" + rows(POINTS * [1000, 1000, 1]),
    "units_below_names.csv": "X,Y,Z\n(mm),(mm),(mm)\n" + rows(MM),
    "unit_in_comment.xyz": "# scan 12\n# Units: mm\n" + rows(MM, " "),
    "behind_slashes.asc": "//X,Y,Z,R,G,B\n4\n" + rows(POINTS, after=",1,2,3"),
    "hash_and_tab.txt": "#\tX\tY\tZ\n" + rows(POINTS, "\t"),
    "hash_is_the_index.txt": "#\tX\tY\tZ\n" + counted(POINTS, "\t"),
    "quoted.csv": '"Point X","Point Y","Point Z"\n' + rows(POINTS),
    "everything_quoted.csv": '"x","y","z"\n'
    + "".join(",".join(f'"{v:g}"' for v in point) + "\n" for point in POINTS),
    "normals_first.csv": '"Normals:0","Normals:1","Normals:2","Points:0","Points:1","Points:2"\n'
    + rows(POINTS, before="0,0,1,"),
    "axes_in_another_order.csv": "z,x,y\n" + rows(POINTS[:, [2, 0, 1]]),
    "of_a_map.csv": "Easting,Northing,Elevation\n" + rows(POINTS),
    "decimal_commas.csv": "X;Y;Z\n" + rows(POINTS, ";").replace(".", ","),
    "decimal_commas.xyz": rows(POINTS, " ").replace(".", ","),
    "decimal_commas_later.txt": "x\ty\tz\n1\t1\t1\n" + rows(POINTS, "\t").replace(".", ","),
    "trailing_delimiters.csv": "x;y;z;\n" + rows(POINTS, ";", after=";"),
    "count_and_colors.pts": "4\n" + rows(POINTS, " ", after=" -500 10 20 30"),
    "cr.csv": ("x,y,z\n" + rows(POINTS)).replace("\n", "\r"),
    "spreadsheet.csv": "\ufeffsep=;\r\nX;Y;Z\r\n" + rows(POINTS, ";").replace("\n", "\r\n"),
    "marker_reference.csv": "# CoordinateSystem: Local Coordinates (mm)\n#Label,X/East,Y/North,Z/Altitude\n"
    + rows(MM, before="target 1,"),
    "unit_behind_the_names.txt": "X Y Z # mm\n" + rows(MM, " "),
    "unit_alone.xyz": "# [mm]\n" + rows(MM, " "),
    "label_first.csv": "label,x,y,z\n" + rows(POINTS, before="wall,"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_columns_are_found_by_name_and_units_converted(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(TEXTS[name].encode())
    points = read_cloud(path)[-len(POINTS) :]
    np.testing.assert_allclose(points, POINTS, rtol=1e-5)


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_a_header_may_be_in_another_encoding(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "any.txt"
    path.write_bytes(("x\ty\tz\tWinkel [°]\n" + rows(POINTS, "\t", after="\t3")).encode(encoding))
    np.testing.assert_array_equal(read_cloud(path), POINTS)


AMBIGUOUS = {
    "other_names.csv": (
        "stamp,lat,lon,alt\n" + rows(POINTS, before="1,"), "(stamp, lat, lon, alt)|columns: ["),
    "two_positions.csv": (
        "pos_x,pos_y,pos_z,world_x,world_y,world_z\n" + rows(POINTS, after=",1,2,3"),
        "does not say which columns are x, y and z|world_z|columns: [",
    ),
    "names_twice.csv": ("x,y,z,X,Y,Z\n" + rows(POINTS, after=",1,2,3"), "does not say which|columns: ["),
    "minus_sign.csv": ("x,y,z\n1,\N{MINUS SIGN}2,3\n" + rows(POINTS), "line 2: '1,\u22122,3' is not x, y, z"),
    "lost_value.csv": ("x,y,z\n1,n/a,3\n" + rows(POINTS), "line 2: '1,n/a,3' is not x, y, z; correct"),
    "time_first.txt": (
        "".join(f"{n / 100:.2f} {line}\n" for n, line in enumerate(rows(POINTS, " ").splitlines() * 2)),
        "the first counts the rows|columns: [2, 3, 4]"),
    "row_and_column_first.xyz": (
        "".join(f"7 {n * n} {line} 1 2 3\n" for n, line in enumerate(rows(POINTS + 0.1, " ").splitlines())),
        "the first 2 may be no coordinates|columns: [3, 4, 5]"),
    "intensity_first.xyz": (rows(POINTS + 0.1, " ", before="-700 "), "the first 1 may be|columns: [2, 3, 4]"),
    "index.txt": (counted(POINTS, " "), "the first counts the rows|columns: [2, 3, 4]"),
    "blank_in_a_name.txt": (
        "Slot ID X Y Z\n" + rows(POINTS, " ", before="1 "),
        "header has 5 columns (Slot, ID, X, Y, Z) and its rows have 4|columns: [",
    ),
    "commas_between_decimal_commas.csv": (
        "X,Y,Z\n" + rows(POINTS[:1] + 0.125).replace(".", ","), "decimal commas?"),
    "angles.csv": ("X (deg),Y (deg),Z (m)\n" + rows(POINTS), "'X (deg)' has the unit deg"),
    "one_unit.csv": ("X (mm),Y,Z\n" + rows(POINTS), "'Y' has no unit"),
    "no_positions.csv": ("t,gyro_x,gyro_y,gyro_z\n" + rows(POINTS, before="1,"), "does not say which|gyro_z"),
    "renamed_ptx.pts": (
        "4\n1\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n" + rows(POINTS, " "),
        "is a PTX|export it as PTS or PLY"),
    "no_rows.csv": ("x,y,z\na,b,c\n", "no row below its header (x, y, z)"),
}  # fmt: skip


@pytest.mark.parametrize("name", AMBIGUOUS)
def test_ambiguous_columns_are_refused_with_the_header_and_the_remedy(tmp_path: Path, name: str) -> None:
    content, parts = AMBIGUOUS[name]
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ConfigError) as caught:
        read_cloud(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert ";" in message
    for part in parts.split("|"):
        assert part in message


COLORED = {
    "red_first.xyz": "".join(f"255 {n} 0 {x} {y} {z}\n" for n, (x, y, z) in enumerate(POINTS + 0.5)),
    "with_alpha.txt": "".join(f"{9 * n}, 0, 255, 255, {x}, {y}, {z}\n" for n, (x, y, z) in enumerate(POINTS)),
    "millimetres.pts": "4\n"
    + "".join(f"9 {n} 0 {x:.0f} {y:.0f} {z:.0f}\n" for n, (x, y, z) in enumerate(MM)),
    "shares.xyz": "".join(f"{n / 9} 0.5 1 {x} {y} {z}\n" for n, (x, y, z) in enumerate(POINTS)),
    "after_a_comment.xyz": "# my scan\n" + "".join(f"1 2 3 {x} {y} {z}\n# p\n" for x, y, z in POINTS),
}


@pytest.mark.parametrize("name", COLORED)
def test_colours_before_coordinates_without_names_are_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(COLORED[name])
    with pytest.raises(ConfigError, match=r"the first three may be colours; .* such as columns: \[4, 5, 6\]"):
        read_cloud(path)
    assert len(read_cloud(path, (1, 2, 3))) == len(POINTS)


UNIT_CUBE = np.array([[0.25, 0.5, 0.0], [1.0, 0.75, 0.5]])
PLAIN = {
    "colours_behind.xyz": rows(POINTS, " ", after=" 255 0 10"),
    "colours_behind_a_cube.xyz": rows(UNIT_CUBE, " ", after=" 255 0 10"),
    "colours_and_intensity_behind_a_cube.pts": rows(UNIT_CUBE, " ", after=" -700 255 0 10"),
    "normals_behind_a_cube.xyz": rows(UNIT_CUBE, " ", after=" 0.6 -0.8 0"),
    "normals_behind_whole_numbers.xyz": rows(np.array([[1, 2, 3], [4, 5, 6]]), " ", after=" 0 0.6 0.8"),
    "shares_of_colours_behind_a_cube.xyz": rows(UNIT_CUBE, " ", after=" 0.1 1 0.4"),
    "whole_metres_with_intensity.xyz": rows(np.array([[1, 2, 3], [4, 5, 6]]), " ", after=" 0.5"),
}


@pytest.mark.parametrize("name", PLAIN)
def test_coordinates_before_colours_or_normals_are_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(PLAIN[name])
    np.testing.assert_allclose(read_cloud(path), np.loadtxt(path)[:, :3])


def cloud_of(folder: Path, content: str, keys: str) -> np.ndarray:
    (folder / "scan.csv").write_text(content)
    path = folder / "room.yaml"
    path.write_text(f"clouds: {{scan: {{file: scan.csv{keys}}}}}")
    return load_map_and_clouds(str(path), 0)[1]["scan"]


TWO = "Id,Sensor X,Sensor Y,Sensor Z,Room X,Room Y,Room Z\n" + rows(MM, before="4,9,9,9,")


@pytest.mark.parametrize("columns", ["[Room X, Room Y, Room Z]", "[room_x, room_y, room_z]", "[5, 6, 7]"])
def test_a_map_names_the_columns_of_a_cloud(tmp_path: Path, columns: str) -> None:
    points = cloud_of(tmp_path, TWO, f", columns: {columns}, scale: 0.001")
    np.testing.assert_allclose(points, POINTS, rtol=1e-5)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("[Room X, Room Y, Room W]", "'Room W' of columns is no column, its columns are Id, Sensor X"),
        ("[5, 6, 8]", "8 of columns is no column.*numbers from 1 to 7"),
        ("[5, 6, 0]", "0 of columns is no column"),
        ("[5, 6]", "clouds.scan.columns: write the columns of x, y and z"),
        ("[5, 6, true]", "clouds.scan.columns: write the columns of x, y and z"),
        ("Room", "clouds.scan.columns: write the columns of x, y and z"),
    ],
)
def test_a_column_that_does_not_exist_is_named(tmp_path: Path, columns: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        cloud_of(tmp_path, TWO, f", columns: {columns}")


def test_columns_of_a_text_without_names_have_numbers(tmp_path: Path) -> None:
    content = counted(POINTS, ",")
    np.testing.assert_array_equal(cloud_of(tmp_path, content, ", columns: [2, 3, 4]"), POINTS)
    with pytest.raises(ConfigError, match="'X' of columns is no column, it has 4 columns, no names"):
        cloud_of(tmp_path, content, ", columns: [X, Y, Z]")


XYZ = "property float x\nproperty float y\nproperty float z\n"
FACES = "property list uchar int vertex_indices\n"


def ply(kind: str, elements: str) -> bytes:
    return f"ply\nformat {kind} 1.0\nobj_info Generated\ncomment by hand\n{elements}end_header\n".encode()


def faces(order: str, sizes: list[int]) -> bytes:
    return b"".join(struct.pack(f"{order}B{size}i", size, *range(size)) for size in sizes)


def with_views(order: str) -> bytes:
    """Return vertices, each with a list of another size before y."""
    return b"".join(
        struct.pack(f"{order}fB{n}Hff", point[0], n, *range(n), point[1], point[2])
        for n, point in enumerate(POINTS)
    )


VERTEX = f"element vertex {len(POINTS)}\n{XYZ}"
VIEWS = (
    f"element vertex {len(POINTS)}\nproperty float x\nproperty list uchar ushort view\n"
    "property float y\nproperty float z\n"
)
LITTLE = POINTS.astype("<f4").tobytes()
TEXT = rows(POINTS, " ").encode()
PLYS = {
    "no_faces_first": ply("binary_little_endian", f"element face 0\n{FACES}{VERTEX}") + LITTLE,
    "triangles_first": ply("binary_little_endian", f"element face 5\n{FACES}{VERTEX}")
    + faces("<", [3] * 5)
    + LITTLE,
    "empty_faces_first": ply("binary_little_endian", f"element face 4\n{FACES}{VERTEX}")
    + faces("<", [0] * 4)
    + LITTLE,
    "polygons_first": ply("binary_big_endian", f"element face 3\n{FACES}{VERTEX}")
    + faces(">", [3, 0, 5])
    + POINTS.astype(">f4").tobytes(),
    "list_in_vertex": ply("binary_little_endian", VIEWS) + with_views("<"),
    "list_in_vertex_big": ply("binary_big_endian", VIEWS) + with_views(">"),
    "list_in_vertex_text": ply("ascii", VIEWS)
    + "".join(
        f"{x} {n} {'7 ' * n}{y} {z}\n" for n, (x, y, z) in enumerate(POINTS.tolist())
    ).encode(),
    "faces_first_text": ply("ascii", f"element face 2\n{FACES}{VERTEX}") + b"3 0 1 2\n0\n" + TEXT,
    "blank_line_between_faces": ply("ascii", f"element face 2\n{FACES}{VERTEX}")
    + b"3 0 1 2\n\n3 1 2 3\n"
    + TEXT,
    "byte_order_mark": b"\xef\xbb\xbf" + ply("ascii", VERTEX) + TEXT,
    "byte_order_mark_binary": b"\xef\xbb\xbf" + ply("binary_little_endian", VERTEX) + LITTLE,
    "cr": (ply("ascii", VERTEX) + TEXT).replace(b"\n", b"\r"),
    "cr_binary": ply("binary_little_endian", VERTEX).replace(b"\n", b"\r") + LITTLE,
    "crlf_binary": ply("binary_little_endian", VERTEX).replace(b"\n", b"\r\n") + LITTLE,
    "capitals": ply("ascii", VERTEX.replace("float x", "double X").replace("float y", "double Y")) + TEXT,
    "unit": ply("ascii", VERTEX).replace(b"by hand", b"unit: mm") + rows(MM, " ").encode(),
}  # fmt: skip


@pytest.mark.parametrize("name", PLYS)
def test_vertices_are_found_beside_lists_and_in_any_line_ends(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"{name}.ply"
    path.write_bytes(PLYS[name])
    np.testing.assert_allclose(read_cloud(path), POINTS, rtol=1e-6)


@pytest.mark.parametrize(
    "name", ["polygons_first", "list_in_vertex", "triangles_first", "list_in_vertex_text"]
)
def test_a_ply_with_lists_that_is_cut_off_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"{name}.ply"
    path.write_bytes(PLYS[name][:-5])
    with pytest.raises(ConfigError, match=r"is cut off, \d of 4 points are there|a row is not x, y, z"):
        read_cloud(path)


def test_a_map_names_the_properties_of_a_ply(tmp_path: Path) -> None:
    path = tmp_path / "named.ply"
    path.write_bytes(ply("binary_little_endian", VERTEX.replace("float ", "float p")) + LITTLE)
    with pytest.raises(ConfigError, match=r"its vertices have px, py, pz, .*columns: \[px, py, pz\]"):
        read_cloud(path)
    np.testing.assert_allclose(read_cloud(path, ("px", "py", "pz")), POINTS)


@given(st.text(alphabet='xyzXYZ ,;\t#/[]m()0123456789.-\n\r"', max_size=200))
def test_no_text_is_a_fault(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "any_text.csv"
    path.write_bytes(text.encode())
    for columns in ((), (1, 2, 3), ("x", "y", "z")):
        with contextlib.suppress(ConfigError):
            assert read_cloud(path, columns).shape[1] == 3


def test_the_message_about_columns_names_the_cloud_of_the_map(tmp_path: Path) -> None:
    (tmp_path / "scan.csv").write_text("a,b,c\n" + rows(POINTS))
    path = tmp_path / "room.yaml"
    path.write_text("clouds: {scan: {file: scan.csv}}")
    _, findings = examined("room", path, lambda: read_map_file(path))
    assert [each.where for each in findings] == ["clouds.scan.file"]
    assert "scan.csv: its header does not say which columns are x, y and z (a, b, c)" in findings[0].text
