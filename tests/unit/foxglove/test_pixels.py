"""LEDs as points, and robots in the scene."""

from typing import Any

import numpy as np
import pytest

import pointit.schemas as models
from pointit.bridges.foxglove.pixels import FLOOR, Pixels
from pointit.bridges.foxglove.robots import FREE
from pointit.bridges.foxglove.room import Lines
from pointit.bridges.foxglove.scene import Part
from pointit.schemas import Environment, Strip, StripsFrame, topics
from pointit.schemas.environment import StripFrame
from tests.integration.foxglove.protobuf import read
from tests.unit.foxglove.site_scene import SiteScene

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


def test_pixels_lie_in_the_middle_of_equal_parts_of_strips() -> None:
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


ANNA = (0, 255, 0)
QUAD = models.RobotState(
    stamp_ns=1,
    kind="quadrotor",
    phase="moving",
    position_m=(1.0, 2.0, 0.8),
    yaw_rad=0.0,
    velocity_mps=(0.0, 0.0, 0.0),
    radius_m=0.2,
    user="anna",
    target_m=(3.0, 2.0, 0.2),
    reason="the fence is in the way",
    battery=0.5,
)
PLAN = models.RobotPlan(stamp_ns=1, line_m=((2.0, 2.0, 0.5), (3.0, 2.0, 0.2)), user="anna")


def scene(*heard: tuple[models.Message, str]) -> SiteScene:
    made = SiteScene()
    for message, name in ((models.UserProfile(stamp_ns=1, cursor_color=ANNA), "anna"), *heard):
        made.take(message, name, 0.0)
    return made


def shown(made: SiteScene, part: Part = "robots") -> dict[str, dict[str, Any]]:
    return {entity["id"]: entity for entity in read(made.draw(part, 5)).get("entities", [])}


def test_robot_has_the_colour_of_its_user_and_its_plan() -> None:
    entity = shown(scene((QUAD, "quad"), (PLAN, "quad")))["robot quad"]
    assert entity["arrows"][0]["color"] == pytest.approx({"g": 1.0, "a": 1.0})
    assert entity["texts"][0]["text"] == "quad\nanna moving"
    ways = [line["points"] for line in entity["lines"] if len(line["points"]) == 3]
    assert [[point["x"] for point in way] for way in ways] == [[1.0, 2.0, 3.0]]
    facts = {pair["key"]: pair.get("value", "") for pair in entity["metadata"]}
    assert facts == {
        "robot": "quad",
        "steered by": "anna",
        "phase": "moving",
        "reason": "the fence is in the way",
        "battery": "50%",
    }


def test_robot_without_a_user_is_grey_without_a_plan() -> None:
    free = QUAD.model_copy(
        update={"kind": "ground", "user": "", "target_m": None, "position_m": (1.0, 2.0, 0.0)}
    )
    entity = shown(scene((free, "cart"), (models.RobotPlan(stamp_ns=1), "cart")))["robot cart"]
    assert entity["arrows"][0]["color"]["r"] == pytest.approx(FREE[0] / 255.0)
    assert len(entity["lines"]) == 1
    assert len(entity["cylinders"]) == 1


def test_robot_is_not_drawn_twice_as_a_tracked_object() -> None:
    things = tuple(
        models.TrackedObject(id=name, kind="robot", position_m=(x_m, 2.0, 0.0))
        for name, x_m in (("quad", 1.0), ("other", 3.0))
    )
    made = scene((models.TrackedObjects(stamp_ns=1, objects=things), "robot.quad"), (QUAD, "quad"))
    assert set(shown(made, "objects")) == {"robot.quad other"}


def test_silent_robot_is_removed_and_returns_with_its_plan() -> None:
    made = scene((QUAD, "quad"), (PLAN, "quad"))
    made.forget(5.0)
    assert shown(made) == {}
    made.take(QUAD, "quad", 6.0)
    assert any(len(line["points"]) == 3 for line in shown(made)["robot quad"]["lines"])


def test_way_points_are_numbered_until_sent_or_departure() -> None:
    made = scene((models.Steering(stamp_ns=1, waypoints_m=((0, 0, 0), (1, 0, 0))), "anna"))
    assert [text["text"] for text in shown(made)["way-points anna"]["texts"]] == ["1", "2"]
    made.take(models.Steering(stamp_ns=2), "anna", 0.0)
    assert shown(made) == {}
    made.take(models.Steering(stamp_ns=3, waypoints_m=((0, 0, 0),)), "anna", 0.0)
    made.site.forget(topics.STEERING, "anna")
    assert shown(made) == {}
