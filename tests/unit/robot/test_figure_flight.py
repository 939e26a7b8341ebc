"""A robot that nobody steers flies a figure while somebody is localized by it, and no longer."""

import asyncio
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.geometry.vector import Vec3
from pointit.schemas import Localization, Steering, UserPose
from pointit.schemas.topics import LOCALIZATION, SERVICE_ALIVE
from pointit.services.robot import figure_flight
from pointit.services.robot.config import FigureConfig, RobotConfig
from pointit.services.robot.current_order import CurrentOrder
from pointit.services.robot.figure_flight import (
    NO_FIGURE,
    AssumedPerson,
    FigureFlight,
    figures,
    position_sigmas_m,
)
from pointit.services.robot.robot_driver import RobotReport
from tests.unit.robot.flight import ROBOT, Pilotage, flown
from tests.unit.robot.permits import Permits

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
    assert flight.command(STANDS, CurrentOrder(), Permits(), 0) is not None
    assert "until ben is found" in flight.take_problem("anna", 0)
    flight.forget()  # it stays stopped until somebody takes it
    assert flight.take_problem("anna", 0) == ""


def test_a_less_informative_figure_is_flown_where_people_and_fences_leave_room_for_it_only() -> None:
    flight = FigureFlight(GROUND, ROBOT)
    flight.on_localization("ben", SAMPLING)
    safety = Permits()
    tried: list[object] = []

    def barred(points_m: Sequence[Vec3]) -> str:
        tried.append(points_m)
        return "fence" if len(tried) < 14 else ""

    safety.way_problem = barred  # pyrefly: ignore[method-assign]
    assert flight.command(STANDS, CurrentOrder(), safety, 0) is not None


AWAY: Vec3 = (2.5, 0.5, 1.2)
PERSON = AssumedPerson((0.0, 0.0, 0.0), 1.5)


def sigma_m(points: np.ndarray) -> float:
    return float(position_sigmas_m(points[None], np.array([PERSON.place_m]))[0, 0])


@pytest.mark.parametrize("start", [AWAY, (2.5, 0.5, 0.0)])
def test_the_best_figure_tells_more_than_a_circle_and_a_line_of_the_same_length(start: Vec3) -> None:
    best = figures(start, [PERSON], length_m=5.0, is_flying=start[2] > 0.0)[0]
    turned = np.linspace(0.0, math.tau, 25)
    radius_m = 5.0 / math.tau
    away = np.array(start) + np.stack(
        [radius_m * (1.0 - np.cos(turned)), radius_m * np.sin(turned), 0.0 * turned], axis=1
    )
    across = np.array(start) + np.stack([0.0 * turned, 1.25 * np.sin(turned), 0.0 * turned], axis=1)
    assert best.sigma_m < 0.8 * sigma_m(away)
    assert best.sigma_m < 0.8 * sigma_m(across)
    assert best.sigma_m < 0.3


@given(st.floats(1.6, 5.0), st.floats(-math.pi, math.pi), st.floats(1.0, 6.0), st.sampled_from([0.0, 1.2]))
@settings(max_examples=20, deadline=None)
def test_figures_are_closed_as_long_as_asked_and_away_from_people(
    reach_m: float, way_rad: float, length_m: float, height_m: float
) -> None:
    start = (reach_m * math.cos(way_rad), reach_m * math.sin(way_rad), height_m)
    found = figures(start, [PERSON], length_m=length_m, is_flying=height_m > 0.0)
    assert found == sorted(found, key=lambda figure: figure.sigma_m)
    for each in found:
        points = np.array(each.points_m)
        assert points[0] == pytest.approx(start)
        assert points[-1] == pytest.approx(start, abs=1e-6)
        assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(length_m, rel=0.01)
        assert np.hypot(points[:, 0], points[:, 1]).min() >= 1.5
        assert height_m > 0.0 or (points[:, 2] == 0.0).all()


@pytest.mark.parametrize("start", [AWAY, (2.5, 0.5, 0.0)])
def test_an_unknown_latency_costs_little_on_the_best_figure_and_much_on_a_circle(
    monkeypatch: pytest.MonkeyPatch, start: Vec3
) -> None:
    """The tracker is late, at constant speed: a circle turns the pose by it, and no residual tells."""
    best = even(np.array(figures(start, [PERSON], length_m=4.0, is_flying=start[2] > 0.0)[0].points_m))
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
