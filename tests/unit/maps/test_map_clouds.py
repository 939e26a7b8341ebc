"""Point clouds and tables of pixels."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry.rotation import rotate
from pointit.maps import cloud_file, exchange
from pointit.maps.cloud_file import read_points
from pointit.maps.file import load_map_and_clouds, parse_map_file
from pointit.maps.light_files.pixel_table import parse_pixel_columns
from pointit.maps.light_files.strip_fit import first_pixels, no_note
from pointit.maps.units import UP_AXES
from pointit.runtime.errors import ConfigError
from tests.unit.maps.test_exchange_layouts import lights

POINTS = np.array([[0.5, -1.25, 2.0], [3.0, 4.5, -0.125], [100.0, 0.0, 1.75]])


def ply(kind: str, vertex: str, rows: int = 3, before: str = "") -> bytes:
    head = f"ply\nformat {kind} 1.0\ncomment made by hand\n"
    return f"{head}{before}element vertex {rows}\n{vertex}end_header\n".encode()


XYZ = "property float x\nproperty float y\nproperty float z\n"
EXTRA = "".join(
    f"property {kind}\n" for kind in ("uchar red", "double x", "float32 confidence", "float64 z", "double y")
)
TEXT = "\n".join(" ".join(str(number) for number in point) for point in POINTS) + "\n"


def with_extra(order: str) -> bytes:
    kinds = np.dtype(
        [("r", "u1"), ("x", order + "f8"), ("c", order + "f4"), ("z", order + "f8"), ("y", order + "f8")]
    )
    rows = np.zeros(3, dtype=kinds)
    rows["r"] = 255
    rows["c"] = 0.5
    rows["x"], rows["y"], rows["z"] = POINTS.T
    return rows.tobytes()


FORMATS = {
    "text.ply": ply("ascii", XYZ) + TEXT.encode(),
    "text_extra.ply": ply("ascii", EXTRA)
    + "\n".join(f"255 {x} 0.5 {z} {y}" for x, y, z in POINTS).encode()
    + b"\n",
    "text_faces.ply": ply("ascii", XYZ).replace(
        b"end_header", b"element face 1\nproperty list uchar int vertex_index\nend_header"
    )
    + TEXT.encode()
    + b"3 0 1 2\n",
    "text_camera.ply": ply("ascii", XYZ, before="element camera 2\nproperty float f\n")
    + b"1.0\n2.0\n"
    + TEXT.encode(),
    "little.ply": ply("binary_little_endian", XYZ) + POINTS.astype("<f4").tobytes(),
    "big.ply": ply("binary_big_endian", XYZ) + POINTS.astype(">f4").tobytes(),
    "little_extra.ply": ply("binary_little_endian", EXTRA) + with_extra("<"),
    "big_extra.ply": ply("binary_big_endian", EXTRA) + with_extra(">"),
    "little_camera.ply": ply("binary_little_endian", XYZ, before="element camera 2\nproperty short f\n")
    + b"\0\0\0\0"
    + POINTS.astype("<f4").tobytes(),
    "little_after.ply": ply("binary_little_endian", XYZ).replace(
        b"end_header", b"element face 1\nproperty list uchar int vertex_index\nend_header"
    )
    + POINTS.astype("<f4").tobytes()
    + b"\3aaaabbbbcccc",
    "plain.xyz": f"x y z\n{TEXT}".encode(),
    "remarks.XYZ": ("# scanned\n\nx y z\n" + TEXT.replace("\n", "  # a point\n")).encode(),
    "one_line_end_missing.xyz": f"# x y z\n{TEXT.rstrip()}".encode(),
}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_points(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(FORMATS[name])
    points = read_points(path)
    assert points.dtype == np.float64
    np.testing.assert_array_equal(points, POINTS)


BROKEN = {
    "cloud.obj": (b"v 1 2 3", "is not a point cloud; give a file that ends in .ply, .xyz"),
    "text.ply": (b"1 2 3\n", "does not begin with the line `ply`"),
    "endless.ply": (b"ply\nformat ascii 1.0\n", "its header does not end"),
    "negative.ply": (ply("ascii", XYZ, rows=-1), "line 4 of its header|vertex -1"),
    "no_vertex.ply": (ply("ascii", XYZ).replace(b"vertex", b"corner"), "has no element vertex"),
    "no_z.ply": (
        ply("ascii", XYZ.replace("float z", "float w")), "have 1 'x', 2 'y', 3 'w'; set columns"),
    "list.ply": (
        ply("binary_little_endian", "property list uchar int near\n" + XYZ) + b"\xff" * 50,
        "is cut off, 0 of 3 points are there"),
    "list_of_x.ply": (
        ply("ascii", XYZ.replace("float x", "list uchar float x")) + b"1 2 3 4\n", "x is a list"),
    "short.ply": (
        ply("binary_little_endian", XYZ) + POINTS.astype("<f4").tobytes()[:-1],
        "is cut off, 2 of 3 points are there"),
    "words.ply": (ply("ascii", XYZ) + b"1 2 3\n1 two 3\n1 2 3\n", "a row is not x, y, z|two"),
    "endless_text.ply": (
        ply("ascii", XYZ, before=f"element stone {10**30}\n") + TEXT.encode(), "0 of 3 points are there"),
    "none.ply": (ply("ascii", XYZ, rows=0), "has no points"),
    "many.ply": (ply("ascii", XYZ, rows=5_000_001), "has 5000001 points, limit 5000000"),
    "signalling_nan.ply": (
        ply("binary_big_endian", XYZ, rows=1) + bytes.fromhex("00000000 7f800001 00000000"),
        "1 of 1 points are not finite"),
    "nan.xyz": (
        b"x y z\n1 2 3\n1 nan 3\n4 5 inf\n",
        "2 of 3 points are not finite, the first is point 2 [1.0, nan, 3.0]"),
    "remarks.xyz": (b"# nothing\n\n", "no line names the columns x, y, z once each, line 1 is 1 'nothing'"),
    "prose.txt": (b"Dear reader,\nthis is a letter.\n", "no line names the columns|1 'Dear reader'"),
    "binary_later.xyz": (b"x y z\n" + b"1 2 3\n" * 5000 + b"\xff\xfe", "is not UTF-8 text"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_cloud_is_one_sentence(tmp_path: Path, name: str) -> None:
    content, parts = BROKEN[name]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        read_points(path)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    assert ";" in said, "what to do is said"
    for part in parts.split("|"):
        assert part in said, said


def test_a_text_of_too_many_points_is_refused_unread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cloud_file, "MAX_POINTS", 2)
    path = tmp_path / "cloud.xyz"
    path.write_text(f"x y z\n{TEXT}")
    with pytest.raises(ConfigError, match="has more points, limit 2; thin it"):
        read_points(path)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.xyz")
    with pytest.raises(ConfigError, match=r"pipe\.xyz: is not a file; give"):
        read_points(tmp_path / "pipe.xyz")


@given(st.binary(max_size=300), st.sampled_from([".ply", ".xyz"]))
def test_no_bytes_are_a_fault(tmp_path_factory: pytest.TempPathFactory, content: bytes, suffix: str) -> None:
    path = tmp_path_factory.getbasetemp() / f"any{suffix}"
    for head in (
        b"",
        b"ply\nformat binary_little_endian 1.0\n",
        ply("ascii", XYZ),
        ply("binary_big_endian", XYZ),
    ):
        path.write_bytes(head + content)
        try:
            points = read_points(path)
        except ConfigError:
            continue
        assert points.shape[1] == 3
        assert np.isfinite(points).all()


def placed(folder: Path, keys: str) -> NDArray[np.float64]:
    (folder / "scans").mkdir(exist_ok=True)
    (folder / "scans" / "shelf.xyz").write_text(f"x y z\n{TEXT}")
    path = folder / "site.yaml"
    path.write_text(f"clouds: {{shelf: {{file: scans/shelf.xyz{keys}}}}}")
    room, clouds = load_map_and_clouds(str(path), 0)
    (cloud,) = room.clouds
    assert (cloud.id, cloud.points) == ("shelf", 3)
    np.testing.assert_array_equal(cloud.low_m, clouds["shelf"].min(axis=0))
    np.testing.assert_array_equal(cloud.high_m, clouds["shelf"].max(axis=0))
    return clouds["shelf"]


def test_a_cloud_is_scaled_turned_and_moved(tmp_path: Path) -> None:
    points = placed(tmp_path, ", unit: 0.5, yaw_deg: 90, position: [1, 2, 3]")
    expected = np.column_stack([1 - POINTS[:, 1] / 2, 2 + POINTS[:, 0] / 2, 3 + POINTS[:, 2] / 2])
    np.testing.assert_allclose(points, expected, atol=1e-12)


def test_a_cloud_is_turned_upright_about_its_origin(tmp_path: Path) -> None:
    points = placed(tmp_path, ", up: y, origin: [0.5, -1.25, 2]")
    x, y, z = (POINTS - [0.5, -1.25, 2]).T
    np.testing.assert_allclose(points, np.column_stack([x, -z, y]), atol=1e-12)


@pytest.mark.parametrize("up", UP_AXES)
def test_declared_axis_points_up_without_mirroring(up: str) -> None:
    sign = -1.0 if up.startswith("-") else 1.0
    x, y, z = (sign * (axis == up[-1]) for axis in "xyz")
    assert rotate(UP_AXES[up], (x, y, z)) == pytest.approx((0.0, 0.0, 1.0), abs=1e-12)
    assert np.linalg.norm(UP_AXES[up]) == pytest.approx(1.0)


IMPLAUSIBLE = {
    "a room in kilometres": ("0 0 0\n.0042 .0031 .0026\n", "unit: km", "longest side is 0.0042 m"),
    "no finite extent": ("-1e308 0 0\n1e308 1 1\n", "unit: mm", "longest side is inf m"),
}  # fmt: skip


@pytest.mark.parametrize("name", IMPLAUSIBLE)
def test_implausible_cloud_is_refused_with_the_parameter_to_set(tmp_path: Path, name: str) -> None:
    content, parameter, problem = IMPLAUSIBLE[name]
    (tmp_path / "scan.xyz").write_text(f"x y z\n{content}")
    path = tmp_path / "room.yaml"
    path.write_text("clouds: {scan: {file: scan.xyz}}")
    with pytest.raises(ConfigError) as caught:
        load_map_and_clouds(str(path), 0)
    assert problem in str(caught.value)
    assert f"such as {parameter}" in str(caught.value)
    if name != "no finite extent":
        path.write_text(f"clouds: {{scan: {{file: scan.xyz, {parameter}}}}}")
        assert load_map_and_clouds(str(path), 0)[1]["scan"].shape == (2, 3)


def test_missing_cloud_is_reported_with_the_map_and_key(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text("clouds: {shelf: {file: shelf.ply}}")
    with pytest.raises(ConfigError, match=r"site\.yaml: clouds\.shelf\.file: .*shelf\.ply: cannot be read"):
        load_map_and_clouds(str(path), 0)


TABLES = {
    "a program that maps LEDs with a camera": (
        "index,x,y,z,xn,yn,zn,error\n" + "".join(f"{n},{n / 10},0,0,1,0,0,0.1\n" for n in (0, 1, 4, 5)),
        "pixel=index", None, [0, 1, 4, 5]),
    "nodes from 1, in millimetres": (
        "Node;X [mm];Y [mm];Z [mm]\n3;200;0;0\n1;0;0;0\n2;100;0;0\n",
        "pixel=Node,x=2/mm,y=3/mm,z=4/mm", 1, [0, 1, 2]),
    "centimetres": ("x,y,z\n0,0,0\n10,0,0\n20,0,0\n", "x=cm,y=cm,z=cm", None, [0, 1, 2]),
    "a row of units": ("x,y,z\nmm,mm,mm\n0,0,0\n100,0,0\n", "x=1/mm,y=2/mm,z=3/mm", None, [0, 1]),
    "no names": ("0,0,0\n.1,0,0\n", "x=1,y=2,z=3", None, [0, 1]),
    "the number first": ("1,.1,0,0\n0,0,0,0\n", "pixel=1,x=2,y=3,z=4", None, [0, 1]),
    "decimal commas and tabs": ("X\tY\tZ\n0\t0\t0\n0,1\t0\t0\n", "", None, [0, 1]),
    "numbers of each strip": (
        "x,y,z,strip,pixel\n0,0,0,a,0\n0.1,0,0,a,1\n0.3,0,0,a,3\n0.5,0,0,b,1\n0.4,0,0,b,0\n",
        "", None, [0, 1, 3, 4, 5]),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_other_programs_keep_their_numbers(name: str) -> None:
    text, columns, first, numbers = TABLES[name]
    found = lights(exchange.from_csv(text, no_note, parse_pixel_columns(columns), first))
    assert sorted(found) == numbers
    for number, point in found.items():
        np.testing.assert_allclose(point, [0.1 * number, 0, 0], atol=1e-3)


def table(numbers: dict[str, list[int]], header: str = "strip,pixel,x,y,z") -> str:
    """Return a table of strips one above the other, of which the pixels have these numbers."""
    lines = [header]
    for row, (name, each) in enumerate(numbers.items()):
        lines += [f"{name},{number},{(number - each[0]) / 10},0,{row}" for number in each]
    return "\n".join([*lines, ""])


OF_STRIPS: dict[str, tuple[dict[str, list[int]], int | None, dict[str, int]]] = {
    "begin again": ({"a": [0, 1], "b": [0, 1]}, None, {"a": 0, "b": 2}),
    "begin again from 1": ({"a": [1, 2, 3], "b": [1, 2]}, 1, {"a": 0, "b": 3}),
    "other lengths": ({"a": [0], "b": [0, 1, 2, 3], "c": [0, 1]}, None, {"a": 0, "b": 1, "c": 5}),
}


@pytest.mark.parametrize("name", OF_STRIPS)
def test_numbers_of_pixels_are_those_of_each_strip(name: str) -> None:
    numbers, first, firsts = OF_STRIPS[name]
    strips = exchange.from_csv(table(numbers), first=first)
    assert first_pixels(strips) == firsts
    assert {key: strip.pixels for key, strip in strips.items()} == {
        k: len(each) for k, each in numbers.items()
    }


def test_numbers_from_1_are_refused_until_the_first_is_declared() -> None:
    with pytest.raises(
        ConfigError, match="no pixel has the number 0; set first to 1 if they are numbered from 1"
    ):
        exchange.from_csv(table({"a": [1, 2, 3]}))
    assert sorted(lights(exchange.from_csv(table({"a": [1, 2, 3]}), first=0))) == [1, 2, 3]
    with pytest.raises(ConfigError, match="a pixel has the number 0; set first to 0"):
        exchange.from_csv(table({"a": [0, 1]}), first=1)


@pytest.mark.parametrize(
    "numbers",
    [{"a": [0, 1], "b": [2, 3]}, {"a": [0, 1], "b": [2, 3, 4]}, {"a": [0, 1], "b": [2, 3], "c": [0, 1]}],
)
def test_numbers_that_run_on_are_refused_until_they_are_declared(numbers: dict[str, list[int]]) -> None:
    with pytest.raises(
        ConfigError, match="; set columns to wire=pixel if they are those of the wire, or to pixel="
    ):
        exchange.from_csv(table(numbers))
    strips = exchange.from_csv(table(numbers), columns=parse_pixel_columns("pixel=pixel"))
    assert sorted(lights(strips))[:2] == [0, 1]


def test_numbers_of_the_wire_are_kept() -> None:
    numbers = {"b": [5, 6], "a": [0, 1, 2]}
    for header, columns in (("strip,wire,x,y,z", ""), ("strip,pixel,x,y,z", "wire=pixel")):
        strips = exchange.from_csv(table(numbers, header), columns=parse_pixel_columns(columns))
        assert first_pixels(strips) == {"b": 5, "a": 0}


def test_columns_that_are_not_used_are_reported() -> None:
    notes: list[str] = []
    exchange.from_csv("Universe,Channel,x,y,z\n1,1,0,0,0\n1,4,0.1,0,0\n", notes.append)
    assert notes == ["columns Universe, Channel are not used"]


def test_skipped_pixel_numbers_continue_across_strips() -> None:
    strips = exchange.from_csv(table({"a": [0, 2, 3, 4], "b": [1, 2, 4]}))
    assert sorted(lights(strips)) == [0, 2, 3, 4, 6, 7, 9]


def test_names_that_no_map_can_have_are_replaced_and_reported() -> None:
    notes: list[str] = []
    numbers = {"my strip/1": [0, 1], "Küche": [0, 1], "my_strip_1": [0, 1], "客厅": [0, 1], "-": [0, 1]}
    strips = exchange.from_csv(table(numbers), notes.append)
    assert list(strips) == ["my_strip_1_2", "Kuche", "my_strip_1", "strip_4", "strip_5"]
    assert list(parse_map_file(exchange.strips_text(strips).encode(), Path("x.yaml")).strips) == list(strips)
    assert notes == [
        f"strip {name!r} is called {new}, a name that a map can have"
        for name, new in zip(numbers, strips, strict=True)
        if name != new
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z,pixel\n0,0,0,0\n1,0,0,0\n", "line 3: pixel 0 is in line 2, too; correct one of them"),
        ("x,y,z,pixel\n0,0,0,0.5\n1,0,0,1\n", "has the number 0.5; write whole numbers"),
        ("a,b,c\n0,0,0\n1,0,0\n", "line 1 is 1 'a', 2 'b', 3 'c'; set columns to those of x, y and z"),
        ("0,0,0\n1,0,0\n", "line 1 is 1 '0', 2 '0', 3 '0'; set columns to .* such as x=1,y=2,z=3"),
        ("x [mm],y [mm],z [mm]\n0,0,0\n", r"1 'x \[mm\]', .* or x=1/cm if not metres"),
        ("x,y,z\nmm,mm,mm\n0,0,0\n", "line 2: 1 'mm', 2 'mm', 3 'mm' has no number for x, y, z; set columns"),
        ("x,y,z\n0,0,0\n1,b,0\n", "line 3: '1,b,0' is no pixel; write numbers"),
        ('"x","y","z"\n"1",0.1,2,3\n', "line 2: has 4 cells .*, and there are 3 columns; correct it, or set"),
    ],
)
def test_unintelligible_table_is_refused_with_the_remedy(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        exchange.from_csv(text)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("x", "columns: 'x' declares no column; write x, y, z, strip, pixel, wire each once"),
        ("w=1", "columns: 'w=1' declares no column"),
        ("x=1,x=2", "columns: 'x=2' declares no column"),
        ("x=1/parsec", "columns: 'x=1/parsec' has no known unit; write m, dm, .*, or its size in SI units"),
        ("x=1/-2", "has no known unit"),
    ],
)
def test_a_declaration_that_is_none_is_refused(columns: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_pixel_columns(columns)
