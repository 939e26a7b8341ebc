"""Frames of a map align trackers with the room."""

import math
from pathlib import Path

import pytest

from pointit.maps.file import read_map_file
from pointit.maps.frames import aligned, frame_of, frame_or_problem, point_in_world
from pointit.runtime.errors import ConfigError
from pointit.schemas import TrackedObject
from tests.unit.maps.test_map_names import room_of

MAP = """
lamps:
  lamp: {position: [1, 2, 3]}
frames:
  optitrack: {position: [1.5, 0.8, 0.2], yaw_deg: 90}
  slam: {orientation: [0, 0, 2, 0]}
"""


def test_objects_of_a_frame_are_turned_and_moved_into_the_room(tmp_path: Path) -> None:
    frame = frame_of(room_of(MAP, tmp_path), "optitrack")
    cup = TrackedObject(
        id="cup",
        kind="red",
        position_m=(1.0, 0.0, 0.5),
        velocity_mps=(0.0, 1.0, 0.0),
        yaw_rad=0.1,
        length_m=0.2,
    )
    (seen,) = aligned([cup, cup], frame)[1:]
    assert seen.position_m == pytest.approx((1.5, 1.8, 0.7))
    assert seen.velocity_mps == pytest.approx((-1.0, 0.0, 0.0))
    assert seen.yaw_rad == pytest.approx(0.1 + math.pi / 2)
    assert (seen.id, seen.kind, seen.length_m) == ("cup", "red", 0.2)
    turned = frame_of(room_of(MAP, tmp_path), "slam")
    assert point_in_world((1.0, 2.0, 3.0), turned) == pytest.approx((-1.0, -2.0, 3.0))


def test_an_unknown_frame_is_told_with_the_known_ones(tmp_path: Path) -> None:
    site, bare = room_of(MAP, tmp_path), room_of("lamps: {lamp: {position: [1, 2, 3]}}", tmp_path)
    with pytest.raises(
        ConfigError, match=r"has no frame 'optitrak'; it has optitrack, slam: did you mean optit"
    ):
        frame_of(site, "optitrak")
    assert frame_or_problem(site, "slam") == (frame_of(site, "slam"), "")
    frame, problem = frame_or_problem(bare, "camera")
    assert frame is None
    assert problem.startswith("the map room has no frame 'camera': add it to the map's frames")


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{yaw_deg: 90, orientation: [0, 0, 0, 1]}", "has both yaw_deg and orientation; keep one of them"),
        ("{orientation: [0, 0, 0, 0]}", r"a rotation is a quaternion \[x, y, z, w\] that is not zero"),
    ],
)
def test_a_wrong_frame_is_told_with_file_key_and_remedy(tmp_path: Path, entry: str, message: str) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(
        f"lamps: {{lamp: {{position: [1, 2, 3]}}}}\nframes: {{optitrack: {entry}}}\n", encoding="utf-8"
    )
    with pytest.raises(ConfigError, match=rf"site\.yaml: frames\.optitrack.*{message}"):
        read_map_file(path)
