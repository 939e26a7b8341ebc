"""Goals: the ways on which the pilot sends a robot, and those that it refuses."""

import pytest

from pointit.services.robot.robot_driver import Follow, FollowPath, OrderStatus
from tests.unit.robot.flight import ROBOT
from tests.unit.robot.test_robot_pilot import THERE, desk_of


def test_a_goal_is_carried_out_with_its_way_points_and_its_way_gets_shorter() -> None:
    desk = desk_of()
    goal = desk.send("anna", THERE, (0.0, 1.0, 0.0), robot=ROBOT)
    order = desk.step()
    assert isinstance(order, FollowPath)
    assert order.points_m == ((0.0, 1.0, 0.0), THERE)
    assert desk.pilot.phase == "moving"
    assert desk.pilot.goal_ns == goal.stamp_ns
    desk.report((0.0, 0.95, 0.0))
    assert desk.pilot.way_m == ((0.0, 0.95, 0.0), THERE)
    desk.pilot.on_item(OrderStatus(order.order, "done"), desk.now_ns)
    assert {desk.pilot.phase} == {"idle"}
    assert (len(desk.pilot.way_m), desk.pilot.goal_ns) == (0, 0)


def test_a_robot_that_stands_on_its_way_is_said_until_it_goes_on() -> None:
    desk = desk_of()
    desk.send("anna", THERE, robot=ROBOT)
    order = desk.step()
    assert order is not None
    desk.pilot.on_item(OrderStatus(order.order, "active"), desk.now_ns)
    for seconds in (0.05, 14.0, 0.9):
        desk.step(seconds)
        assert desk.pilot.reason == ""
    desk.step(0.2)
    assert "has not moved for 15 s" in desk.pilot.reason
    assert (desk.pilot.user, desk.pilot.phase) == ("anna", "moving")
    desk.report((0.5, 0.0, 0.0))
    desk.step()
    assert desk.pilot.reason == ""


@pytest.mark.parametrize(("height_m", "is_taken"), [(0.25, True), (0.7, False), (-0.7, False)])
def test_a_ground_robot_goes_to_its_floor_only_and_stays_at_its_height(
    *, height_m: float, is_taken: bool
) -> None:
    x, y, _ = THERE
    goals, follows = desk_of(), desk_of(mode="follow")
    goals.send("anna", (x, y, height_m), robot=ROBOT)
    follows.point("anna", (x, y, height_m))
    path, follow = goals.step(), follows.step()
    if is_taken:
        assert isinstance(path, FollowPath)
        assert isinstance(follow, Follow)
        assert path.points_m == (follow.position_m,) == ((x, y, 0.0),)
    else:
        assert not isinstance(path, FollowPath)
        assert not isinstance(follow, Follow)
        assert "point at the floor" in goals.pilot.reason == follows.pilot.reason


def test_goals_of_others_for_others_late_or_twice_move_nothing() -> None:
    desk = desk_of()
    desk.send("ben", THERE)
    desk.send("anna", THERE, robot="other")
    assert desk.step() is None
    desk.send("anna", THERE, age_s=3.0)
    assert desk.step() is None
    assert "3.0 s late" in desk.pilot.reason
    desk.send("anna", THERE, age_s=-60.0)
    assert desk.step() is None
    assert "60.0 s ahead" in desk.pilot.reason
    goal = desk.send("anna", THERE)
    assert isinstance(desk.step(), FollowPath)
    desk.pilot.on_goal("anna", goal, desk.now_ns)
    assert desk.step() is None


def test_a_goal_that_is_not_permitted_is_refused_with_the_reason() -> None:
    desk = desk_of()
    desk.safety.place_problem = "the place is beyond a fence: choose another"
    desk.send("anna", THERE)
    assert desk.step() is None
    assert desk.pilot.reason == "the place is beyond a fence: choose another"
