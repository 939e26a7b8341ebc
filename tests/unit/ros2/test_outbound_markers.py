"""The scene, the map, robots, plans, way-points and fences, drawn."""

import math
from typing import Any

import numpy as np
import pytest

import pointit.schemas as models
from pointit.bridges.ros2.outbound.markers import (
    ADD,
    DELETE,
    DELETE_ALL,
    HALTED,
    MAX_MARKERS,
    MAX_OBJECTS,
    ellipse,
    ribbon,
)
from pointit.bridges.ros2.routing.routes import Routes, routes
from pointit.geometry import rotation, vector
from pointit.geometry.polyline import Polyline
from pointit.schemas.environment import Fence
from tests.unit.ros2.scenes import CURSOR, NOW_NS, POSE, ROOM, furnished, objects, out, package, sent, turned


@pytest.fixture
def table() -> Routes:
    return routes()


def keys(value: Any, action: int = ADD) -> set[tuple[str, int]]:
    return {(marker.ns, marker.id) for marker in value.markers if marker.action == action}


def test_markers_show_the_scene_and_take_away_what_is_gone(table: Routes) -> None:
    scene, row = furnished(), out(table, "markers")
    scene.take("user1", POSE, NOW_NS)
    selection = models.Selection(
        stamp_ns=NOW_NS, objects=(models.SelectedObject(id="19-2", user="user1", since_ns=0),)
    )
    scene.take("", selection, NOW_NS)
    scene.take("conveyor", objects(package(1), package(2)), NOW_NS)
    (value,) = sent(row, CURSOR, scene)
    assert keys(value) == {
        *(("user1/name", 0), ("user1/place", 0), ("user1/ray", 0), ("user1/cursor", 0), ("objects", 1)),
        *(("objects", 2), ("selected", 2)),
    }
    assert not keys(value, DELETE)
    ray = next(marker for marker in value.markers if marker.ns == "user1/ray")
    assert [(point.x, point.y, point.z) for point in ray.points] == [(0.0, 0.5, 2.0), (0.0, 0.5, 0.0)]
    assert ray.lifetime.sec == 2
    red = next(marker for marker in value.markers if marker.ns == "objects" and marker.id == 1)
    assert red.color.r == 1.0
    scene.take("conveyor", objects(package(2)), NOW_NS)
    (value,) = sent(row, models.Interaction(stamp_ns=NOW_NS, state="idle"), scene)
    assert keys(value) == {("user1/name", 0), ("user1/place", 0), ("objects", 2), ("selected", 2)}
    assert keys(value, DELETE) == {("user1/ray", 0), ("user1/cursor", 0), ("objects", 1)}
    (value,) = sent(row, models.Interaction(stamp_ns=NOW_NS, state="idle"), scene)
    assert not keys(value, DELETE)


def test_markers_are_bounded_and_say_so(table: Routes) -> None:
    many, scene = objects(*(package(number) for number in range(MAX_OBJECTS + 3))), furnished()
    (value,) = sent(out(table, "markers"), many, scene, "conveyor")
    assert len(value.markers) == MAX_OBJECTS + 1
    assert value.markers[-1].text.startswith("3 more")
    lamps = tuple(ROOM.lamps[0].model_copy(update={"id": f"l{n}"}) for n in range(MAX_MARKERS))
    (value,) = sent(out(table, "map_markers"), ROOM.model_copy(update={"lamps": lamps}), furnished(), "")
    assert len(value.markers) == MAX_MARKERS + 2
    assert str(MAX_MARKERS) in value.markers[-1].text


def test_the_ellipse_has_the_axes_of_the_covariance() -> None:
    found = ellipse(POSE)
    assert found is not None
    assert found[:2] == pytest.approx((0.4, 0.2))
    assert abs(math.cos(found[2])) == pytest.approx(1.0)
    assert ellipse(POSE.model_copy(update={"covariance": (0.0,) * 9})) is None


def test_the_map_replaces_what_was_drawn_before(table: Routes) -> None:
    room = ROOM.model_copy(
        update={
            "boxes": (models.Box(id="b", center_m=(1.0, 1.0, 1.0), size_m=(1.0, 2.0, 3.0)),),
            "things": (
                models.Thing(id="nuts", center_m=(1.0, 1.0, 1.0), size_m=(1.0, 2.0, 3.0)),
                models.Thing(id="agv", center_m=(0, 0, 0), size_m=(1, 1, 1), is_tracked=True),
            ),
            "planes": (
                models.Plane(id="p", center_m=(0.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0), size_m=(2.0, 4.0)),
            ),
        }
    )
    (value,) = sent(out(table, "map_markers"), room, furnished(), "")
    assert value.markers[0].action == DELETE_ALL
    assert keys(value) == {
        *(("belts", number) for number in (0, 1)),
        *((group, 0) for group in ("lamps", "lamps/names", "boxes", "things/names", "planes")),
        *(("boxes", 1), ("strips", 2)),
    }
    assert [marker.text for marker in value.markers if marker.ns == "things/names"] == ["nuts"]
    plane = next(marker for marker in value.markers if marker.ns == "planes")
    normal = rotation.rotate(turned(plane.pose.orientation), (0.0, 0.0, 1.0))
    assert abs(vector.dot(normal, (1.0, 0.0, 0.0))) == pytest.approx(1.0)
    assert (plane.scale.x, plane.scale.y) == (2.0, 4.0)
    empty = models.Environment(stamp_ns=NOW_NS, name="empty")
    (value,) = sent(out(table, "map_markers"), empty, furnished(), "")
    assert [marker.action for marker in value.markers] == [DELETE_ALL]


def test_a_ribbon_is_as_wide_as_its_belt_and_seen_from_both_sides() -> None:
    corners = np.array(ribbon(Polyline(((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 0.0, 1.0))), 0.5))
    assert len(corners) == 12  # what goes straight up has no width
    assert (corners[:, 1].min(), corners[:, 1].max()) == (-0.25, 0.25)
    up = [np.cross(b - a, c - a)[2] for a, b, c in corners.reshape(-1, 3, 3)]
    assert sorted(np.sign(up).tolist()) == [-1.0, -1.0, 1.0, 1.0]


STATE = models.RobotState(
    stamp_ns=NOW_NS,
    kind="quadrotor",
    phase="moving",
    position_m=(1.0, 2.0, 1.5),
    yaw_rad=0.0,
    velocity_mps=(0.0, 0.0, 0.0),
    position_sigma_m=0.1,
    radius_m=0.2,
    user="user1",
    target_m=(3.0, 2.0, 1.5),
)


def test_a_robot_is_drawn_with_its_plan_in_the_colour_of_who_steers_it() -> None:
    scene, row = furnished(), out(routes(), "markers")
    scene.take("user1", models.UserProfile(stamp_ns=NOW_NS, cursor_color=(0, 0, 255)), NOW_NS)
    scene.take(
        "user1", models.Steering(stamp_ns=NOW_NS, waypoints_m=((2.0, 0.0, 0.0), (3.0, 0.0, 0.0))), NOW_NS
    )
    robot = models.TrackedObject(id="quad", kind="quadrotor", position_m=(1.0, 2.0, 1.5))
    scene.take("quad", objects(robot), NOW_NS)
    scene.take("quad", STATE, NOW_NS)
    (value,) = sent(
        row, models.RobotPlan(stamp_ns=NOW_NS, line_m=((3.0, 2.0, 1.5),), user="user1"), scene, "quad"
    )
    drawn = {(marker.ns, marker.id): marker for marker in value.markers if marker.action == ADD}
    assert set(drawn) == {
        *(("robot quad", 0), ("robot quad/front", 0), ("robot quad/name", 0), ("robot quad/place", 0)),
        *(("robot quad/plan", 0), ("robot quad/target", 0), ("user1/waypoints", 0)),
        ("user1/waypoints", 1),
    }
    body, plan = drawn["robot quad", 0], drawn["robot quad/plan", 0]
    assert (body.color.r, body.color.b, body.scale.x) == (0.0, 1.0, 0.4)
    assert [(point.x, point.y, point.z) for point in plan.points] == [(1.0, 2.0, 1.5), (3.0, 2.0, 1.5)]
    assert drawn["robot quad/name", 0].text == "quad: moving, user1"


def test_a_stopped_robot_is_red_and_a_silent_one_is_gone() -> None:
    scene, row = furnished(), out(routes(), "markers")
    (value,) = sent(row, STATE.model_copy(update={"phase": "stopped", "user": ""}), scene, "quad")
    body = next(marker for marker in value.markers if marker.ns == "robot quad")
    assert (body.color.r, body.color.g) == pytest.approx((HALTED[0] / 255.0, HALTED[1] / 255.0))
    scene.now_ns += 2 * 10**9
    (value,) = sent(row, objects(), scene, "conveyor")
    assert not [marker for marker in value.markers if marker.action == ADD]


def test_fences_are_outlines_at_their_heights() -> None:
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    fences = (
        Fence(id="hall", kind="keep_in", outline_m=corners),
        Fence(id="desk", kind="keep_out", outline_m=corners, low_m=0.5, high_m=2.0),
    )
    scene, row = furnished(), out(routes(), "map_markers")
    (value,) = sent(row, ROOM.model_copy(update={"fences": fences}), scene, "")
    drawn = {(marker.ns, marker.id): marker for marker in value.markers if marker.ns.startswith("fences")}
    assert set(drawn) == {
        ("fences/keep_in/0", 0),
        ("fences/keep_out/0", 1),
        ("fences/keep_out/1", 1),
        ("fences/names", 0),
        ("fences/names", 1),
    }
    top = drawn["fences/keep_out/1", 1]
    closed = [(x, y, 2.0) for x, y in (*corners, corners[0])]
    assert [(point.x, point.y, point.z) for point in top.points] == closed
