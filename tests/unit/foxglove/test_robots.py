"""Robots in the scene: whose they are, where they are about to go, and what happens when they fall silent."""

from typing import Any

import pytest

from pointit import schemas
from pointit.bridges.foxglove.robots import FREE
from pointit.bridges.foxglove.scene import Part, Scene
from tests.integration.foxglove.protobuf import read

ANNA = (0, 255, 0)
QUAD = schemas.RobotState(
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
PLAN = schemas.RobotPlan(stamp_ns=1, line_m=((2.0, 2.0, 0.5), (3.0, 2.0, 0.2)), user="anna")


def scene(*heard: tuple[schemas.Message, str]) -> Scene:
    made = Scene({}, 1.0)
    for message, name in ((schemas.UserProfile(stamp_ns=1, cursor_color=ANNA), "anna"), *heard):
        made.take(message, name, 0.0)
    return made


def shown(made: Scene, part: Part = "robots") -> dict[str, dict[str, Any]]:
    return {entity["id"]: entity for entity in read(made.draw(part, 5)).get("entities", [])}


def test_a_robot_has_the_colour_of_who_steers_it_and_what_is_left_of_its_way() -> None:
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


def test_a_robot_that_stands_free_is_grey_and_has_no_way() -> None:
    free = QUAD.model_copy(
        update={"kind": "ground", "user": "", "target_m": None, "position_m": (1.0, 2.0, 0.0)}
    )
    entity = shown(scene((free, "cart"), (schemas.RobotPlan(stamp_ns=1), "cart")))["robot cart"]
    assert entity["arrows"][0]["color"]["r"] == pytest.approx(FREE[0] / 255.0)
    assert len(entity["lines"]) == 1
    assert len(entity["cylinders"]) == 1


def test_a_robot_is_not_drawn_once_more_as_a_tracked_object() -> None:
    things = tuple(
        schemas.TrackedObject(id=name, kind="robot", position_m=(x_m, 2.0, 0.0))
        for name, x_m in (("quad", 1.0), ("other", 3.0))
    )
    made = scene((schemas.TrackedObjects(stamp_ns=1, objects=things), "robot.quad"), (QUAD, "quad"))
    assert set(shown(made, "objects")) == {"robot.quad other"}


def test_a_robot_that_is_silent_goes_and_comes_back_with_its_plan() -> None:
    made = scene((QUAD, "quad"), (PLAN, "quad"))
    made.forget(5.0)
    assert shown(made) == {}
    made.take(QUAD, "quad", 6.0)
    assert any(len(line["points"]) == 3 for line in shown(made)["robot quad"]["lines"])


def test_way_points_are_numbered_until_they_are_sent_or_the_person_leaves() -> None:
    made = scene((schemas.Steering(stamp_ns=1, waypoints_m=((0, 0, 0), (1, 0, 0))), "anna"))
    assert [text["text"] for text in shown(made)["way-points anna"]["texts"]] == ["1", "2"]
    made.take(schemas.Steering(stamp_ns=2), "anna", 0.0)
    assert shown(made) == {}
    made.take(schemas.Steering(stamp_ns=3, waypoints_m=((0, 0, 0),)), "anna", 0.0)
    made.leave("anna")
    assert shown(made) == {}
