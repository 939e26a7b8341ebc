"""Steering: tables that are complete, safe and obeyed, and the ways on which a robot is sent."""

from itertools import product
from typing import get_args

import pytest

from pointit.schemas import Steering
from pointit.services.robot.command_planner import (
    ACTIONS,
    HOLDS,
    Action,
    Change,
    Hold,
    Mode,
    Stage,
    Verdict,
    hold_of,
)
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land, OrderStatus, Stop, TakeOff
from pointit.services.robot.stop_reason import StopReason
from tests.support import there
from tests.unit.robot.flight import ROBOT
from tests.unit.robot.permits import Desk
from tests.unit.robot.test_robot_pilot import desk_of

THERE = (1.0, 0.5, 0.0)
ABOVE = (0.0, 0.0, 1.0)
COMMANDS: dict[Action, type[Command] | None] = {
    "wait": None, "take off": TakeOff, "follow": Follow, "go": FollowPath, "land": Land, "stay": Stop,
    "stop": Stop, "let go": Stop,
}  # fmt: skip
STOPS: dict[Verdict, StopReason | None] = {
    "safe": None,
    "hold": StopReason("people", "somebody is near", is_freeing=False),
    "free": StopReason("jump", "it has jumped", is_freeing=True),
    "other_master": StopReason("other_master", "another steers it", is_freeing=True),
}
SILENT = StopReason("report", "nothing is heard of it", is_freeing=True)
HELD: dict[Hold, StopReason | None] = {
    "none": None, "kept": STOPS["hold"], "passing": SILENT, "freed": STOPS["free"]
}  # fmt: skip


def test_tables_of_actions_and_holds_are_complete() -> None:
    assert get_args(Mode) == get_args(Steering.model_fields["mode"].annotation)
    assert set(product(get_args(Stage), get_args(Mode))) == {(a, b) for a in ACTIONS for b in ACTIONS[a]}
    assert set(product(get_args(Hold), get_args(Verdict))) == {(a, b) for a in HOLDS for b in HOLDS[a]}


def test_tables_begin_nothing_unrequested_and_resume_nothing_unsafe() -> None:
    assert {actions["none"] for actions in ACTIONS.values()} <= {"wait", "stay", "stop"}
    for changes in HOLDS.values():
        assert {changes[each] for each in get_args(Verdict) if each != "safe"}.isdisjoint({"-", "resume"})


def desk_in(stage: Stage) -> Desk:
    """Return a desk with a quadrotor that anna steers, and that does this."""
    desk = Desk()
    desk.report()
    desk.step()
    desk.point("anna", THERE)
    desk.steer("anna", "none" if stage == "landed" else "goals")
    order = desk.step()
    if stage in ("landed", "taking_off"):
        return desk
    assert isinstance(order, TakeOff)
    desk.pilot.on_item(OrderStatus(order.order, "done"), desk.now_ns)
    desk.report(ABOVE, is_flying=True)
    wish(
        desk,
        {"landing": "land", "following": "follow", "on_path": "goals"}.get(stage, "none"),
        (0.2, 0.3, 0.0),
    )
    desk.step()
    return desk


def wish(desk: Desk, mode: str, place_m: tuple[float, float, float]) -> None:
    desk.steer("anna", mode, target_m=place_m if mode == "land" else None)
    if mode == "goals":
        desk.send("anna", place_m)


@pytest.mark.parametrize(("stage", "mode"), list(product(get_args(Stage), get_args(Mode))))
def test_robot_does_what_the_table_says(stage: Stage, mode: Mode) -> None:
    desk = desk_in(stage)
    action = ACTIONS[stage][mode]
    wish(desk, mode, THERE)
    command = desk.step()
    expected = COMMANDS[action]
    assert command is None if expected is None else isinstance(command, expected)
    assert desk.pilot.user == ("" if action == "let go" else "anna")


@pytest.mark.parametrize(("hold", "verdict"), list(product(get_args(Hold), get_args(Verdict))))
def test_robot_stands_as_long_as_the_table_says(hold: Hold, verdict: Verdict) -> None:
    desk = desk_in("resting")
    before = HELD[hold]
    now = STOPS[verdict]
    desk.safety.stop_reason = before
    desk.step()
    user = desk.pilot.user

    assert hold_of(before, user) == hold
    if now is not None:
        now = now._replace(text=f"now {now.text}")
    desk.safety.stop_reason = now
    command = desk.step()

    change: Change = HOLDS[hold][verdict]
    stop = {"-": before, "resume": None, "end": before}.get(change, now)
    assert desk.pilot.reason == ("" if stop is None else stop.text)
    assert isinstance(command, Stop) == (change in ("halt", "release"))
    assert desk.pilot.user == ("" if change == "release" else user)


def test_blocked_robot_is_reported_until_it_continues() -> None:
    desk = desk_of()
    desk.send("anna", THERE, robot=ROBOT)
    desk.pilot.on_item(OrderStatus(there(desk.step()).order, "active"), desk.now_ns)
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
def test_ground_robot_goes_to_its_own_floor_only(*, height_m: float, is_taken: bool) -> None:
    x, y, _ = THERE
    goals = desk_of()
    follows = desk_of(mode="follow")
    goals.send("anna", (x, y, height_m), robot=ROBOT)
    follows.point("anna", (x, y, height_m))
    path = goals.step()
    follow = follows.step()

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


def test_goal_is_refused_with_the_reason_when_not_permitted() -> None:
    desk = desk_of()
    desk.safety.place_problem = "the place is beyond a fence: choose another"
    desk.send("anna", THERE)
    assert desk.step() is None
    assert desk.pilot.reason == "the place is beyond a fence: choose another"
