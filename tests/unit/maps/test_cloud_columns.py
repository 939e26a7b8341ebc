"""Clouds of other programs: columns named or declared, lists of PLY, PCD; refusals whose remedy works."""

import contextlib
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pointit.maps.cloud_file import read_points
from pointit.maps.file import load_map_and_clouds
from pointit.maps.text_table import Wanted
from pointit.runtime.errors import ConfigError

POINTS = np.array([[0.25, 1.5, 2.0], [-3.0, 0.75, 1.25], [4.5, -2.0, 0.5], [1.0, 1.0, 1.0]])
MM = POINTS * 1000.0


def rows(points: np.ndarray, delimiter: str = ",", before: str = "", after: str = "", form: str = "g") -> str:
    return "".join(f"{before}{delimiter.join(f'{v:{form}}' for v in point)}{after}\n" for point in points)


def counted(points: np.ndarray, delimiter: str) -> str:
    return "".join(
        f"{number}{delimiter}{line}\n" for number, line in enumerate(rows(points, delimiter).splitlines())
    )


TEXTS = {
    "names_of_two_words.csv": "Frame No,Return Id,X,Y,Z,Gain\n" + rows(POINTS, before="7,1,", after=",9"),
    "hash_and_tab.txt": "#\tX\tY\tZ\n" + rows(POINTS, "\t", before="7\t"),
    "everything_quoted.csv": '"x","y","z"\n'
    + "".join(",".join(f'"{v:g}"' for v in point) + "\n" for point in POINTS),
    "axes_in_another_order.csv": "z,x,y\n" + rows(POINTS[:, [2, 0, 1]]),
    "decimal_commas.csv": "X;Y;Z\n" + rows(POINTS, ";").replace(".", ","),
    "decimal_commas_later.txt": "x\ty\tz\n1\t1\t1\n" + rows(POINTS, "\t").replace(".", ","),
    "trailing_delimiters.csv": "x;y;z;\n" + rows(POINTS, ";", after=";"),
    "cr.csv": ("x,y,z\n" + rows(POINTS)).replace("\n", "\r"),
    "spreadsheet.csv": "\ufeffsep=;\r\nX;Y;Z\r\n" + rows(POINTS, ";").replace("\n", "\r\n"),
    "label_first.csv": "label,x,y,z\n" + rows(POINTS, before="wall,"),
    "a_title_above.csv": "Scan of the kitchen, 2026\n\nx,y,z\n" + rows(POINTS),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_line_names_the_columns(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(TEXTS[name].encode())
    np.testing.assert_allclose(read_points(path)[-len(POINTS) :], POINTS, rtol=1e-5)


DECLARED: dict[str, tuple[str, Wanted, str]] = {
    "no_names.xyz": (rows(POINTS, " "), {"x": 1, "y": 2, "z": 3}, "1 '0.25', 2 '1.5', 3 '2'"),
    "count_and_colors.pts": (
        "4\n" + rows(POINTS, " ", after=" -500 10 20 30"), {"x": 1, "y": 2, "z": 3}, "line 1 is 1 '4'"),
    "number_first.csv": (counted(POINTS, ","), {"x": 2, "y": 3, "z": 4}, "1 '0', 2 '0.25'"),
    "unit_in_the_name.csv": (
        "X [m],Y [m],Z [m]\n" + rows(POINTS), {"x": "X [m]", "y": 2, "z": "z [M]"}, "1 'X [m]', 2 'Y [m]'"),
    "two_positions.csv": (
        "x,y,z,X,Y,Z\n" + rows(POINTS, before="9,9,9,"), {"x": 4, "y": 5, "z": 6}, "3 'z', 4 'X'"),
    "row_of_units.csv": ("X,Y,Z\n[m],[m],[m]\n" + rows(POINTS), {"x": 1, "y": 2, "z": 3}, "line 2: 1 '[m]'"),
    "row_names_of_r.csv": (
        '"x","y","z"\n' + counted(POINTS, ","), {"x": 2, "y": 3, "z": 4}, "line 2: has 4 cells"),
    "a_name_twice.csv": ("x,y,z,z\n" + rows(POINTS, after=",9"), {"x": 1, "y": 2, "z": 3}, "4 'z'"),
}  # fmt: skip


@pytest.mark.parametrize("name", DECLARED)
def test_other_columns_are_refused_until_they_are_declared(tmp_path: Path, name: str) -> None:
    content, wanted, shown = DECLARED[name]
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ConfigError) as caught:
        read_points(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert shown in str(caught.value)
    assert "set columns in the map to those of x, y and z, by name or number, such as {x: 1," in str(
        caught.value
    )
    np.testing.assert_allclose(read_points(path, wanted), POINTS, rtol=1e-6)


REFUSED = {
    "minus_sign.csv": ("x,y,z\n1,\N{MINUS SIGN}2,3\n" + rows(POINTS), "a row is not x, y, z"),
    "lost_value.csv": ("x,y,z\n1,n/a,3\n" + rows(POINTS), "a row is not x, y, z"),
    "commas_between_decimal_commas.csv": (
        "X,Y,Z\n" + rows(POINTS[:1] + 0.125).replace(".", ","), "line 2: has 6 cells .* there are 3 columns"),
    "renamed_ptx.pts": (
        "4\n1\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n" + rows(POINTS, " "),
        "no line names the columns"),
    "mesh.txt": ("OFF\n4 1 0\n" + rows(POINTS, " "), "no line names the columns"),
    "no_rows.csv": ("x,y,z\na,b,c\n", "line 2: 1 'a', 2 'b', 3 'c' has no number for x, y, z"),
    "no_points.csv": ("x,y,z\n", "has no points"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_text_that_is_no_table_of_points_is_refused(tmp_path: Path, name: str) -> None:
    content, message = REFUSED[name]
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ConfigError, match=message):
        read_points(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("0,1,2\n" + rows(POINTS), "line 1: 1 '0', 2 '1', 3 '2' numbers the columns; remove it"),
        ("1,nan,3\n" + rows(POINTS), "line 1: 1 '1', 2 'nan', 3 '3' is no row; correct or remove it"),
        ("a,b,c\n", "no line has numbers in the columns 1, 2, 3, the first line is 1 'a', 2 'b', 3 'c'"),
    ],
)
def test_no_first_row_is_passed_over_silently(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "scan.csv"
    path.write_text(content)
    with pytest.raises(ConfigError, match=message):
        read_points(path, {"x": 1, "y": 2, "z": 3})


def cloud_of(folder: Path, content: str, keys: str) -> np.ndarray:
    (folder / "scan.csv").write_text(content)
    path = folder / "room.yaml"
    path.write_text(f"clouds: {{scan: {{file: scan.csv{keys}}}}}")
    return load_map_and_clouds(str(path), 0)[1]["scan"]


TWO = "Id,Sensor X,Sensor Y,Sensor Z,Room X,Room Y,Room Z\n" + rows(MM, before="4,9,9,9,")


@pytest.mark.parametrize(
    "columns", ["{x: Room X, y: Room Y, z: Room Z}", "{z: 7, y: ROOM Y, x: room x}", "{x: 5, y: 6, z: 7}"]
)
def test_a_map_names_the_columns_of_a_cloud(tmp_path: Path, columns: str) -> None:
    points = cloud_of(tmp_path, TWO, f", columns: {columns}, unit: mm")
    np.testing.assert_allclose(points, POINTS, rtol=1e-5)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            "columns: {x: Room X, y: Room Y, z: Room W}",
            "no line names the columns Room X, Room Y, Room W once each",
        ),
        (
            "columns: {x: 5, y: 6, z: 8}",
            "no line has numbers in the columns 5, 6, 8, the first line is 1 'Id'",
        ),
        ("columns: {x: 5, y: 6, z: 0}", "no line has numbers in the columns 5, 6, 0"),
        ("columns: {x: 5, y: 6}", "clouds.scan.columns: write the columns of x, y and z"),
        ("columns: [5, 6, 7]", "clouds.scan.columns: write the columns of x, y and z"),
        ("columns: {x: 5, y: 6, z: true}", "clouds.scan.columns: write the columns of x, y and z"),
        ("columns: Room", "clouds.scan.columns: write the columns of x, y and z"),
        ("unit: meters", "clouds.scan.unit: write one of m, dm, cm, .* or a number of metres, not 'meters'"),
        ("unit: 0", "clouds.scan.unit: write one of m"),
        ("up: Y", "clouds.scan.up: write the axis that points up, one of z, y, -y, x, -x, -z, not 'Y'"),
        ("origin: [1, 2]", r"clouds.scan.origin: write a point of the file, \[x, y, z\] in its unit, not"),
        ("origin: [1, 2, 1e12]", "clouds.scan.origin: write a point of the file"),
    ],
)
def test_keys_that_describe_no_cloud_are_refused_by_name(tmp_path: Path, keys: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        cloud_of(tmp_path, TWO, f", {keys}")


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
    "crlf_binary": ply("binary_little_endian", VERTEX).replace(b"\n", b"\r\n") + LITTLE,
    "capitals": ply("ascii", VERTEX.replace("float x", "double X").replace("float y", "double Y")) + TEXT,
}  # fmt: skip


@pytest.mark.parametrize("name", PLYS)
def test_vertices_are_found_beside_lists_and_in_both_line_ends(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"{name}.ply"
    path.write_bytes(PLYS[name])
    np.testing.assert_allclose(read_points(path), POINTS, rtol=1e-6)


@pytest.mark.parametrize(
    "name", ["polygons_first", "list_in_vertex", "triangles_first", "list_in_vertex_text"]
)
def test_a_ply_with_lists_that_is_cut_off_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"{name}.ply"
    path.write_bytes(PLYS[name][:-5])
    with pytest.raises(ConfigError, match=r"is cut off, \d of 4 points are there|a row is not x, y, z"):
        read_points(path)


def test_a_map_names_the_properties_of_a_ply(tmp_path: Path) -> None:
    path = tmp_path / "named.ply"
    path.write_bytes(ply("binary_little_endian", VERTEX.replace("float ", "float p")) + LITTLE)
    with pytest.raises(ConfigError, match=r"its vertices have 1 'px', 2 'py', 3 'pz'; set columns"):
        read_points(path)
    np.testing.assert_allclose(read_points(path, {"x": "px", "z": "pz", "y": "py"}), POINTS)


@given(st.text(alphabet='xyzXYZ ,;\t#/[]m()0123456789.-\n\r"', max_size=200))
def test_no_text_is_a_fault(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "any_text.csv"
    path.write_bytes(text.encode())
    for columns in ({"x": 1, "y": 2, "z": 3}, {"x": "x", "y": "y", "z": "z"}):
        with contextlib.suppress(ConfigError):
            assert read_points(path, columns).shape[1] == 3


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
    content = head + rows(POINTS, " ", before="9 8 7 ")
    path.write_text(content, newline=end)
    np.testing.assert_array_equal(read_points(path), POINTS)
    np.testing.assert_array_equal(read_points(path, {"x": 4, "y": 5, "z": 6}), POINTS)


@pytest.mark.parametrize(
    ("fields", "counts", "kind", "message"),
    [
        ("x y z rgb", "1 1 1 1", "binary_compressed", "with the points 'binary_compressed'; save it"),
        ("x y z rgb", "1 1", "ascii", "PCD with 4 FIELDS and COUNT '1 1'; export it again"),
        ("range ring", "1 1", "ascii", "its fields are 1 'range', 2 'ring'; set columns in the map"),
    ],
)  # fmt: skip
def test_a_pcd_that_cannot_be_read_is_refused(
    tmp_path: Path, fields: str, counts: str, kind: str, message: str
) -> None:
    path = tmp_path / "scan.txt"
    path.write_bytes(PCD.format(fields=fields, counts=counts, kind=kind).encode() + b"\xff\xfe\0\1")
    with pytest.raises(ConfigError, match=message):
        read_points(path)


ROOM = np.array([[0.25, 1.5, 2.0], [4.0, 0.75, 0.0], [3.5, 3.25, 0.5], [1.0, 5.0, 1.0]])
"""Points of a room, {W}."""
X, Y, Z = ROOM.T
Y_UP = np.column_stack([X, Z - 1.4, -Y])
"""The room in the frame of a phone that is held 1.4 m above the floor."""
Y_DOWN_MM = np.column_stack([X, 1.2 - Z, Y]) * 1000.0
"""The room in the optical frame of a camera that stands 1.2 m above the floor."""


def binary_ply(points: np.ndarray, comment: str, more: str = "", tail: bytes = b"") -> bytes:
    head = f"ply\nformat binary_little_endian 1.0\ncomment {comment}\nelement vertex {len(points)}\n"
    head += f"property float x\nproperty float y\nproperty float z\n{more}end_header\n"
    return head.encode() + b"".join(struct.pack("<3f", *point) + tail for point in points.tolist())


RGBA = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue", "alpha"))
LIVOX = (
    "Version,Slot ID,LiDAR Index,Rsvd,Error Code,Timestamp Type,Data Type,Timestamp,X,Y,Z,Reflectivity,Tag,"
    "Ori_x,Ori_y,Ori_z,Ori_radius,Ori_theta,Ori_phi\n"
)
FLOOR_OF_PHONE = {"position": [0, 0, 1.4]}
CLOUDS: dict[str, tuple[str | bytes, dict[str, Any]]] = {
    "arkit_phone.ply": (
        binary_ply(Y_UP, "VCGLIB generated", RGBA, b"\1\2\3\xff"),
        {"up": "y"} | FLOOR_OF_PHONE,
    ),
    "survey_utm.csv": (
        "Easting,Northing,Height\n" + rows(ROOM + np.array([386120, 5820345, 34.2]), form=".3f"),
        {"columns": {"x": "Easting", "y": "Northing", "z": "Height"}, "origin": [386120, 5820345, 34.2]},
    ),
    "cloudcompare.asc": (
        "//X Y Z R G B\n4\n" + rows(ROOM, " ", after=" 1 2 3"),
        {"columns": {"x": 1, "y": 2, "z": 3}},
    ),
    "livox_viewer.csv": (
        LIVOX + rows(ROOM, before="5,7,1,0,0,0,2,100,", after=",10,0,1000,2000,500,0,0,0"),
        {},
    ),
    "azure_kinect.ply": (
        binary_ply(Y_DOWN_MM, "unit: mm", RGBA, b"\0" * 4),
        {"unit": "mm", "up": "-y", "position": [0, 0, 1.2]},
    ),
    "pandas_index.csv": (
        ",x,y,z\n" + "".join(f"{n},{row}\n" for n, row in enumerate(rows(ROOM).split())),
        {},
    ),
    "paraview.csv": (
        '"Intensity","Points:0","Points:1","Points:2"\n' + rows(ROOM, before="7,"),
        {"columns": {"x": "Points:0", "y": "Points:1", "z": "Points:2"}},
    ),
    "gnss_feet.txt": (
        "# pt north_ft east_ft up_ft\n"
        + "".join(
            f"P{n} {y / 0.3048:.5f} {x / 0.3048:.5f} {z / 0.3048:.5f}\n"
            for n, (x, y, z) in enumerate(ROOM + np.array([900, 0, 0]))
        ),
        {
            "columns": {"x": "east_ft", "y": "north_ft", "z": "up_ft"},
            "unit": "ft",
            "origin": [900 / 0.3048, 0, 0],
        },
    ),
}
"""Content of a file, and the parameters that describe it."""
UNASKED = {"azure_kinect.ply": ("up",), "gnss_feet.txt": ("unit",)}
"""Parameters without which these are as plausible: the documents name one, the header shows the other."""


@pytest.mark.parametrize("name", CLOUDS)
def test_cloud_is_read_correctly_or_refused_with_working_parameters(tmp_path: Path, name: str) -> None:
    content, parameters = CLOUDS[name]
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    path = tmp_path / "room.yaml"
    missing = {**parameters}
    known = [each for each in ("position", *UNASKED.get(name, ())) if each in missing]
    entry: dict[str, Any] = {"file": name} | {each: missing.pop(each) for each in known}
    while missing:
        path.write_text(yaml.safe_dump({"clouds": {"scan": entry}}))
        with pytest.raises(
            ConfigError, match="|".join(f"set {each} in the map" for each in missing)
        ) as caught:
            load_map_and_clouds(str(path), 0)
        named = next(each for each in missing if f"set {each} in the map" in str(caught.value))
        entry[named] = missing.pop(named)
    path.write_text(yaml.safe_dump({"clouds": {"scan": entry}}))
    points = load_map_and_clouds(str(path), 0)[1]["scan"]

    np.testing.assert_allclose(points, ROOM, atol=0.02 if "utm" in name else 2e-4)


def test_shallow_scan_is_refused_until_its_up_axis_is_stated(tmp_path: Path) -> None:
    shallow = np.column_stack([X, Z - 1.4, 0.4 * (Y - Y.mean())])
    (tmp_path / "scan.csv").write_text("x,y,z\n" + rows(shallow))
    path = tmp_path / "room.yaml"
    path.write_text("clouds: {scan: {file: scan.csv}}")
    with pytest.raises(
        ConfigError, match=r"50% of its points are more than 0\.3 m below .*; set up in the map"
    ):
        load_map_and_clouds(str(path), 0)
    for up, heights in (("y", Z - 1.4), ("z", shallow[:, 2])):
        path.write_text(f"clouds: {{scan: {{file: scan.csv, up: {up}}}}}")
        points = load_map_and_clouds(str(path), 0)[1]["scan"]
        np.testing.assert_allclose(points[:, 2], heights, atol=1e-4)
