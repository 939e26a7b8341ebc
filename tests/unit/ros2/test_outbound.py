"""Our messages as ROS reads them, and the scene drawn."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pointit.schemas as models
from pointit.bridges.ros2.graph.backend import Qos
from pointit.bridges.ros2.outbound.markers import (
    ADD,
    DELETE,
    DELETE_ALL,
    HALTED,
    MAX_OBJECTS,
    ellipse,
    ribbon,
)
from pointit.bridges.ros2.outbound.values import LAST_S, MAX_TEXT
from pointit.bridges.ros2.routing.conversion_state import MAX_TRACKER_AGE_NS
from pointit.bridges.ros2.routing.routes import Routes, routes
from pointit.geometry import rotation, vector
from pointit.geometry.polyline import Polyline
from pointit.runtime.clock import WallClock
from pointit.schemas.environment import Fence
from pointit.schemas.topics import TOPICS
from tests.unit.ros2.scenes import (
    CURSOR,
    NOW_NS,
    POSE,
    ROOM,
    furnished,
    jazzy,
    objects,
    out,
    package,
    sent,
    turned,
)
from tests.unit.schemas.strategies import messages

DRIFT = models.Figure(name="drift", value=0.5, unit="°/s")


@pytest.fixture
def table() -> Routes:
    return routes()


@given(st.floats(-math.pi, math.pi), st.floats(-1.57, 1.57))
def test_x_of_the_pointing_ray_is_its_direction(azimuth_rad: float, elevation_rad: float) -> None:
    way = vector.direction(azimuth_rad, elevation_rad)
    ray = models.PointingRay(stamp_ns=NOW_NS, origin_m=(0.0, 0.0, 1.64), direction=way)
    (value,) = sent(out(routes(), "pointing_ray"), ray, furnished())
    x_axis = rotation.rotate(turned(value.pose.orientation), (1.0, 0.0, 0.0))
    assert x_axis == pytest.approx(way, abs=1e-9)
    assert value.pose.position.z == 1.64
    assert value.header.frame_id == "user1/human_footprint"
    assert (value.header.stamp.sec, value.header.stamp.nanosec) == (1_700_000_000, 5)


def test_arm_message_has_the_measurements_of_the_device(table: Routes) -> None:
    q = (0.5, -0.5, 0.5, 0.5)
    plain = models.ImuSample(stamp_ns=NOW_NS, orientation_xyzw=q)
    (rotated,) = sent(out(table, "rotation"), plain, furnished())
    assert (turned(rotated.quaternion), rotated.header.frame_id) == (q, "user1/human_footprint")

    (value,) = sent(out(table, "imu"), plain, furnished())
    assert (turned(value.orientation), value.header.frame_id) == (q, "user1/human_footprint"), "in tf"
    assert value.angular_velocity_covariance[0] == value.linear_acceleration_covariance[0] == -1.0

    full = plain.model_copy(
        update={"angular_velocity_radps": (1.0, 2.0, 3.0), "acceleration_mps2": (4.0, 5.0, 6.0)}
    )
    (value,) = sent(out(table, "imu"), full, furnished())
    for told, of_arm in (
        (value.angular_velocity, (1.0, 2.0, 3.0)),
        (value.linear_acceleration, (4.0, 5.0, 6.0)),
    ):
        assert (told.x, told.y, told.z) == pytest.approx(rotation.rotate(q, of_arm))
    assert value.angular_velocity_covariance[0] == 0.0


def test_pose_is_published_in_the_world_with_its_covariance(table: Routes) -> None:
    (value,) = sent(out(table, "pose"), POSE, furnished())
    assert value.header.frame_id == "world"
    assert rotation.rotate(turned(value.pose.orientation), (1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))

    (value,) = sent(out(table, "pose"), POSE.model_copy(update={"stamp_ns": 2**63 - 1}), furnished())
    assert (value.header.stamp.sec, value.header.stamp.nanosec) == (LAST_S, 0), "the last that ROS can tell"
    (value,) = sent(out(table, "pose_with_covariance"), POSE, furnished())
    spread = value.pose.covariance.reshape(6, 6)
    assert spread[0, 0] == 0.04
    assert spread[0, 5] == spread[5, 0] == 0.001
    assert (spread[1, 5], spread[5, 5]) == (0.002, 0.003)
    assert spread[2, 2] == pytest.approx(0.01)
    assert spread.diagonal()[3:5] == pytest.approx(math.radians(1.0) ** 2)
    assert not (spread - np.diag(spread.diagonal()))[3:5].any()

    told = POSE.model_copy(update={"covariance": (0.0,) * 9, "z_sigma_m": 0.0})
    (value,) = sent(out(table, "pose_with_covariance"), told, furnished())
    spread = value.pose.covariance.reshape(6, 6)
    assert spread.diagonal() == pytest.approx([0.01**2] * 3 + [math.radians(1.0) ** 2] * 3)


def test_the_clock_is_published_while_time_is_simulated_only(table: Routes) -> None:
    row = out(table, "clock")
    wall = WallClock().tick()
    assert sent(row, wall, furnished()) == sent(row, wall, furnished(), again_ns=NOW_NS) == []
    for sim_ns, speed in ((NOW_NS, 2.0), (5 * models.NS_PER_S, 1.0)):
        tick = models.ClockTick(stamp_ns=NOW_NS, sim_ns=sim_ns, speed=speed)
        (value,) = sent(row, tick, furnished())
        assert value.clock.sec == sim_ns // models.NS_PER_S
        (value,) = sent(row, tick, furnished(), "", again_ns=8 * models.NS_PER_S)
        assert value.clock.sec == 8


def test_tf_is_repeated_until_another_node_publishes_it(table: Routes) -> None:
    scene = furnished()
    row = out(table, "tf")
    (value,) = sent(row, POSE, scene)
    (frame,) = value.transforms
    assert (frame.header.frame_id, frame.child_frame_id) == ("world", "user1/human_footprint")
    assert (frame.transform.translation.z, frame.header.stamp.sec) == (0.5, 1_700_000_000)
    (value,) = sent(row, POSE, scene, again_ns=NOW_NS + 3 * models.NS_PER_S)
    assert value.transforms[0].header.stamp.sec == 1_700_000_003
    scene.person("user1").tf_until_ns = NOW_NS + models.NS_PER_S
    assert sent(row, POSE, scene) == []
    assert sent(row, POSE, scene, "user2") != []
    assert sent(row, POSE, scene, again_ns=NOW_NS + models.NS_PER_S) != []


def test_all_static_frames_come_together(table: Routes) -> None:
    (value,) = sent(out(table, "tf_static"), ROOM, furnished(), "")
    frames = {each.child_frame_id: each.transform for each in value.transforms}
    assert set(frames) == {"lamp/led_0", "belt/part_a", "belt/part_b", "strip/0"}
    assert frames["belt/part_b"].translation.y == 5.0
    ahead = rotation.rotate(turned(frames["belt/part_a"].rotation), (1.0, 0.0, 0.0))
    assert ahead == pytest.approx((0.0, 1.0, 0.0))


def test_a_cursor_is_a_point_where_there_is_one(table: Routes) -> None:
    (value,) = sent(out(table, "cursor"), CURSOR, furnished())
    assert (value.point.x, value.point.y, value.point.z) == (0.0, 0.5, 0.0)
    assert value.header.frame_id == "world"
    assert sent(out(table, "cursor"), models.Cursor(stamp_ns=NOW_NS), furnished()) == []


def test_a_goal_is_a_pose_in_the_world(table: Routes) -> None:
    goal = models.Goal(
        stamp_ns=NOW_NS,
        position_m=(1.0, 2.0, 0.0),
        yaw_rad=math.pi / 2.0,
        age_s=0.1,
        position_sigma_m=0.2,
        clearance_m=2.0,
        proposed_ns=NOW_NS - models.NS_PER_S,
        confirmed_by="again",
    )
    (value,) = sent(out(table, "goal_pose"), goal, furnished())
    assert (value.header.frame_id, value.pose.position.y) == ("world", 2.0)
    assert value.header.stamp.sec == NOW_NS // models.NS_PER_S
    assert rotation.rotate(turned(value.pose.orientation), (1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))

    steered = goal.model_copy(update={"robot": "rover"})  # our own robot: a Nav2 would drive there as well
    assert sent(out(table, "goal_pose"), steered, furnished()) == []
    assert out(table, "goal_pose").qos == Qos(depth=10)  # not latched: who comes late gets no old goal


def test_states_are_called_as_the_ros_toolkit_does(table: Routes) -> None:
    scene = furnished()
    scene.take(
        "user1", models.UserProfile(stamp_ns=0, cursor_color=(255, 0, 51), cursor_width_m=0.25), NOW_NS
    )
    told: list[Any] = []
    for state in ("idle", "localizing", "pointing"):
        interaction = models.Interaction(stamp_ns=NOW_NS, state=state)
        (transition,) = sent(out(table, "state_transition"), interaction, scene)
        (points,) = sent(out(table, "is_pointing"), interaction, scene)
        (wish,) = sent(out(table, "subscription"), interaction, scene)
        told.append((transition.node_name, transition.state, points.data, wish.subscribe))

    assert told == [
        ("supervisor", "ready", False, False),
        ("supervisor", "waiting_relloc", False, False),
        ("supervisor", "pointing", True, True),
    ]
    assert (wish.user_name, wish.pointer_color.r, wish.pointer_size) == ("user1", 1.0, 0.25)
    assert wish.pointer_color.b == pytest.approx(0.2)


def test_packages_are_positions_as_shares_of_their_belts(table: Routes) -> None:
    scene = furnished()
    row = out(table, "packages")
    sent(row, objects(package(7, belt="part_b", at_m=1.5, kind="blue")), scene, "other")
    free = package(3).model_copy(update={"surface": "none", "surface_id": ""})
    strip = package(4).model_copy(update={"surface": "strip", "surface_id": "0", "surface_position_m": 99.0})
    (value,) = sent(row, objects(package(12), free, strip), scene, "conveyor")
    listed = {each.uid: (each.position.name, each.position.position, each.type) for each in value.packages}

    assert listed == {12: ("part_a", 0.5, 1), 7: ("part_b", 0.5, 0), 4: ("strip_0", 1.0, 1)}
    assert {each.uid: each.length for each in value.packages}[12] == pytest.approx(0.3)
    scene.take("conveyor", objects(package(2)), NOW_NS + MAX_TRACKER_AGE_NS + 1)
    (value,) = row.convert(objects(), "conveyor", scene)
    assert [each.uid for each in value.packages] == [2], "the other tracker is silent"

    thing = models.Thing(id="19-2", center_m=(0.0, 1.0, 0.0), size_m=(0.3, 0.3, 0.3), strip="0")
    scene.take("", ROOM.model_copy(update={"things": (thing,)}), NOW_NS + MAX_TRACKER_AGE_NS + 1)
    (value,) = row.convert(objects(), "conveyor", scene)
    assert not value.packages, "a thing of the map is none"


def test_selection_lists_package_numbers(table: Routes) -> None:
    scene = furnished()
    selection = models.Selection(
        stamp_ns=NOW_NS, objects=(models.SelectedObject(id="19-12", user="user1", since_ns=0),)
    )
    (value,) = sent(out(table, "selected_packages"), selection, scene, "")
    assert value.uids.tolist() == [12]
    (value,) = sent(out(table, "packages"), objects(package(12)), scene, "conveyor")
    assert value.packages[0].uid == 12


def test_pointers_have_cursor_positions_and_hovered_packages(table: Routes) -> None:
    scene = furnished()
    profile = models.UserProfile(
        stamp_ns=0, cursor_color=(0, 255, 0), cursor_width_m=0.25, cursor_colormap="jet"
    )
    scene.take("user1", profile, NOW_NS)
    scene.take("user2", models.UserProfile(stamp_ns=0), NOW_NS)
    scene.take("user1", models.Hover(stamp_ns=NOW_NS, object_id="19-4"), NOW_NS)
    (value,) = sent(out(table, "pointers"), CURSOR, scene)
    first, second = value.pointers

    assert (first.user_name, first.position.name, first.position.position) == ("user1", "part_a", 0.25)
    assert (first.size, first.distance, first.cmap, first.color.g) == (0.25, 0.25, "jet", 1.0)
    assert first.overlay.uids.tolist() == [4]
    assert (second.user_name, second.position.name) == ("user2", "")

    (value,) = sent(out(table, "pointers"), models.Interaction(stamp_ns=NOW_NS, state="idle"), scene)
    assert [each.position.name for each in value.pointers] == ["", ""]
    scene.forget("user2")
    (value,) = sent(out(table, "pointers"), CURSOR, scene)
    assert [each.user_name for each in value.pointers] == ["user1"]


@pytest.mark.parametrize(
    ("thing", "event", "told"),
    [
        ("screws", "selected", "thing_on"),
        ("screws", "deselected", ""),  # a button is over
        ("radio", "selected", "thing_on"),
        ("radio", "deselected", "thing_off"),
        ("radio", "refused", ""),
        ("19-4", "selected", ""),  # a package
    ],
)
def test_selected_thing_is_a_detection_of_the_person(
    table: Routes, thing: str, event: Any, told: str
) -> None:
    scene = furnished()
    size_m = (0.4, 0.3, 0.2)
    things = (
        models.Thing(id="screws", center_m=(1.0, 2.0, 3.0), size_m=size_m),
        models.Thing(id="radio", center_m=(1.0, 2.0, 3.0), size_m=size_m, mode="switch"),
    )
    scene.take("", ROOM.model_copy(update={"things": things}), NOW_NS)
    listed = [
        package(4).model_copy(update={"id": each.id, "size_m": size_m, "yaw_rad": 1.0}) for each in things
    ]
    scene.take("things", objects(*listed, package(4)), NOW_NS)
    message = models.SelectionEvent(
        stamp_ns=NOW_NS, event=event, object_id=thing, user="anna", confidence=0.93
    )
    values = {name: sent(out(table, name), message, scene, "") for name in ("thing_on", "thing_off")}

    assert [name for name, value in values.items() if value] == ([told] if told else [])
    for value in values.get(told, []):
        (result,) = value.results
        assert (value.id, result.hypothesis.class_id, result.hypothesis.score) == ("anna", thing, 0.93)
        assert (value.header.frame_id, value.header.stamp.nanosec) == ("world", 5)
        size = value.bbox.size
        assert (value.bbox.center.position.y, size.x, size.y, size.z) == (1.0, *size_m)
        assert turned(value.bbox.center.orientation) == rotation.from_yaw(1.0)


def test_detection_of_pressed_untracked_things_lacks_score_and_box(table: Routes) -> None:
    scene = furnished()
    thing = models.Thing(id="screws", center_m=(1.0, 2.0, 3.0), size_m=(1.0, 1.0, 1.0))
    scene.take("", ROOM.model_copy(update={"things": (thing,)}), NOW_NS)
    event = models.SelectionEvent(stamp_ns=NOW_NS, event="selected", object_id="screws", user="anna")
    (value,) = sent(out(table, "thing_on"), event, scene, "")
    assert (value.results[0].hypothesis.score, value.bbox.size.x) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("step", "told"), [("28", [28]), ("-1", [-1]), ("end", []), ("", []), ("9" * 12, [])]
)
def test_numeric_feeding_steps_are_published(table: Routes, step: str, told: list[int]) -> None:
    state = models.ConveyorState(stamp_ns=NOW_NS, speed_mps=0.1, step=step)
    assert [value.data for value in sent(out(table, "step_number"), state, furnished(), "")] == told


def test_strips_have_their_numbers_and_ros_colours(table: Routes) -> None:
    strips = (models.StripFrame(id="3", rgb=bytes((1, 2, 3, 4, 5, 6))),)
    (value,) = sent(out(table, "led_strips"), models.StripsFrame(stamp_ns=NOW_NS, strips=strips), furnished())
    (strip,) = value.strips
    assert (strip.id, strip.color_order, strip.data.tolist()) == (3, 0, [1, 2, 3, 4, 5, 6])


def test_health_is_diagnostics_in_valid_ros_texts(table: Routes) -> None:
    health = models.Health(
        stamp_ns=NOW_NS, service="pui", instance="pui", pid=1, host="si\0te", figures=(DRIFT,)
    )
    (value,) = sent(out(table, "diagnostics"), health, furnished(), "pui")
    (status,) = value.status
    told = (status.name, status.hardware_id, status.level, status.message)
    assert told == ("pointit: pui", "site", 0, "ok")
    assert ("drift °/s", "0.5") in {(pair.key, pair.value) for pair in status.values}
    for warning, message in (("no map: start pui", "no map: start pui"), ("w" * 5000, "w" * MAX_TEXT)):
        ill = health.model_copy(update={"status": "degraded", "warnings": (warning,)})
        (value,) = sent(out(table, "diagnostics"), ill, furnished(), "pui")
        assert (value.status[0].level, value.status[0].message) == (1, message)


ROWS = [(row.name, topic) for row in routes(ros4hri=True).outward for topic in row.reads]


@pytest.mark.parametrize(("name", "topic"), ROWS, ids=[f"{name}-{topic.key}" for name, topic in ROWS])
@settings(max_examples=12)
@given(data=st.data())
def test_every_valid_message_is_converted_and_encoded(name: str, topic: Any, data: st.DataObject) -> None:
    scene = furnished()
    row = out(routes(ros4hri=True), name)
    others = data.draw(st.lists(st.sampled_from(TOPICS), max_size=2))
    for other in others:
        scene.take("user1", data.draw(messages(other.message)), NOW_NS)
    message = data.draw(messages(topic.message))
    scene.take("user1", message, NOW_NS)
    for again_ns in (None, NOW_NS):
        for value in row.convert(message, "user1", scene, again_ns=again_ns):
            jazzy().decode(row.type, jazzy().encode(row.type, value))


def keys(value: Any, action: int = ADD) -> set[tuple[str, int]]:
    return {(marker.ns, marker.id) for marker in value.markers if marker.action == action}


def test_markers_show_the_scene_and_delete_ended_ones(table: Routes) -> None:
    scene = furnished()
    row = out(table, "markers")
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


def test_number_of_markers_is_limited_with_a_label(table: Routes) -> None:
    many = objects(*(package(number) for number in range(MAX_OBJECTS + 3)))
    scene = furnished()
    (value,) = sent(out(table, "markers"), many, scene, "conveyor")
    assert len(value.markers) == MAX_OBJECTS + 1
    assert value.markers[-1].text.startswith("3 more")


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


def test_ribbon_has_the_width_of_its_belt_and_two_sides() -> None:
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


def test_robot_and_plan_have_the_colour_of_their_user() -> None:
    scene = furnished()
    row = out(routes(), "markers")
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

    body = drawn["robot quad", 0]
    plan = drawn["robot quad/plan", 0]
    assert (body.color.r, body.color.b, body.scale.x) == (0.0, 1.0, 0.4)
    assert [(point.x, point.y, point.z) for point in plan.points] == [(1.0, 2.0, 1.5), (3.0, 2.0, 1.5)]
    assert drawn["robot quad/name", 0].text == "quad: moving, user1"


def test_stopped_robot_is_red_and_silent_one_is_removed() -> None:
    scene = furnished()
    row = out(routes(), "markers")
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
    scene = furnished()
    row = out(routes(), "map_markers")
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
