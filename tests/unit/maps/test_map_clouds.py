"""Point clouds: every format that is read, and ways to get one wrong."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry.rotation import rotate
from pointit.maps import cloud_file
from pointit.maps.cloud_file import read_points
from pointit.maps.file import load_map_and_clouds
from pointit.maps.units import UP_AXES
from pointit.runtime.errors import ConfigError

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
    rows["r"], rows["c"] = 255, 0.5
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
    "text.ply": (b"1 2 3\n", "does not begin with `ply`"),
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


def test_a_cloud_lies_beside_its_map_wherever_one_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir("/")
    np.testing.assert_array_equal(placed(tmp_path, ""), POINTS)


def test_a_cloud_is_scaled_turned_and_moved(tmp_path: Path) -> None:
    points = placed(tmp_path, ", unit: 0.5, yaw_deg: 90, position: [1, 2, 3]")
    expected = np.column_stack([1 - POINTS[:, 1] / 2, 2 + POINTS[:, 0] / 2, 3 + POINTS[:, 2] / 2])
    np.testing.assert_allclose(points, expected, atol=1e-12)


def test_a_cloud_is_turned_upright_about_its_origin(tmp_path: Path) -> None:
    points = placed(tmp_path, ", up: y, origin: [0.5, -1.25, 2]")
    x, y, z = (POINTS - [0.5, -1.25, 2]).T
    np.testing.assert_allclose(points, np.column_stack([x, -z, y]), atol=1e-12)


@pytest.mark.parametrize("up", UP_AXES)
def test_the_axis_that_is_declared_points_up_and_no_cloud_is_mirrored(up: str) -> None:
    sign = -1.0 if up.startswith("-") else 1.0
    x, y, z = (sign * (axis == up[-1]) for axis in "xyz")
    assert rotate(UP_AXES[up], (x, y, z)) == pytest.approx((0.0, 0.0, 1.0), abs=1e-12)
    assert np.linalg.norm(UP_AXES[up]) == pytest.approx(1.0)


IMPLAUSIBLE = {
    "a room in kilometres": ("0 0 0\n.0042 .0031 .0026\n", "unit: km", "longest side is 0.0042 m"),
    "no finite extent": ("-1e308 0 0\n1e308 1 1\n", "unit: mm", "longest side is inf m"),
}  # fmt: skip


@pytest.mark.parametrize("name", IMPLAUSIBLE)
def test_a_cloud_that_is_no_room_is_refused_with_the_parameter_that_describes_it(
    tmp_path: Path, name: str
) -> None:
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


def test_a_missing_cloud_is_said_with_the_map_and_the_key(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text("clouds: {shelf: {file: shelf.ply}}")
    with pytest.raises(ConfigError, match=r"site\.yaml: clouds\.shelf\.file: .*shelf\.ply: cannot be read"):
        load_map_and_clouds(str(path), 0)
