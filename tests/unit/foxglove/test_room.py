"""The room and its people against known numbers, and any map that a message can hold."""

import json
import math
from typing import Any

import numpy as np
import pytest
from foxglove.messages import FrameTransforms, SceneUpdate
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.foxglove import people
from pointit.bridges.foxglove.people import DrawnPerson
from pointit.bridges.foxglove.room import SHARPEST, Lines, ribbon, room
from pointit.bridges.foxglove.scene import PARTS
from pointit.geometry import rotation, vector
from pointit.geometry.polyline import Polyline
from pointit.schemas import Belt, BodyMeasures, Cursor, Environment, Lamp, Strip, Thing, UserPose, UserProfile
from pointit.schemas.environment import Bay, Box, Cloud, Cylinder, Fence, Plane, Sphere
from tests.integration.foxglove.protobuf import read
from tests.unit.foxglove.site_scene import SiteScene

NOW_NS = 1_700_000_000_123_456_789


def drawn(environment: Environment) -> dict[str, dict[str, Any]]:
    found = room(environment, Lines(environment), NOW_NS)
    entities = read(SceneUpdate(entities=[each.entity for each in found])).get("entities", [])
    assert [each["id"] for each in entities] == [each.name for each in found]
    return {entity["id"]: entity for entity in entities}


def xyz(point: dict[str, float]) -> tuple[float, float, float]:
    return (point.get("x", 0.0), point.get("y", 0.0), point.get("z", 0.0))


def test_a_ribbon_keeps_its_width_around_a_corner() -> None:
    places, triangles = ribbon(Polyline([(0, 0, 0.5), (2, 0, 0.5), (2, 3, 0.5)]), 1.0)
    rims = [[0, 0.5], [0, -0.5], [1.5, 0.5], [2.5, -0.5], [1.5, 3], [2.5, 3]]
    assert places == pytest.approx(np.array([[x, y, 0.5] for x, y in rims]))
    assert triangles == [0, 1, 2, 2, 1, 3, 2, 3, 4, 4, 3, 5]


def test_ribbon_is_finite_when_it_turns_back_or_is_upright() -> None:
    back, _ = ribbon(Polyline([(0, 0, 0), (2, 0, 0), (0, 0, 0)]), 1.0)
    assert np.abs(back).max() <= 2.0
    up, _ = ribbon(Polyline([(0, 0, 0), (0, 2, 0), (0, 2, 2)]), 1.0)
    assert up[-2:] == pytest.approx(np.array([[-0.5, 2, 2], [0.5, 2, 2]]))


coordinate = st.floats(-1e6, 1e6)
near = st.floats(-5, 5)
vertices = st.lists(st.tuples(near, near, near) | st.tuples(*[coordinate] * 3), min_size=2, max_size=8)


@given(vertices, st.floats(1e-3, 1e6))
def test_no_corner_of_any_ribbon_is_far_out(line_m: list[tuple[float, float, float]], width_m: float) -> None:
    try:
        line = Polyline(line_m)
    except ValueError:
        return
    places, triangles = ribbon(line, width_m)
    assert np.all(np.isfinite(places))
    assert set(triangles) == set(range(len(places)))
    out_m = np.linalg.norm(places - np.repeat(line.vertices_m, 2, axis=0), axis=1)
    assert np.all(out_m <= width_m / 2.0 / SHARPEST * (1 + 1e-6) + 1e-9)
    assert np.all(out_m >= width_m / 2.0 * (1 - 1e-6) - 1e-9)


def test_every_kind_of_thing_is_drawn_where_it_is() -> None:
    shown = drawn(
        Environment(
            stamp_ns=1,
            name="all",
            lamps=(Lamp(id="l", position_m=(1, 2, 1.5)),),
            strips=(Strip(id="s", line_m=((0, 0, 0), (1, 0, 0)), pixels=3),),
            belts=(Belt(id="b", line_m=((0, 0, 1), (2, 0, 1)), width_m=0.4),),
            boxes=(Box(id="box", center_m=(1, 1, 1), size_m=(1, 2, 3), yaw_rad=math.pi / 2),),
            planes=(
                Plane(id="wall", center_m=(0, 3, 1), normal=(0, -1, 0), size_m=(4, 2)),
                Plane(id="floor", center_m=(0, 0, 0), normal=(0, 0, 1)),
            ),
            cylinders=(Cylinder(id="c", center_m=(5, 5, 0), radius_m=0.25, height_m=2),),
            spheres=(Sphere(id="ball", center_m=(1, 0, 2), radius_m=0.5),),
            things=(Thing(id="nuts", label="the nuts", center_m=(3, 3, 1), size_m=(1, 1, 0.4)),),
            clouds=(Cloud(id="scan", points=7, low_m=(0, 0, 0), high_m=(2, 2, 2)),),
        )
    )
    assert set(shown) == {
        *("belt b", "strips", "box box", "plane wall", "plane floor"),
        *("cylinder c", "sphere ball", "cloud scan", "pole l", "thing nuts"),
    }
    assert all(entity["frame_id"] == "world" for entity in shown.values())
    assert shown["belt b"]["timestamp"] == {"seconds": 1_700_000_000, "nanos": 123_456_789}

    (box,) = shown["box box"]["cubes"]
    assert xyz(box["size"]) == (1, 2, 3)
    assert box["pose"]["orientation"] == pytest.approx({"z": math.sqrt(0.5), "w": math.sqrt(0.5)})

    (name,) = shown["thing nuts"]["texts"]
    assert name["text"] == "the nuts"
    assert xyz(name["pose"]["position"]) == pytest.approx((3, 3, 1.29))

    corners = {xyz(point) for point in shown["plane wall"]["triangles"][0]["points"]}
    assert corners == {(-2, 3, 0), (2, 3, 0), (2, 3, 2), (-2, 3, 2)}
    (column,) = shown["cylinder c"]["cylinders"]
    assert xyz(column["pose"]["position"]) == (5, 5, 1)
    assert xyz(column["size"]) == (0.5, 0.5, 2)
    assert xyz(shown["sphere ball"]["spheres"][0]["size"]) == (1, 1, 1)
    assert len(shown["cloud scan"]["lines"][0]["points"]) == 24
    assert "7 points" in shown["cloud scan"]["texts"][0]["text"]
    assert xyz(shown["pole l"]["cylinders"][0]["pose"]["position"]) == (1, 2, 0.75)

    arrow = shown["belt b"]["arrows"][0]
    assert xyz(arrow["pose"]["position"]) == (1, 0, 1.01)
    assert arrow["shaft_length"] + arrow["head_length"] == pytest.approx(0.4)


def test_line_without_length_is_reported_and_others_are_drawn() -> None:
    dot = Strip(id="dot", line_m=((1, 1, 1), (1, 1, 1)), pixels=3)
    strip = Strip(id="s", line_m=((0, 0, 0), (1, 0, 0)), pixels=3)
    belt = Belt(id="b", line_m=((0, 0, 1), (2, 0, 1)))
    environment = Environment(stamp_ns=1, name="odd", strips=(dot, strip), belts=(belt,))
    lines = Lines(environment)
    assert lines.problems == [
        "strip 'dot' cannot be drawn (a line needs two different vertices); correct the map"
    ]
    assert set(lines.strips) == {"s"}
    assert "belt b" in drawn(environment)


places = st.tuples(coordinate, coordinate, coordinate)
sizes = st.floats(1e-6, 1e6)
names = st.sampled_from(["a", "b", "1"])
odd_maps = st.builds(
    Environment,
    stamp_ns=st.just(1),
    name=st.text(max_size=5),
    lamps=st.lists(st.builds(Lamp, id=names, position_m=places), max_size=2).map(tuple),
    strips=st.lists(
        st.builds(Strip, id=names, line_m=vertices.map(tuple), pixels=st.integers(1, 50)), max_size=3
    ).map(tuple),
    belts=st.lists(
        st.builds(Belt, id=names, line_m=vertices.map(tuple), width_m=st.floats(1e-6, 1e6)), max_size=3
    ).map(tuple),
    bays=st.lists(st.builds(Bay, id=names, belt=names), max_size=2).map(tuple),
    boxes=st.lists(
        st.builds(Box, id=names, center_m=places, size_m=st.tuples(sizes, sizes, sizes), yaw_rad=coordinate),
        max_size=2,
    ).map(tuple),
    planes=st.lists(
        st.builds(
            Plane,
            id=names,
            center_m=places,
            normal=st.sampled_from([(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.6, 0.0, 0.8)]),
            size_m=st.none() | st.tuples(sizes, sizes),
        ),
        max_size=2,
    ).map(tuple),
)


def test_fences_are_outlines_and_those_that_keep_out_have_sides() -> None:
    corners = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0))
    inside = Fence(id="room", kind="keep_in", outline_m=corners)
    outside = Fence(id="desk", kind="keep_out", outline_m=corners, low_m=-1.0, high_m=1.5)
    found = drawn(Environment(stamp_ns=0, name="lab", fences=(inside, outside)))
    assert "triangles" not in found["fence room"]
    assert [xyz(point)[:2] for point in found["fence room"]["lines"][0]["points"]] == list(corners)
    (sides,) = found["fence desk"]["triangles"]
    assert len(sides["indices"]) == 18
    assert {round(xyz(point)[2], 2) for point in sides["points"]} == {0.01, 1.5}, "none below the floor"


@given(odd_maps)
def test_any_map_can_be_shown(environment: Environment) -> None:
    scene = SiteScene()
    scene.take(environment, "", 0.0)
    for part in PARTS:
        assert_finite(read(scene.draw(part, NOW_NS)))


def assert_finite(value: Any) -> None:
    def refuse(number: str) -> None:
        raise AssertionError(f"holds {number}")

    text = json.dumps(value, default=lambda _bytes: None)
    json.loads(text, parse_constant=refuse)


BODY = BodyMeasures(neck_to_shoulder_m=0.2)
PROFILE = UserProfile(stamp_ns=1, body=BODY, cursor_color=(255, 0, 51))
EYES = (1.0, 2.0, 1.64)


def pose(covariance: tuple[float, ...] = (0.0,) * 9) -> UserPose:
    return UserPose.model_validate(
        {"stamp_ns": 1, "position_m": (1.0, 2.0, 0.0), "yaw_rad": math.pi / 2, "covariance": covariance}
    )


def shown(person: DrawnPerson) -> dict[str, dict[str, Any]]:
    drawn = people.entities("anna", person, 5)
    entities = read(SceneUpdate(entities=[each.entity for each in drawn])).get("entities", [])
    return {entity["id"]: entity for entity in entities}


def standing(covariance: tuple[float, ...] = (0.0,) * 9, cursor: Cursor | None = None) -> DrawnPerson:
    return DrawnPerson(profile=PROFILE, pose=pose(covariance), cursor=cursor)


def turn_of(primitive: dict[str, Any]) -> rotation.Quaternion:
    q = primitive["pose"]["orientation"]
    return (q.get("x", 0.0), q.get("y", 0.0), q.get("z", 0.0), q.get("w", 0.0))


def test_the_frame_of_the_feet() -> None:
    told = read(FrameTransforms(transforms=[people.transform("anna", pose(), 5)]))
    assert told["transforms"] == [
        {
            "timestamp": {"nanos": 5},
            "parent_frame_id": "world",
            "child_frame_id": "users/anna/feet",
            "translation": {"x": 1.0, "y": 2.0},
            "rotation": pytest.approx({"z": math.sqrt(0.5), "w": math.sqrt(0.5)}),
        }
    ]


@pytest.mark.parametrize("degrees", [10, 80, 100, 170])
def test_the_ellipse_lies_as_the_covariance_says(degrees: int) -> None:
    c = math.cos(math.radians(degrees))
    s = math.sin(math.radians(degrees))
    along = np.array([c, s])
    across = np.array([-s, c])
    (xx, xy), (yx, yy) = (0.04 * np.outer(along, along) + 0.01 * np.outer(across, across)).tolist()
    rim = people.ellipse(pose((xx, xy, 0, yx, yy, 0, 0, 0, 1)))
    assert rim is not None
    reach_m = np.linalg.norm(rim[:, :2] - (1.0, 2.0), axis=1)
    assert (reach_m.max(), reach_m.min()) == pytest.approx((0.4, 0.2), rel=0.01)
    away = rim[np.argmax(reach_m), :2] - (1.0, 2.0)
    assert abs(away @ across) < 0.03


def test_a_place_that_is_known_has_no_ellipse() -> None:
    assert people.ellipse(pose()) is None
    assert "lines" not in shown(standing())["person anna"]
    assert len(shown(standing((0.04, 0, 0, 0, 0.01, 0, 0, 0, 1)))["person anna"]["lines"]) == 1


value = st.floats(-1e12, 1e12)


@given(st.tuples(*[value] * 9))
def test_any_covariance_can_be_shown(covariance: tuple[float, ...]) -> None:
    rim = people.ellipse(pose(covariance))
    assert rim is None or np.all(np.isfinite(rim))


def test_the_finger_is_on_the_line_from_the_eyes() -> None:
    direction = vector.normalized((1.0, 1.0, -0.5))
    cursor = Cursor(stamp_ns=1, origin_m=EYES, direction=direction)
    body = shown(standing(cursor=cursor))["person anna"]
    arm = body["cylinders"][1]
    length_m = arm["size"]["z"]
    assert length_m == pytest.approx(BODY.shoulder_to_wrist_m + BODY.wrist_to_finger_m)

    middle = xyz(arm["pose"]["position"])
    half = rotation.rotate(turn_of(arm), (0.0, 0.0, length_m / 2.0))
    finger = vector.add(middle, half)
    shoulder = vector.subtract(middle, half)
    # a right shoulder, at a right angle to the arm, wherever the IMU's yaw began
    away = vector.subtract(shoulder, (1.0, 2.0, 1.43))
    along = vector.subtract(finger, shoulder)

    assert vector.rotate_z(away, math.pi / 2) == pytest.approx(
        vector.scale((along[0], along[1], 0.0), 0.2 / math.hypot(along[0], along[1]))
    )
    assert vector.angle_between(vector.subtract(finger, EYES), direction) < 1e-6


def test_person_without_a_cursor_has_no_arm_and_no_ray() -> None:
    body = shown(standing())
    assert set(body) == {"person anna"}
    assert len(body["person anna"]["cylinders"]) == 1
    assert xyz(body["person anna"]["spheres"][0]["pose"]["position"]) == pytest.approx(EYES)
    assert body["person anna"]["texts"][0]["text"] == "anna"
    assert body["person anna"]["spheres"][0]["color"] == pytest.approx({"r": 1.0, "b": 0.2, "a": 1.0})


def test_the_ray_ends_at_the_cursor() -> None:
    cursor = Cursor(
        stamp_ns=1,
        surface="strip",
        surface_id="s1",
        point_m=(1.0, 5.0, 1.64),
        range_m=3.0,
        origin_m=EYES,
        direction=(0.0, 1.0, 0.0),
    )
    seen = shown(DrawnPerson(profile=PROFILE, cursor=cursor))  # where they stand is not known
    assert set(seen) == {"ray anna", "cursor anna"}

    (arrow,) = seen["ray anna"]["arrows"]
    length_m = arrow["shaft_length"] + arrow["head_length"]
    tip = vector.add(xyz(arrow["pose"]["position"]), rotation.rotate(turn_of(arrow), (length_m, 0.0, 0.0)))
    assert tip == pytest.approx((1.0, 5.0, 1.64))
    assert xyz(seen["cursor anna"]["spheres"][0]["pose"]["position"]) == (1.0, 5.0, 1.64)
    assert {"key": "on", "value": "strip s1"} in seen["cursor anna"]["metadata"]


def test_a_ray_into_the_void_is_paler() -> None:
    cursor = Cursor(stamp_ns=1, origin_m=EYES, direction=(0.0, 1.0, 0.0))
    seen = shown(DrawnPerson(profile=PROFILE, cursor=cursor))
    assert set(seen) == {"ray anna"}
    assert seen["ray anna"]["arrows"][0]["color"]["a"] < 0.5
