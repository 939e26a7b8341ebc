"""A robot that nobody steers flies a figure while somebody is localized by it, and no longer."""

import asyncio
import math

import pytest

from pointit.schemas import Localization, Steering, UserPose
from pointit.schemas.topics import LOCALIZATION, SERVICE_ALIVE
from pointit.services.robot.config import FigureConfig, RobotConfig
from pointit.services.robot.current_order import CurrentOrder
from pointit.services.robot.figure_flight import NO_FIGURE, FigureFlight
from pointit.services.robot.robot_driver import RobotReport
from tests.unit.robot.flight import ROBOT, Pilotage, flown

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
async def test_a_quadrotor_takes_off_flies_figures_and_lands_when_the_person_is_found(
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


@flown(GROUND)
async def test_a_ground_robot_drives_a_figure_and_stops(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "idle")
    begin(pilotage)
    await pilotage.until(lambda state: state.phase == "moving")
    await pilotage.until(lambda state: math.hypot(*state.position_m) > 0.4)
    pilotage.bench.put(LOCALIZATION, SOLVED, "anna")
    stopped = await pilotage.until(lambda state: state.phase == "idle")
    assert stopped.position_m[2] == pytest.approx(0.0)


@flown(QUADROTOR)
async def test_nobody_else_s_localization_moves_it_and_who_steers_it_keeps_it(pilotage: Pilotage) -> None:
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
async def test_a_quadrotor_takes_off_for_a_figure_only_with_room_above_it(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "landed")
    pilotage.arrive("bob")
    pilotage.pose("bob", (0.3, 0.0, 0.0))
    begin(pilotage)
    await pilotage.until(lambda state: "too near to bob" in state.reason)
    await asyncio.sleep(3.0)
    assert {state.phase for state in pilotage.states} <= {"lost", "landed"}


@flown(GROUND)
async def test_a_figure_ends_with_the_localizer_and_an_old_localization_begins_none(
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
async def test_a_robot_without_room_says_so_and_stays(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "idle")
    begin(pilotage)
    await pilotage.until(lambda state: state.reason == NO_FIGURE)
    assert pilotage.state.phase == "idle"
    pilotage.bench.put(LOCALIZATION, SOLVED, "anna")
    await pilotage.until(lambda state: state.reason == "")


@flown(GROUND)
async def test_who_is_found_gets_the_robot_only_when_nobody_else_follows_it(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "idle")
    begin(pilotage)
    begin(pilotage, user="ben")
    await pilotage.until(lambda state: state.phase == "moving")
    pilotage.bench.put(LOCALIZATION, SOLVED, "anna")
    pilotage.arrive("anna", (0.5, 0.0, 0.0))
    pilotage.steer("anna", Steering(stamp_ns=0, robot=ROBOT, mode="goals"))
    barred = await pilotage.until(lambda state: "until ben is found" in state.reason)
    assert (barred.user, barred.phase) == ("", "moving")
    await asyncio.sleep(1.0)
    pilotage.bench.put(LOCALIZATION, SOLVED, "ben")
    await pilotage.take_for_goals("anna")


def test_a_figure_is_for_the_places_of_those_who_are_not_found_yet() -> None:
    figure = FigureConfig(people_m=((2.5, 0.0, 0.0), (0.0, 2.5, 0.0)))
    flight = FigureFlight(RobotConfig(figure=figure), ROBOT)
    tracked = UserPose(stamp_ns=1, position_m=(2.3, 0.2, 0.0), yaw_rad=0.0)
    flight.on_localization("ben", SAMPLING)
    flight.on_pose("anna", tracked)
    flight.on_pose("ben", tracked.model_copy(update={"position_m": (0.0, 2.5, 0.0)}))  # looked for again
    assert [each.place_m for each in flight.people((0.0, 0.0, 0.0), is_flying=False)] == [(0.0, 2.5, 0.0)]


def test_a_robot_that_was_stopped_is_free_for_who_was_found_though_others_wait() -> None:
    flight = FigureFlight(GROUND, ROBOT)
    flight.on_localization("ben", SAMPLING)
    assert flight.command(STANDS, CurrentOrder(), lambda _: "", lambda _: 1.0, 0) is not None
    assert "until ben is found" in flight.take_problem("anna", 0)
    flight.forget()  # it stays stopped until somebody takes it
    assert flight.take_problem("anna", 0) == ""


def test_a_less_informative_figure_is_flown_where_people_and_fences_leave_room_for_it_only() -> None:
    flight = FigureFlight(GROUND, ROBOT)
    flight.on_localization("ben", SAMPLING)
    tried: list[object] = []

    def barred(points: object) -> str:
        tried.append(points)
        return "fence" if len(tried) < 14 else ""

    assert flight.command(STANDS, CurrentOrder(), barred, lambda _: 1.0, 0) is not None
