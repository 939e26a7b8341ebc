"""Clouds as other programs write them: each refusal names a parameter, and it works."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pointit.maps.file import load_map_and_clouds
from pointit.runtime.errors import ConfigError

ROOM = np.array([[0.25, 1.5, 2.0], [4.0, 0.75, 0.0], [3.5, 3.25, 0.5], [1.0, 5.0, 1.0]])
"""Points of a room, {W}."""
X, Y, Z = ROOM.T
Y_UP = np.column_stack([X, Z - 1.4, -Y])
"""The room in the frame of a phone that is held 1.4 m above the floor."""
Y_DOWN_MM = np.column_stack([X, 1.2 - Z, Y]) * 1000.0
"""The room in the optical frame of a camera that stands 1.2 m above the floor."""


def lines(
    points: np.ndarray, delimiter: str = ",", before: str = "", after: str = "", form: str = ".6g"
) -> str:
    return "".join(f"{before}{delimiter.join(f'{v:{form}}' for v in point)}{after}\n" for point in points)


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
        "Easting,Northing,Height\n" + lines(ROOM + np.array([386120, 5820345, 34.2]), form=".3f"),
        {"columns": {"x": "Easting", "y": "Northing", "z": "Height"}, "origin": [386120, 5820345, 34.2]},
    ),
    "cloudcompare.asc": (
        "//X Y Z R G B\n4\n" + lines(ROOM, " ", after=" 1 2 3"),
        {"columns": {"x": 1, "y": 2, "z": 3}},
    ),
    "livox_viewer.csv": (
        LIVOX + lines(ROOM, before="5,7,1,0,0,0,2,100,", after=",10,0,1000,2000,500,0,0,0"),
        {},
    ),
    "azure_kinect.ply": (
        binary_ply(Y_DOWN_MM, "unit: mm", RGBA, b"\0" * 4),
        {"unit": "mm", "up": "-y", "position": [0, 0, 1.2]},
    ),
    "pandas_index.csv": (
        ",x,y,z\n" + "".join(f"{n},{row}\n" for n, row in enumerate(lines(ROOM).split())),
        {},
    ),
    "paraview.csv": (
        '"Intensity","Points:0","Points:1","Points:2"\n' + lines(ROOM, before="7,"),
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
def test_a_cloud_is_read_right_or_refused_with_parameters_that_work(tmp_path: Path, name: str) -> None:
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


def test_a_shallow_scan_whose_axis_up_is_not_stated_is_refused_until_it_is(tmp_path: Path) -> None:
    shallow = np.column_stack([X, Z - 1.4, 0.4 * (Y - Y.mean())])
    (tmp_path / "scan.csv").write_text("x,y,z\n" + lines(shallow))
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
