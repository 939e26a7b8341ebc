"""Objects and who claims them, lamps, bays; what changes, what vanishes."""

import math
from typing import Any

import pytest

import pointit.schemas as models
from pointit.bridges.foxglove.scene import PARTS, Part
from pointit.geometry import vector
from pointit.schemas.environment import Bay, BayCount
from pointit.schemas.selection import ReservedObject, SelectedObject
from tests.integration.foxglove.protobuf import read
from tests.unit.foxglove.site_scene import SiteScene

ANNA = (0, 255, 0)
MAP = models.Environment(
    stamp_ns=1,
    name="lab",
    lamps=(models.Lamp(id="1", position_m=(1, 1, 1)),),
    belts=(models.Belt(id="b", line_m=((0, 0, 1), (0, 4, 1)), width_m=0.5),),
    strips=(models.Strip(id="s", line_m=((0, 0, 0), (1, 0, 0)), pixels=3),),
    bays=(Bay(id="3", belt="b"), Bay(id="4", belt="nowhere")),
)
PACKAGE = models.TrackedObject(
    id="7",
    kind="red",
    position_m=(0, 1, 1),
    length_m=0.4,
    surface="belt",
    surface_id="b",
    surface_position_m=1.0,
    bay="3",
)


def objects(*items: models.TrackedObject) -> models.TrackedObjects:
    return models.TrackedObjects(stamp_ns=1, objects=items)


def scene(*heard: tuple[models.Message, str]) -> SiteScene:
    made = SiteScene()
    made.take(MAP, "", 0.0)
    for message, name in heard:
        made.take(message, name, 0.0)
    return made


def shown(made: SiteScene, part: Part) -> dict[str, dict[str, Any]]:
    return {entity["id"]: entity for entity in read(made.draw(part, 5)).get("entities", [])}


def facts(entity: dict[str, Any]) -> dict[str, str]:
    return {pair["key"]: pair.get("value", "") for pair in entity["metadata"]}


def test_a_package_stands_on_its_belt_along_it() -> None:
    (entity,) = shown(scene((objects(PACKAGE), "plant")), "objects").values()
    (cube,) = entity["cubes"]
    assert cube["size"] == pytest.approx({"x": 0.4, "y": 0.75 * 0.4, "z": 0.6 * 0.4})
    assert cube["pose"]["position"] == pytest.approx({"y": 1.0, "z": 1.12})
    assert cube["pose"]["orientation"] == pytest.approx({"z": math.sqrt(0.5), "w": math.sqrt(0.5)})
    assert cube["color"] == pytest.approx({"r": 1.0, "g": 30 / 255, "a": 0.85})
    assert facts(entity) == {"id": "7", "kind": "red", "bay": "3"}
    assert "lines" not in entity


def test_owner_of_a_package_is_its_outline_and_label() -> None:
    chosen = SelectedObject(id="7", user="anna", since_ns=1, kind="red")
    made = scene(
        (objects(PACKAGE), "plant"),
        (models.UserProfile(stamp_ns=1, cursor_color=ANNA), "anna"),
        (models.Selection(stamp_ns=1, objects=(chosen,)), ""),
        (models.Hover(stamp_ns=1, object_id="7", progress=0.25, action="deselect"), "bert"),
    )
    (entity,) = shown(made, "objects").values()
    owner, hover = entity["lines"]

    assert owner["color"] == pytest.approx({"g": 1.0, "a": 1.0})
    assert owner["thickness"] > hover["thickness"]
    assert len(owner["points"]) == 24

    lengths = {round(length, 6) for length in edge_lengths(owner)}
    assert lengths == {0.42, 0.32, 0.26}
    assert entity["texts"][0]["text"] == "anna\nbert 25%"
    assert facts(entity)["selected by"] == "anna"
    assert facts(entity)["hovered by bert"] == "25% deselect"


def edge_lengths(line: dict[str, Any]) -> list[float]:
    places = [(p.get("x", 0.0), p.get("y", 0.0), p.get("z", 0.0)) for p in line["points"]]
    return [vector.norm(vector.subtract(a, b)) for a, b in zip(places[::2], places[1::2], strict=True)]


def test_reserved_package_has_an_outline_and_a_fact() -> None:
    reserved = models.Selection(stamp_ns=1, reserved=(ReservedObject(id="7", user="anna", until_ns=9),))
    (entity,) = shown(scene((objects(PACKAGE), "plant"), (reserved, "")), "objects").values()
    assert facts(entity)["reserved by"] == "anna"
    assert len(entity["lines"]) == 1


def test_tracked_robot_is_a_ball_with_velocity_and_name() -> None:
    robot = models.TrackedObject(id="r1", kind="robot", position_m=(1, 2, 3), velocity_mps=(0, 0, 2.0))
    (entity,) = shown(scene((objects(robot), "tracker")), "objects").values()
    assert entity["spheres"][0]["pose"]["position"] == {"x": 1, "y": 2, "z": 3}
    arrow = entity["arrows"][0]
    assert arrow["shaft_length"] + arrow["head_length"] == pytest.approx(2.0)
    assert entity["texts"][0]["text"] == "r1"


@pytest.mark.parametrize(
    "change", [{"surface_id": "gone"}, {"surface": "strip"}, {"surface_position_m": 1e12}]
)
def test_objects_on_unknown_lines_are_drawn(change: dict[str, Any]) -> None:
    odd = PACKAGE.model_copy(update=change)
    assert len(shown(scene((objects(odd), "plant")), "objects")) == 1


def test_two_trackers_may_use_the_same_name() -> None:
    assert len(shown(scene((objects(PACKAGE), "a"), (objects(PACKAGE), "b")), "objects")) == 2


def test_ended_objects_are_deleted() -> None:
    made = scene((objects(PACKAGE), "plant"))
    made.draw("objects", 5)
    made.take(objects(), "plant", 0.1)
    assert made.changed >= {"objects"}
    update = read(made.draw("objects", 6))
    assert [deletion["id"] for deletion in update["deletions"]] == ["plant 7"]
    assert "entities" not in update


def test_silent_rays_and_objects_are_removed() -> None:
    cursor = models.Cursor(
        stamp_ns=1, origin_m=(0, 0, 1), direction=(1, 0, 0), point_m=(1, 0, 1), range_m=1.0
    )
    made = scene(
        (objects(PACKAGE), "plant"), (cursor, "anna"), (models.Hover(stamp_ns=1, object_id="7"), "anna")
    )
    assert made.is_moving

    for part in PARTS:
        made.draw(part, 5)
    made.forget(0.9)
    assert not made.changed

    made.forget(1.1)
    assert made.changed == {"objects", "people"}
    assert not made.is_moving
    assert shown(made, "people") == shown(made, "objects") == {}


def test_a_new_map_replaces_the_old_one() -> None:
    made = scene((objects(PACKAGE), "plant"))
    for part in PARTS:
        made.draw(part, 5)
    assert not made.changed
    made.take(models.Environment(stamp_ns=2, name="empty"), "", 0.0)
    assert made.changed >= {"room", "pixels", "lamps", "bays", "objects"}
    room = read(made.draw("room", 6))
    assert room["deletions"][0]["type"] == 1
    assert "entities" not in room
    assert "data" not in read(made.draw("pixels", 6))
    assert [each["id"] for each in read(made.draw("lamps", 6))["deletions"]] == ["lamp 1"]


def test_lamps_show_their_colour_and_their_name() -> None:
    made = scene()
    lamp = shown(made, "lamps")["lamp 1"]
    assert lamp["texts"][0]["text"] == "1"
    dark = lamp["spheres"][0]["color"]
    assert dark["r"] == dark["g"] == dark["b"] < 0.25
    made.take(models.LampColor(stamp_ns=1, color=(255, 200, 0)), "1", 0.0)
    assert made.changed >= {"lamps"}
    assert shown(made, "lamps")["lamp 1"]["spheres"][0]["color"]["r"] == 1.0


def test_bays_show_counts_by_kind() -> None:
    counts = (BayCount(bay="3", kind="red", count=4, selected=3), BayCount(bay="9", kind="red", count=1))
    made = scene((models.ConveyorState(stamp_ns=1, speed_mps=0.5, bays=counts), ""))
    (entity,) = shown(made, "bays").values()
    assert entity["texts"][0]["text"] == "bay 3\nred: 4 (3 selected)"
    assert entity["texts"][0]["pose"]["position"] == pytest.approx({"y": 4.0, "z": 1.4})


def test_a_goal_is_an_arrow_that_the_robot_looks_along() -> None:
    goal = models.Goal(
        stamp_ns=1,
        position_m=(3.0, 2.0, 0.0),
        yaw_rad=math.pi / 2,
        age_s=0.0,
        position_sigma_m=0.1,
        clearance_m=2.0,
        proposed_ns=0,
        confirmed_by="again",
    )
    made = scene((models.UserProfile(stamp_ns=1, cursor_color=ANNA), "anna"))
    made.draw("people", 4)

    made.take(goal, "anna", 1.0)
    assert made.changed >= {"people"}
    entity = shown(made, "people")["goal anna"]
    (arrow,) = entity["arrows"]
    assert arrow["pose"]["position"] == pytest.approx({"x": 3.0, "y": 2.0, "z": 0.03})
    assert arrow["pose"]["orientation"] == pytest.approx({"z": math.sqrt(0.5), "w": math.sqrt(0.5)})
    assert arrow["shaft_length"] + arrow["head_length"] == pytest.approx(0.5)
    assert entity["texts"][0]["text"] == "goal of anna"
