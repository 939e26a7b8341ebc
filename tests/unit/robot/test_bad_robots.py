"""Robots that break every promise: the person reads one sentence, and nothing moves that nobody steers."""

import asyncio
import itertools
import math

import pytest

from pointit.schemas import RobotState, Steering
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import ReportItem, RobotReport, Stop
from tests.unit.robot.flight import ROBOT, FaultyDriver, Pilotage, flown
from tests.unit.robot.test_robot_stops import at_full_speed, late, moved, speed_mps

GROUND = RobotConfig(kind="ground", aim_sigma_deg=0.5)
FLYER = RobotConfig(kind="quadrotor", aim_sigma_deg=0.5)
GOALS = Steering(stamp_ns=0, robot=ROBOT, mode="goals")
FOLLOW = Steering(stamp_ns=0, robot=ROBOT, mode="follow")
NOTHING = Steering(stamp_ns=0)
PLACE = (3.0, 1.0, 0.0)


def is_one_sentence(text: str) -> bool:
    """Return True if `text` says what is wrong and, after a colon, what to do."""
    return "\n" not in text and ": " in text and text == text.strip()


async def driving(pilotage: Pilotage, drivers: list[FaultyDriver]) -> FaultyDriver:
    """Let anna send a ground robot to a place; return its driver once it moves."""
    pilotage.arrive("anna", PLACE)
    await pilotage.until(lambda state: state.phase == "idle")
    await pilotage.take_for_goals("anna")
    pilotage.send("anna", PLACE)
    await pilotage.until(lambda state: state.phase == "moving" and math.hypot(*state.velocity_mps) > 0.5)
    return drivers[0]


async def name_anew(pilotage: Pilotage, steering: Steering) -> None:
    pilotage.steer("anna", NOTHING)
    await asyncio.sleep(0.2)
    pilotage.steer("anna", steering)


async def stands(pilotage: Pilotage, driver: FaultyDriver) -> RobotState:
    """Return the state once the robot has stopped, and stays so for 3 s."""
    for _ in range(300):
        if speed_mps(driver) < 0.05:
            break
        await asyncio.sleep(0.01)
    for _ in range(30):
        assert speed_mps(driver) < 0.1
        await asyncio.sleep(0.1)
    return pilotage.state


@flown(GROUND)
async def test_a_robot_that_vanishes_and_returns_moves_only_when_it_is_taken_again(
    pilotage: Pilotage, drivers: list[FaultyDriver]
) -> None:
    driver = await driving(pilotage, drivers)
    driver.change = lambda _item: ()
    lost = await pilotage.until(lambda state: state.phase == "lost")
    assert lost.user == ""
    assert is_one_sentence(lost.reason)
    driver.change = lambda item: (item,)
    state = await stands(pilotage, driver)
    assert (state.phase, state.user) == ("idle", "")
    await name_anew(pilotage, GOALS)
    await pilotage.until(lambda state: state.user == "anna")
    assert (await stands(pilotage, driver)).phase == "idle", "the old goal is over"
    pilotage.send("anna", PLACE)
    await pilotage.until(lambda state: math.dist(state.position_m, PLACE) < 0.1)


@flown(FLYER)
async def test_two_robots_that_report_under_one_name_do_not_move(
    pilotage: Pilotage, drivers: list[FaultyDriver]
) -> None:
    driver = await at_full_speed(pilotage, drivers)
    turns = itertools.cycle((0.0, 4.0))
    driver.change = lambda item: (moved(item, next(turns)),)
    state = await stands(pilotage, driver)
    assert (state.phase, state.user) == ("stopped", "")
    assert "no other robot has its name" in state.reason
    assert is_one_sentence(state.reason)
    await name_anew(pilotage, FOLLOW)
    assert (await stands(pilotage, driver)).user == "", "it cannot be taken meanwhile"


@flown(GROUND)
async def test_reports_twice_out_of_order_or_old_do_not_disturb(
    pilotage: Pilotage, drivers: list[FaultyDriver]
) -> None:
    driver = await driving(pilotage, drivers)
    old: list[ReportItem] = []

    def repeat(item: ReportItem) -> list[ReportItem]:
        if not isinstance(item, RobotReport):
            return [item]
        old.append(item)
        return [item, item, old[max(0, len(old) - 20)]]

    driver.change = repeat
    await pilotage.until(lambda state: math.dist(state.position_m, PLACE) < 0.1)
    assert pilotage.state.user == "anna"


@pytest.mark.parametrize("ahead_s", [-3600.0, 3600.0])
@flown(FLYER)
async def test_a_robot_with_another_time_is_not_steered(
    pilotage: Pilotage, drivers: list[FaultyDriver], ahead_s: float
) -> None:
    pilotage.arrive("anna", PLACE)
    await pilotage.until(lambda state: state.phase == "landed")
    drivers[0].change = lambda item: (late(item, -ahead_s),)
    await asyncio.sleep(2.0)
    pilotage.steer("anna", FOLLOW)
    state = await stands(pilotage, drivers[0])
    assert state.user == ""
    assert is_one_sentence(state.reason)
    assert all(isinstance(each, Stop) for each in drivers[0].commands)


@flown(GROUND)
async def test_a_robot_that_drives_on_is_told_again_and_again_to_stop(
    pilotage: Pilotage, drivers: list[FaultyDriver]
) -> None:
    driver = await driving(pilotage, drivers)
    driver.is_deaf = True
    gone_m, speed = 0.0, 1.0

    def drives_on(item: ReportItem) -> list[ReportItem]:
        nonlocal gone_m
        gone_m += 0.01 * speed
        return [moved(item, gone_m)]

    driver.change = drives_on
    pilotage.leave("anna")
    before = len(driver.commands)
    state = await pilotage.until(lambda state: "emergency stop" in state.reason)
    assert is_one_sentence(state.reason)
    await asyncio.sleep(5.0)
    assert 4 <= len(driver.commands[before:]) <= 8
    assert all(isinstance(each, Stop) for each in driver.commands[before:])
    speed = 0.0
    await pilotage.until(lambda state: state.reason == "")


@flown(GROUND.model_copy(update={"max_speed_mps": 0.6}))
async def test_a_goal_is_given_up_when_the_persons_arm_is_silent_for_a_second(
    pilotage: Pilotage, drivers: list[FaultyDriver]
) -> None:
    driver = await driving(pilotage, drivers)
    pilotage.point("anna", None)
    await asyncio.sleep(0.8)
    assert not isinstance(driver.commands[-1], Stop)
    await asyncio.sleep(0.4)
    assert isinstance(driver.commands[-1], Stop)
    pilotage.point("anna", PLACE)
    state = await stands(pilotage, driver)
    assert (state.user, state.target_m) == ("anna", None)
