"""The pilot: who steers the robot, what it is told, and what is said if it cannot be."""

import math
from collections.abc import Callable
from functools import partial
from typing import Literal, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import NS_PER_S, Localization
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.current_order import StandstillMonitor
from pointit.services.robot.robot_driver import (
    Follow,
    FollowPath,
    Land,
    LinkLost,
    OrderStatus,
    RobotReport,
    Stop,
    TakeOff,
)
from pointit.services.robot.stop_reason import StopReason
from tests.unit.robot.flight import ROBOT
from tests.unit.robot.permits import Desk

THERE = (1.0, 0.5, 0.0)
PEOPLE = ("anna", "ben")
State = Literal["active", "cancelled", "done", "failed"]
STATES: tuple[State, ...] = get_args(State)


def ready_desk(**parameters: object) -> Desk:
    """Return a desk with a robot that has reported and was told to stop."""
    desk = Desk(**parameters)
    desk.report()
    assert isinstance(desk.step(), Stop)
    return desk


def desk_of(user: str = "anna", mode: str = "goals") -> Desk:
    """Return a desk with a ground robot that `user` steers."""
    desk = ready_desk(kind="ground")
    desk.steer(user, mode)
    desk.step()
    assert desk.pilot.user == user
    return desk


def flying_desk() -> Desk:
    """Return a desk with a quadrotor that hovers for anna, who points at `THERE`."""
    desk = ready_desk()
    desk.point("anna", THERE)
    desk.steer("anna")
    order = desk.step()
    assert isinstance(order, TakeOff)
    desk.pilot.on_item(OrderStatus(order.order, "done"), desk.now_ns)
    desk.report((0.0, 0.0, 0.2), is_flying=True)
    return desk


def test_a_robot_is_told_to_stop_when_it_reports_first_and_after_each_loss() -> None:
    desk = Desk(kind="ground")
    assert desk.step() is None
    desk.report()
    assert isinstance(desk.step(), Stop)
    assert desk.step() is None
    assert (desk.pilot.phase, desk.pilot.reason) == ("idle", "")
    desk.pilot.on_item(LinkLost("its battery is empty: charge it"), desk.now_ns)
    desk.step()
    assert (desk.pilot.phase, desk.pilot.reason) == ("lost", "its battery is empty: charge it")
    desk.report()
    assert isinstance(desk.step(), Stop)


def test_a_robot_that_is_silent_at_the_start_is_said_after_the_time_for_a_report() -> None:
    desk = Desk(report_timeout_s=1.0)
    desk.step()
    assert (desk.pilot.phase, desk.pilot.reason) == ("lost", "")
    desk.step(1.0)
    assert (desk.pilot.phase, desk.pilot.reason) == ("lost", "")
    desk.step()
    assert (desk.pilot.phase, desk.pilot.reason[:7]) == ("lost", "nothing")


def test_the_first_who_names_it_gets_it_and_the_next_when_it_is_let_go() -> None:
    desk = desk_of("anna")
    desk.steer("ben")
    desk.step()
    assert desk.pilot.user == "anna"
    desk.steer("anna", robot="other")
    assert isinstance(desk.step(), Stop)
    assert desk.pilot.user == "ben"


@pytest.mark.parametrize("purpose", ["anchor", "pose"])
def test_who_is_localized_by_following_their_robot_has_let_go(purpose: Literal["anchor", "pose"]) -> None:
    desk = desk_of("anna")
    desk.safety.stop_reason = StopReason("not_pointing", "it waits until anna is localized", is_freeing=False)
    assert isinstance(desk.step(), Stop)
    follows = Localization(
        stamp_ns=0, phase="sampling", target_id=ROBOT, purpose=purpose, since_ns=desk.now_ns
    )
    desk.pilot.on_localization("anna", follows)
    desk.step()
    assert desk.pilot.user == ("anna" if purpose == "anchor" else "")


def test_who_leaves_has_let_go() -> None:
    desk = desk_of("anna")
    desk.send("anna", THERE)
    assert isinstance(desk.step(), FollowPath)
    desk.pilot.on_presence("anna", present=False)
    assert isinstance(desk.step(), Stop)
    assert desk.pilot.user == ""
    desk.pilot.on_presence("anna", present=True)
    desk.step()
    assert desk.pilot.user == ""  # what they wanted before they left counts no more


def test_after_a_stop_nobody_gets_it_who_does_not_ask_anew() -> None:
    desk = desk_of("anna")
    desk.steer("ben")
    desk.send("anna", THERE)
    desk.step()
    desk.pilot.on_stop_request("somebody has stopped it")
    assert isinstance(desk.step(), Stop)
    for _ in range(10):
        desk.steer("anna")
        assert desk.step() is None
    assert (desk.pilot.user, desk.pilot.phase) == ("", "stopped")
    assert desk.pilot.reason == "somebody has stopped it"
    desk.steer("ben", robot="")
    desk.steer("ben", "goals")
    desk.step()
    assert (desk.pilot.user, desk.pilot.phase, desk.pilot.reason) == ("ben", "idle", "")


@pytest.mark.parametrize("age_s", [0.0, 100.0, -100.0])
def test_what_people_wanted_before_it_was_connected_moves_nothing(age_s: float) -> None:
    desk = Desk()
    desk.steer("anna", age_s=age_s)
    desk.step()
    desk.report()
    assert isinstance(desk.step(), Stop)
    assert [desk.step() for _ in range(50)] == [None] * 50
    assert (desk.pilot.user, desk.pilot.phase) == ("", "landed")
    assert "anna asked for the robot too long ago" in desk.pilot.reason
    desk.steer("anna", robot="")
    desk.steer("anna")
    assert isinstance(desk.step(), TakeOff)


@pytest.mark.parametrize("age_s", [0.3, 100.0, -100.0])
def test_a_wish_that_is_repeated_after_the_first_report_moves_nothing(age_s: float) -> None:
    desk = ready_desk()
    desk.steer("anna", age_s=age_s)
    assert [desk.step() for _ in range(50)] == [None] * 50
    assert desk.pilot.user == ""


def test_who_lowers_the_arm_after_a_landing_was_held_up_lands_all_the_same() -> None:
    desk = flying_desk()
    desk.safety.place_problem = "you are not pointing: point at the place"
    desk.steer("anna", "land", target_m=(0.2, 0.3, 0.0))
    order = desk.step()
    assert isinstance(order, Land)
    assert (order.position_m, order.max_speed_mps) == ((0.2, 0.3, 0.0), 1.0), "slow near people"


def test_a_take_off_that_does_not_happen_is_given_up_and_said() -> None:
    desk = ready_desk()
    desk.steer("anna")
    order = desk.step()
    assert isinstance(order, TakeOff)
    desk.pilot.on_item(OrderStatus(order.order, "active"), desk.now_ns)
    assert desk.step() is None
    assert desk.step(14.0) is None
    assert isinstance(desk.step(1.1), Stop)
    assert (desk.pilot.user, desk.pilot.phase) == ("", "landed")
    assert "see that it is armed" in desk.pilot.reason
    assert [desk.step() for _ in range(20)] == [None] * 20


def test_a_landing_takes_its_time_while_the_robot_moves() -> None:
    desk = flying_desk()
    desk.steer("anna", "land", target_m=(0.2, 0.3, 0.0))
    assert isinstance(desk.step(), Land)
    for number in range(5):
        desk.report((0.3 * number, 0.0, 0.2), is_flying=True)
        assert desk.step(10.0) is None
    assert isinstance(desk.step(15.1), Stop)
    assert "not landed" in desk.pilot.reason


def test_who_may_not_steer_does_not_get_it_and_the_reason_is_said() -> None:
    desk = ready_desk(kind="ground")
    desk.safety.person_problem = "your position is unknown: localize first"
    desk.steer("anna", "goals")
    desk.step()
    assert (desk.pilot.user, desk.pilot.reason) == ("", "your position is unknown: localize first")
    desk.safety.person_problem = ""
    desk.step()
    assert (desk.pilot.user, desk.pilot.reason) == ("anna", "")


def test_a_quadrotor_follows_above_the_floor_and_hovers_when_its_person_points_elsewhere() -> None:
    desk = flying_desk()
    order = desk.step()
    assert isinstance(order, Follow)
    assert order.position_m == pytest.approx((1.0, 0.5, 0.2))
    assert desk.pilot.phase == "moving"
    wall = desk.pilot
    cursor = wall._cursors["anna"]
    wall.on_cursor("anna", cursor.model_copy(update={"surface_id": "wall"}))
    assert isinstance(desk.step(), Stop)
    assert desk.step() is None
    assert desk.pilot.reason == "the robot cannot go where you point: point at the floor"


@pytest.mark.parametrize("state", ["refused", "failed", "cancelled"])
def test_an_order_that_is_refused_is_said_and_not_repeated(
    state: Literal["refused", "failed", "cancelled"],
) -> None:
    desk = ready_desk()
    desk.steer("anna")
    order = desk.step()
    assert isinstance(order, TakeOff)
    desk.pilot.on_item(OrderStatus(order.order, state, "a rotor is blocked"), desk.now_ns)
    desk.report()
    assert [desk.step() for _ in range(20)] == [None] * 20
    assert f"{state} its order: a rotor is blocked; point there again" in desk.pilot.reason
    assert desk.pilot.user == "anna"
    desk.steer("anna", "none")
    desk.step()
    desk.steer("anna")
    assert isinstance(desk.step(), TakeOff)


def test_answers_about_earlier_orders_are_no_news_and_silence_is_said() -> None:
    desk = desk_of()
    desk.send("anna", THERE)
    first = desk.step()
    desk.now_ns += 1
    desk.send("anna", (2.0, 0.0, 0.0))
    second = desk.step()
    assert isinstance(first, FollowPath)
    assert isinstance(second, FollowPath)
    for state in STATES:
        desk.pilot.on_item(OrderStatus(first.order, state), desk.now_ns)
    assert (desk.pilot.phase, desk.pilot.reason) == ("moving", "")
    desk.step(3.2)
    assert "not answered its order for 3 s" in desk.pilot.reason
    desk.pilot.on_item(OrderStatus(second.order, "active"), desk.now_ns)
    desk.pilot.on_item(OrderStatus(second.order, "done"), desk.now_ns)
    desk.pilot.on_item(OrderStatus(second.order, "done"), desk.now_ns)
    assert desk.pilot.phase == "idle"


@given(
    value=st.sampled_from([math.nan, math.inf, -math.inf, 1e12]),
    field=st.sampled_from(["x", "yaw", "velocity", "sigma", "battery"]),
)
def test_reports_that_no_message_can_hold_are_refused(value: float, field: str) -> None:
    desk = Desk()
    report = RobotReport(
        desk.now_ns,
        (value if field == "x" else 0.0, 0.0, 0.0),
        value if field == "yaw" else 0.0,
        (0.0, value if field == "velocity" else 0.0, 0.0),
        value if field == "sigma" else None,
        battery=value if field == "battery" else None,
    )
    assert desk.pilot.on_item(report, desk.now_ns)
    assert desk.pilot.phase == "lost"


def answer(desk: Desk, _who: str, state: State) -> None:
    desk.pilot.on_item(OrderStatus(desk.last_order, state), desk.now_ns)


ACTS: dict[str, Callable[[Desk, str], object]] = {
    "lets go": lambda desk, who: desk.steer(who, robot=""),
    "leaves": lambda desk, who: desk.pilot.on_presence(who, present=False),
    "sends it": lambda desk, who: desk.send(who, THERE),
    "stops it": lambda desk, _who: desk.pilot.on_stop_request("stopped"),
    "loses it": lambda desk, _who: desk.pilot.on_item(LinkLost("gone"), desk.now_ns),
    "sees it fly": lambda desk, _who: desk.report((0.0, 0.0, 0.2), is_flying=True),
    "sees it down": lambda desk, _who: desk.report(),
    "has wanted it": partial(Desk.steer, age_s=100.0),
    **{mode: partial(Desk.steer, mode=mode) for mode in ("none", "follow", "goals", "land")},
    **{state: partial(answer, state=state) for state in STATES},
}


@given(
    acts=st.lists(st.tuples(st.sampled_from(PEOPLE), st.sampled_from(sorted(ACTS))), max_size=40),
    kind=st.sampled_from(["ground", "quadrotor"]),
)
def test_nothing_but_a_stop_is_ordered_while_nobody_steers(acts: list[tuple[str, str]], kind: str) -> None:
    desk = Desk(kind=kind)
    for who, what in acts:
        before = desk.last_order
        desk.point(who, THERE)
        ACTS[what](desk, who)
        owner = desk.pilot.user
        command = desk.step()
        if command is not None:
            assert command.order > before
            assert isinstance(command, Stop) or desk.pilot.user
        if owner and desk.pilot.user != owner:
            assert isinstance(command, Stop)
        assert desk.pilot.user or not desk.pilot.way_m


@pytest.mark.parametrize(("speed_mps", "is_told"), [(0.0, False), (0.09, False), (0.12, True)])
def test_a_robot_may_seem_to_creep_by_0_2_m_in_2_s_and_no_faster(speed_mps: float, *, is_told: bool) -> None:
    monitor = StandstillMonitor(RobotConfig(), "rover")
    told = [
        monitor.is_left(
            RobotReport(stamp_ns=tick * NS_PER_S // 50, position_m=(speed_mps * tick / 50, 0.0, 0.0)),
            tick * NS_PER_S // 50,
        )
        for tick in range(50 * 30)
    ]
    assert any(told) == is_told
    assert bool(monitor.problem) == is_told
