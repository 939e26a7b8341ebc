"""The LEDs as points: where, in which colour."""

from typing import Any

import numpy as np
import pytest

from pointit.bridges.foxglove.pixels import FLOOR, Pixels
from pointit.bridges.foxglove.room import Lines
from pointit.schemas import Environment, Strip, StripsFrame
from pointit.schemas.environment import StripFrame
from tests.integration.foxglove.protobuf import read

MAP = Environment(
    stamp_ns=1,
    name="two",
    strips=(
        Strip(id="a", line_m=((0, 0, 1), (1, 0, 1)), pixels=2),
        Strip(id="b", line_m=((0, 0, 0), (0, 2, 0), (0, 2, 2)), pixels=4, direction=-1),
    ),
)


def frame(**strips: bytes) -> StripsFrame:
    return StripsFrame(stamp_ns=1, strips=tuple(StripFrame(id=name, rgb=rgb) for name, rgb in strips.items()))


def cloud(*frames: StripsFrame) -> np.ndarray[Any, Any]:
    pixels = Pixels(Lines(MAP).strips)
    for each in frames:
        pixels.light(each)
    told = read(pixels.cloud(5))
    kinds = {7: "<f4", 1: "u1"}
    layout = np.dtype(
        {
            "names": [field["name"] for field in told["fields"]],
            "formats": [kinds[field["type"]] for field in told["fields"]],
            "offsets": [field.get("offset", 0) for field in told["fields"]],
            "itemsize": told["point_stride"],
        }
    )
    assert told["frame_id"] == "world"
    return np.frombuffer(told["data"], dtype=layout)


def colors(points: np.ndarray[Any, Any]) -> list[tuple[int, ...]]:
    return [tuple(int(point[name]) for name in ("red", "green", "blue", "alpha")) for point in points]


def test_pixels_lie_in_the_middle_of_equal_parts_the_first_where_the_wire_begins() -> None:
    points = cloud()
    places = np.column_stack([points["x"], points["y"], points["z"]])
    assert places == pytest.approx(
        np.array([[0.25, 0, 1], [0.75, 0, 1], [0, 2, 1.5], [0, 2, 0.5], [0, 1.5, 0], [0, 0.5, 0]])
    )
    assert colors(points) == [(FLOOR, FLOOR, FLOOR, 255)] * 6


def test_colours_are_as_sent_and_off_is_grey() -> None:
    points = cloud(frame(a=bytes((255, 100, 0, 0, 0, 0))))
    assert colors(points)[:3] == [(255, 100, FLOOR, 255), (FLOOR, FLOOR, FLOOR, 255), (FLOOR,) * 3 + (255,)]


@pytest.mark.parametrize("odd", [frame(z=b"\xff" * 6), frame(a=b"\xff" * 9), frame(a=b"\xff"), frame()])
def test_strips_that_do_not_fit_the_map_are_left_out(odd: StripsFrame) -> None:
    before = frame(a=bytes((1, 2, 250, 9, 200, 9)))
    assert colors(cloud(before, odd)) == colors(cloud(before))
