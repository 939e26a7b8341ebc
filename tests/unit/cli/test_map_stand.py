"""`pointit map point --origin`: a person stands at the origin of a scanned map and points at its lights."""

import asyncio
import math
import re
from pathlib import Path

import numpy as np
import pytest

from pointit.cli.maps import point
from pointit.cli.maps.point import PointingSession, stand_at
from pointit.geometry.vector import Vec3, direction, rotate_z, subtract
from pointit.maps.file import load_map
from pointit.runtime.errors import RefusedError
from pointit.schemas import ButtonEvent, PointingRay
from pointit.schemas.topics import BUTTON, RAY
from tests.support.bench import memory_bench

STOOD: Vec3 = (0.3, -0.5, -0.4)
EYES: Vec3 = (0.0, 0.0, 1.6)
YAW_RAD = 0.7
ROOM = """\
# Origin of the scan: at the height of the lowest light, below the first LED of shelf.
# A room scanned from 3 photographs.
lamps:
  "door": {position: [-1.4, 1.6, 0.1]}  # within 2 mm (1 sigma)
strips:
  "shelf":  # within 3 mm (1 sigma)
    line: [[-0.9, 2.0, 0.75], [0.6, 2.0, 0.75]]
    pixels: 90
  "desk":
    line: [[1.5, 0.7, 0.34], [0.5, 1.0, 0.32]]
    pixels: 63
boxes:
  "crate": {center: [1.0, 1.0, 0.5], size: [0.4, 0.3, 0.2], yaw_deg: 10.0}
planes:
  "front": {center: [0.0, 2.0, 1.0], normal: [0.0, -1.0, 0.0], size: [2.0, 1.0]}
"""


def rays_at(end_m: Vec3, rng: np.random.Generator, begin_ns: int) -> list[PointingRay]:
    """Return rays of a person at `STOOD`, {H}, with the errors of a hold."""
    x, y, z = rotate_z(subtract(subtract(end_m, STOOD), EYES), -YAW_RAD)
    off = rng.normal(0.0, math.radians(1.5), 2)
    held = direction(math.atan2(y, x) + off[0], math.atan2(z, math.hypot(x, y)) + off[1])
    return [PointingRay(stamp_ns=begin_ns + 20_000_000 * n, origin_m=EYES, direction=held) for n in range(25)]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "room.yaml"
    path.write_text(ROOM)
    return path


@pytest.mark.parametrize("floor_m", [STOOD[2], None])
async def test_two_ends_from_one_place_give_origin_and_heading(file: Path, floor_m: float | None) -> None:
    content, room = point.read(file)
    ends = point.ends_in(room, ["door", "desk:first"] if floor_m else ["door", "desk:first", "shelf:last"])
    told: list[str] = []
    rng = np.random.default_rng(3)
    async with memory_bench() as bench:

        def obey(text: str) -> None:
            told.append(text)
            if found := re.search(r"point at (\S+) and press", text):
                loop = asyncio.get_running_loop()
                for n, ray in enumerate(rays_at(ends[found[1]], rng, len(told) * 1_000_000_000), 1):
                    loop.call_later(0.01 * n, bench.put, RAY, ray, "anna")
                loop.call_later(0.5, bench.put, BUTTON, ButtonEvent(stamp_ns=len(told)), "anna")

        session = PointingSession(bench.bus, "anna", obey)
        text, code = await stand_at(file, content, ends, floor_m)(session)

    assert code == 0
    there = file.with_name("placed.yaml")
    there.write_text(text)
    before = load_map(str(file), 0)
    after = load_map(str(there), 0)
    door = after.lamps[0].position_m
    assert abs(math.atan2(door[1], door[0])) < 1e-3, "x points towards it"
    assert math.dist(door, (0, 0, 0)) == pytest.approx(math.dist(before.lamps[0].position_m, STOOD), abs=0.3)
    for old, new in zip(before.strips, after.strips, strict=True):
        assert math.dist(new.line_m[0], door) == pytest.approx(
            math.dist(old.line_m[0], before.lamps[0].position_m), abs=2e-3
        )

    turned = after.boxes[0].yaw_rad - before.boxes[0].yaw_rad
    assert rotate_z((0.0, -1.0, 0.0), turned) == pytest.approx(after.planes[0].normal, abs=2e-3)
    assert text.count("(1 sigma)") == 3
    assert "# A room scanned from 3 photographs." in text
    assert "below the first LED" not in text


def test_ends_are_those_of_the_first_and_last_pixel(file: Path) -> None:
    _, room = point.read(file)
    ends = point.ends_in(room, ["shelf:first", "shelf:last"])
    assert ends["shelf:first"] == pytest.approx((-0.9 + 1.5 / 180, 2.0, 0.75))
    assert ends["shelf:last"] == pytest.approx((0.6 - 1.5 / 180, 2.0, 0.75))
    with pytest.raises(RefusedError, match="there is no 'shelf' in the map; there are door, shelf:first"):
        point.ends_in(room, ["shelf"])


def test_ends_that_do_not_determine_the_standpoint_are_refused(file: Path) -> None:
    _, room = point.read(file)
    ends = point.ends_in(room, ["shelf:first", "shelf:last"])
    rng = np.random.default_rng(1)
    rays = {name: rays_at(end, rng, n * 1_000_000_000) for n, (name, end) in enumerate(ends.items())}
    with pytest.raises(RefusedError, match="one more target, below the waist or far to the side"):
        point.poses_of(rays, ends, STOOD[2])


def test_a_map_with_more_than_a_scan_finds_is_refused(file: Path) -> None:
    file.write_text("cylinders: {post: {center: [0, 0, 0], radius: 0.1, height: 2}}")
    with pytest.raises(RefusedError, match="only lamps, strips, boxes and planes"):
        point.read(file)
