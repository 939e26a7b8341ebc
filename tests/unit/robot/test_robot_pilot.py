"""Persons who steer a robot, and figures that it flies for localizations."""

import asyncio
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Localization, Steering, UserPose
from pointit.schemas.topics import LOCALIZATION, SERVICE_ALIVE
from pointit.services.robot import figure_flight
from pointit.services.robot.config import FigureConfig, RobotConfig
from pointit.services.robot.current_order import CurrentOrder, StandstillMonitor
from pointit.services.robot.figure_flight import (
    NO_FIGURE,
    AssumedPerson,
    FigureFlight,
    figures,
    position_sigmas_m,
)
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
from tests.unit.robot.flight import ROBOT, Pilotage, flown
from tests.unit.robot.permits import Desk, Permits

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


def test_robot_is_stopped_at_its_first_report_after_each_loss() -> None:
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


def test_robot_is_reported_as_silent_after_the_report_timeout() -> None:
    desk = Desk(report_timeout_s=1.0)
    desk.step()
    assert (desk.pilot.phase, desk.pilot.reason) == ("lost", "")
    desk.step(1.0)
    assert (desk.pilot.phase, desk.pilot.reason) == ("lost", "")
    desk.step()
    assert (desk.pilot.phase, desk.pilot.reason[:7]) == ("lost", "nothing")


def test_robot_goes_to_the_first_claimant_then_to_the_next() -> None:
    desk = desk_of("anna")
    desk.steer("ben")
    desk.step()
    assert desk.pilot.user == "anna"
    desk.steer("anna", robot="other")
    assert isinstance(desk.step(), Stop)
    assert desk.pilot.user == "ben"


@pytest.mark.parametrize("purpose", ["anchor", "pose"])
def test_user_localized_by_following_their_robot_has_let_go(purpose: Literal["anchor", "pose"]) -> None:
    desk = desk_of("anna")
    desk.safety.stop_reason = StopReason("not_pointing", "it waits until anna is localized", is_freeing=False)
    assert isinstance(desk.step(), Stop)
    follows = Localization(
        stamp_ns=0, phase="sampling", target_id=ROBOT, purpose=purpose, since_ns=desk.now_ns
    )
    desk.pilot.on_localization("anna", follows)
    desk.step()
    assert desk.pilot.user == ("anna" if purpose == "anchor" else "")


def test_user_who_leaves_has_let_go() -> None:
    desk = desk_of("anna")
    desk.send("anna", THERE)
    assert isinstance(desk.step(), FollowPath)
    desk.pilot.on_presence("anna", present=False)
    assert isinstance(desk.step(), Stop)
    assert desk.pilot.user == ""
    desk.pilot.on_presence("anna", present=True)
    desk.step()
    assert desk.pilot.user == ""  # what they wanted before they left counts no more


def test_robot_goes_to_new_requests_only_after_a_stop() -> None:
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
def test_requests_from_before_the_connection_move_nothing(age_s: float) -> None:
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
def test_request_repeated_after_the_first_report_moves_nothing(age_s: float) -> None:
    desk = ready_desk()
    desk.steer("anna", age_s=age_s)
    assert [desk.step() for _ in range(50)] == [None] * 50
    assert desk.pilot.user == ""


def test_landing_continues_when_its_user_lowers_the_arm() -> None:
    desk = flying_desk()
    desk.safety.place_problem = "you are not pointing: point at the place"
    desk.steer("anna", "land", target_m=(0.2, 0.3, 0.0))
    order = desk.step()
    assert isinstance(order, Land)
    assert (order.position_m, order.max_speed_mps) == ((0.2, 0.3, 0.0), 1.0), "slow near people"


def test_takeoff_that_does_not_happen_is_abandoned_and_reported() -> None:
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


def test_landing_takes_its_time_while_the_robot_moves() -> None:
    desk = flying_desk()
    desk.steer("anna", "land", target_m=(0.2, 0.3, 0.0))
    assert isinstance(desk.step(), Land)
    for number in range(5):
        desk.report((0.3 * number, 0.0, 0.2), is_flying=True)
        assert desk.step(10.0) is None
    assert isinstance(desk.step(15.1), Stop)
    assert "not landed" in desk.pilot.reason


def test_user_who_may_not_steer_gets_the_reason_instead() -> None:
    desk = ready_desk(kind="ground")
    desk.safety.person_problem = "your position is unknown: localize first"
    desk.steer("anna", "goals")
    desk.step()
    assert (desk.pilot.user, desk.pilot.reason) == ("", "your position is unknown: localize first")
    desk.safety.person_problem = ""
    desk.step()
    assert (desk.pilot.user, desk.pilot.reason) == ("anna", "")


def test_quadrotor_follows_above_the_floor_and_hovers_when_pointed_elsewhere() -> None:
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
def test_order_that_is_refused_is_said_and_not_repeated(
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


def test_answers_about_earlier_orders_are_ignored_and_silence_is_reported() -> None:
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
def test_robot_gets_only_stops_while_nobody_steers(acts: list[tuple[str, str]], kind: str) -> None:
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
def test_standstill_monitor_permits_drift_of_0_2_m_in_2_s(speed_mps: float, *, is_told: bool) -> None:
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


SAMPLING = Localization(stamp_ns=0, phase="sampling", target_id=ROBOT)
SOLVED = SAMPLING.model_copy(update={"phase": "solved"})
STANDS = RobotReport(stamp_ns=0, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0)
QUADROTOR = RobotConfig(kind="quadrotor", figure=FigureConfig(people_m=((2.5, 0.0, 0.0),)))
GROUND = QUADROTOR.model_copy(update={"kind": "ground"})


def begin(pilotage: Pilotage, ago_s: float = 0.0, user: str = "anna", **changes: object) -> None:
    """Say that a person is localized by the robot, since `ago_s`."""
    since_ns = pilotage.bench.clock.now_ns() - round(ago_s * 1e9)
    sampling = SAMPLING.model_copy(update={"since_ns": since_ns, **changes})
    pilotage.bench.put(LOCALIZATION, sampling, user)


@flown(QUADROTOR)
async def test_quadrotor_flies_figures_and_lands_when_the_person_is_localized(
    pilotage: Pilotage,
) -> None:
    await pilotage.until(lambda state: state.phase == "landed")
    begin(pilotage)
    await pilotage.until(lambda state: state.phase == "taking_off" and state.user == "")
    await pilotage.until(lambda state: state.phase == "moving")
    away = await pilotage.until(lambda state: math.hypot(*state.position_m[:2]) > 0.4)
    assert away.position_m[2] > 0.3
    await pilotage.until(lambda state: math.hypot(*state.position_m[:2]) < 0.2, 30.0)
    await pilotage.until(lambda state: math.hypot(*state.position_m[:2]) > 0.4, 30.0)
    assert all(math.dist(state.position_m[:2], (2.5, 0.0)) > 1.2 for state in pilotage.states)
    pilotage.bench.put(LOCALIZATION, SOLVED, "anna")
    await pilotage.until(lambda state: state.phase == "landing")
    await pilotage.until(lambda state: state.phase == "landed")


@flown(QUADROTOR)
async def test_figure_needs_a_localization_by_this_robot_without_a_user(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "landed")
    for other in ({"target_id": "led_1"}, {"purpose": "anchor"}, {"ahead": ("ben",)}, {"phase": "refused"}):
        pilotage.bench.put(
            LOCALIZATION,
            SAMPLING.model_copy(update={"since_ns": pilotage.bench.clock.now_ns(), **other}),
            "anna",
        )
        await asyncio.sleep(0.5)
        assert pilotage.state.phase == "landed"
    pilotage.arrive("ben", (0.5, 0.0, 0.0))

    pilotage.steer("ben", Steering(stamp_ns=0, robot=ROBOT, mode="follow"))
    await pilotage.until(lambda state: state.user == "ben")
    begin(pilotage)
    await asyncio.sleep(8.0)
    assert math.dist(pilotage.state.position_m, (0.5, 0.0, 0.2)) < 0.15


@flown(QUADROTOR)
async def test_quadrotor_takes_off_for_a_figure_only_with_room_above(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "landed")
    pilotage.arrive("bob")
    pilotage.pose("bob", (0.3, 0.0, 0.0))
    begin(pilotage)
    await pilotage.until(lambda state: "too near to bob" in state.reason)
    await asyncio.sleep(3.0)
    assert {state.phase for state in pilotage.states} <= {"lost", "landed"}


@flown(GROUND)
async def test_figure_ends_with_the_localizer_and_needs_a_recent_localization(
    pilotage: Pilotage,
) -> None:
    await pilotage.until(lambda state: state.phase == "idle")
    begin(pilotage, ago_s=200.0)
    await asyncio.sleep(3.0)
    assert pilotage.state.phase == "idle"
    localizer = pilotage.bench.bus.announce(SERVICE_ALIVE, "localizer.anna")
    begin(pilotage)
    await pilotage.until(lambda state: state.phase == "moving")
    localizer.close()
    await pilotage.until(lambda state: state.phase == "idle")
    await asyncio.sleep(3.0)
    assert pilotage.state.phase == "idle"


@flown(RobotConfig(kind="ground", figure=FigureConfig(people_m=((0.9, 0.0, 0.0),))))
async def test_robot_without_room_says_so_and_stays(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "idle")
    begin(pilotage)
    without_room = await pilotage.until(lambda state: state.reason == NO_FIGURE)
    assert (without_room.phase, without_room.reason_code) == ("idle", "no_figure")
    pilotage.bench.put(LOCALIZATION, SOLVED, "anna")
    await pilotage.until(lambda state: state.reason == "")


def test_figure_is_for_places_of_people_not_localized_yet() -> None:
    figure = FigureConfig(people_m=((2.5, 0.0, 0.0), (0.0, 2.5, 0.0)))
    flight = FigureFlight(RobotConfig(figure=figure), ROBOT)
    tracked = UserPose(stamp_ns=1, position_m=(2.3, 0.2, 0.0), yaw_rad=0.0)
    flight.on_localization("ben", SAMPLING)
    flight.on_pose("anna", tracked)
    flight.on_pose("ben", tracked.model_copy(update={"position_m": (0.0, 2.5, 0.0)}))  # looked for again
    assert [each.place_m for each in flight.people((0.0, 0.0, 0.0), is_flying=False)] == [(0.0, 2.5, 0.0)]


def test_stopped_robot_is_free_though_others_wait_to_be_localized() -> None:
    flight = FigureFlight(GROUND, ROBOT)
    flight.on_localization("ben", SAMPLING)
    assert flight.command(STANDS, CurrentOrder(), Permits(), 0) is not None
    assert "until ben is found" in flight.take_problem("anna", 0)
    flight.forget()  # it stays stopped until somebody takes it
    assert flight.take_problem("anna", 0) == ""


def test_figure_is_less_informative_when_there_is_little_room() -> None:
    flight = FigureFlight(GROUND, ROBOT)
    flight.on_localization("ben", SAMPLING)
    safety = Permits()
    tried: list[object] = []

    def barred(points_m: Sequence[Vec3]) -> str:
        tried.append(points_m)
        return "fence" if len(tried) < 14 else ""

    safety.way_problem = barred  # pyrefly: ignore[method-assign]
    assert flight.command(STANDS, CurrentOrder(), safety, 0) is not None


def test_figure_takes_the_time_that_is_configured() -> None:
    config = GROUND.model_copy(update={"max_speed_mps": 0.5, "figure": FigureConfig(duration_s=8.0)})
    flight = FigureFlight(config, ROBOT)
    flight.on_localization("ben", SAMPLING)
    path = flight.command(STANDS, CurrentOrder(), Permits(), 0)
    assert isinstance(path, FollowPath)
    points_m = np.array([STANDS.position_m, *path.points_m])
    assert np.linalg.norm(np.diff(points_m, axis=0), axis=1).sum() == pytest.approx(0.5 * 8.0, rel=0.01)


AWAY: Vec3 = (2.5, 0.5, 1.2)
PERSON = AssumedPerson((0.0, 0.0, 0.0), 1.5)


def sigma_m(points: np.ndarray) -> float:
    return float(position_sigmas_m(points[None], np.array([PERSON.place_m]), 5.0)[0, 0])


@pytest.mark.parametrize("start", [AWAY, (2.5, 0.5, 0.0)])
def test_best_figure_beats_circle_and_line_of_the_same_length(start: Vec3) -> None:
    best = figures(start, [PERSON], speed_mps=1.0, duration_s=5.0, is_flying=start[2] > 0.0)[0]
    turned = np.linspace(0.0, math.tau, 25)
    radius_m = 5.0 / math.tau
    away = np.array(start) + np.stack(
        [radius_m * (1.0 - np.cos(turned)), radius_m * np.sin(turned), 0.0 * turned], axis=1
    )
    across = np.array(start) + np.stack([0.0 * turned, 1.25 * np.sin(turned), 0.0 * turned], axis=1)
    assert best.sigma_m < 0.8 * sigma_m(away)
    assert best.sigma_m < 0.8 * sigma_m(across)
    assert best.sigma_m < 0.3
    longer = figures(start, [PERSON], speed_mps=0.25, duration_s=20.0, is_flying=start[2] > 0.0)[0]
    assert longer.sigma_m < 0.8 * best.sigma_m


@given(st.floats(1.6, 5.0), st.floats(-math.pi, math.pi), st.floats(1.0, 6.0), st.sampled_from([0.0, 1.2]))
@settings(max_examples=20, deadline=None)
def test_figures_are_closed_of_requested_length_and_clear_of_people(
    reach_m: float, way_rad: float, length_m: float, height_m: float
) -> None:
    start = (reach_m * math.cos(way_rad), reach_m * math.sin(way_rad), height_m)
    found = figures(start, [PERSON], speed_mps=length_m / 5.0, duration_s=5.0, is_flying=height_m > 0.0)
    assert found == sorted(found, key=lambda figure: figure.sigma_m)
    for each in found:
        points = np.array(each.points_m)
        assert points[0] == pytest.approx(start)
        assert points[-1] == pytest.approx(start, abs=1e-6)
        assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(length_m, rel=0.01)
        assert np.hypot(points[:, 0], points[:, 1]).min() >= 1.5
        assert height_m > 0.0 or (points[:, 2] == 0.0).all()


@pytest.mark.parametrize("start", [AWAY, (2.5, 0.5, 0.0)])
def test_unknown_latency_costs_little_on_the_best_figure(
    monkeypatch: pytest.MonkeyPatch, start: Vec3
) -> None:
    """The tracker is late, at constant speed: a circle turns the pose by it, and no residual tells."""
    best = even(
        np.array(
            figures(start, [PERSON], speed_mps=0.8, duration_s=5.0, is_flying=start[2] > 0.0)[0].points_m
        )
    )
    turned = np.linspace(0.0, math.tau, 101)
    circle = np.array(start) + 4.0 / math.tau * np.stack(
        [1.0 - np.cos(turned), np.sin(turned), 0.0 * turned], axis=1
    )
    sigmas_m: list[tuple[float, float]] = []
    for late_s in (0.001, 0.5):
        monkeypatch.setattr(figure_flight, "PRIOR", np.append(figure_flight.PRIOR[:4], late_s**-2))
        sigmas_m.append((sigma_m(best), sigma_m(circle)))
    (best_m, circle_m), (best_late_m, circle_late_m) = sigmas_m

    assert best_late_m < 2.0 * best_m
    assert circle_late_m > 4.0 * circle_m


def even(points: np.ndarray) -> np.ndarray:
    """Return 101 points at equal distances along `points` (n x 3)."""
    passed_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    wanted_m = np.arange(101) * float(passed_m[-1]) / 100.0
    return np.stack([np.interp(wanted_m, passed_m, points[:, axis]) for axis in range(3)], axis=1)
