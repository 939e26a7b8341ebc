"""Robots, their plans, way-points and fences, drawn."""

import pytest

from pointit.bridges.ros2.outbound.drawing import ADD
from pointit.bridges.ros2.outbound.markers import HALTED
from pointit.bridges.ros2.routing.routes import routes
from pointit.schemas import RobotPlan, RobotState, Steering, TrackedObject, UserProfile
from pointit.schemas.environment import Fence
from tests.unit.ros2.scenes import NOW_NS, ROOM, furnished, objects, out, sent

STATE = RobotState(
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
    scene.take("user1", UserProfile(stamp_ns=NOW_NS, cursor_color=(0, 0, 255)), NOW_NS)
    scene.take("user1", Steering(stamp_ns=NOW_NS, waypoints_m=((2.0, 0.0, 0.0), (3.0, 0.0, 0.0))), NOW_NS)
    robot = TrackedObject(id="quad", kind="quadrotor", position_m=(1.0, 2.0, 1.5))
    scene.take("quad", objects(robot), NOW_NS)
    scene.take("quad", STATE, NOW_NS)
    (value,) = sent(row, RobotPlan(stamp_ns=NOW_NS, line_m=((3.0, 2.0, 1.5),), user="user1"), scene, "quad")
    drawn = {(marker.ns, marker.id): marker for marker in value.markers if marker.action == ADD}
    assert set(drawn) == {
        ("robot quad", 0),
        ("robot quad/front", 0),
        ("robot quad/name", 0),
        ("robot quad/place", 0),
        ("robot quad/plan", 0),
        ("robot quad/target", 0),
        ("user1/waypoints", 0),
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
    assert [(point.x, point.y, point.z) for point in top.points] == [
        (0.0, 0.0, 2.0),
        (1.0, 0.0, 2.0),
        (1.0, 1.0, 2.0),
        (0.0, 0.0, 2.0),
    ]
