"""The robot service, and robots that misbehave."""

import asyncio
import itertools
import math
from collections.abc import Callable
from typing import Any
from unittest import mock

import pytest

from pointit.bridges.agv_tracker.service import AgvTracker
from pointit.cli.robots import find_robots, rows, stop_robots
from pointit.runtime.config.config import Config
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import AnyService, Launch, check_launches
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import RobotPlan, RobotState, Steering
from pointit.schemas.environment import Frame
from pointit.schemas.topics import HEALTH, MAP, ROBOT_PLAN
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.robot_driver import (
    ROBOTS,
    Command,
    Report,
    ReportItem,
    RobotPlugin,
    RobotReport,
    Stop,
)
from pointit.services.robot.service import Robot
from pointit.services.robot_replay.service import RobotReplay
from tests.unit.robot.flight import ROBOT, ROOM, FaultyDriver, Pilotage, flown
from tests.unit.robot.test_robot_stops import at_full_speed, late, moved, speed_mps

FOLLOW = Steering(stamp_ns=0, robot=ROBOT, mode="follow")
NOTHING = Steering(stamp_ns=0)


@flown()
async def test_quadrotor_takes_off_hovers_and_lands_where_its_user_points(
    pilotage: Pilotage,
) -> None:
    pilotage.arrive("anna")
    landed = await pilotage.until(lambda state: state.phase == "landed")
    assert (landed.kind, landed.user, landed.reason) == ("quadrotor", "", "")

    pilotage.point("anna", (0.5, 1.0, 0.0))
    pilotage.steer("anna", FOLLOW)
    await pilotage.until(lambda state: state.phase == "taking_off" and state.user == "anna")

    await asyncio.sleep(10.0)
    hovering = pilotage.state
    assert (hovering.phase, hovering.reason) == ("idle", "")
    assert math.dist(hovering.position_m, (0.5, 1.0, 0.2)) < 0.1

    landing = FOLLOW.model_copy(update={"mode": "land", "target_m": (0.2, -1.0, 0.0)})
    pilotage.steer("anna", landing)
    await pilotage.until(lambda state: state.phase == "landing")

    down = await pilotage.until(lambda state: state.phase == "landed")
    assert math.dist(down.position_m, (0.2, -1.0, 0.0)) < 0.1
    assert down.user == ""

    pilotage.states.clear()
    await asyncio.sleep(2.0)
    assert {state.phase for state in pilotage.states} == {"landed"}

    seen = pilotage.objects[-1].objects[0]
    assert (seen.id, seen.kind, seen.position_m) == (ROBOT, "robot", pilotage.state.position_m)


@flown(RobotConfig(kind="ground"))
async def test_ground_robot_drives_along_way_points_to_its_goal(pilotage: Pilotage) -> None:
    pilotage.arrive("anna", (0.5, 1.0, 0.0))
    await pilotage.take_for_goals("anna")
    pilotage.send("anna", (0.5, 1.0, 0.0), (-0.5, 1.0, 0.0))
    moving = await pilotage.until(lambda state: state.phase == "moving")
    assert moving.target_m == (0.5, 1.0, 0.0)
    assert moving.goal_ns > 0
    await asyncio.sleep(0.3)
    assert pilotage.plans[-1].line_m[1:] == ((-0.5, 1.0, 0.0), (0.5, 1.0, 0.0))
    await pilotage.until(lambda _state: pilotage.plans[-1].line_m[1:] == ((0.5, 1.0, 0.0),))
    there = await pilotage.until(lambda state: state.phase == "idle")
    assert math.dist(there.position_m, (0.5, 1.0, 0.0)) < 0.15
    assert (there.user, there.goal_ns) == ("anna", 0)
    await asyncio.sleep(0.3)
    assert pilotage.plans[-1].line_m == ()


@flown(RobotConfig(kind="ground", frame="dock"))
async def test_poses_and_commands_are_converted_by_the_drivers_frame(pilotage: Pilotage) -> None:
    yaw = 1.2
    turned = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    frame = Frame(id="dock", position_m=(0.5, -0.2, 0.0), orientation_xyzw=turned)
    await pilotage.until(lambda state: "no frame 'dock'" in state.reason)
    pilotage.bench.put(MAP, ROOM.model_copy(update={"frames": (frame,), "stamp_ns": 2}))
    pilotage.arrive("anna", (0.5, 1.0, 0.0))
    idle = await pilotage.until(lambda state: state.phase == "idle")
    assert idle.position_m == (0.5, -0.2, 0.0)
    assert math.isclose(idle.yaw_rad, yaw)
    await pilotage.take_for_goals("anna")
    pilotage.send("anna", (0.5, 1.0, 0.0))
    await pilotage.until(lambda state: state.phase == "moving")
    there = await pilotage.until(lambda state: state.phase == "idle")
    assert math.dist(there.position_m, (0.5, 1.0, 0.0)) < 0.15


class Raises:
    """A driver that raises in `run`, and in `command`."""

    def __init__(self, *_arguments: object) -> None:
        self.reports = 0

    async def run(self, report: Report) -> None:
        for number in range(10):
            report(RobotReport(VirtualClock().now_ns(), (0.0, 0.0, 0.0), position_sigma_m=0.01 * number))
            await asyncio.sleep(0.1)
        raise LookupError("the robot speaks another language")

    def command(self, command: Command) -> None:
        raise KeyError(type(command).__name__)


def driven_by(make: type[Raises]) -> Callable[[Callable[[], None]], Callable[[], None]]:
    plugin = RobotPlugin(summary="", config=Config, make=make)
    return mock.patch.object(ROBOTS, "get", mock.Mock(return_value=plugin))


class Endless(Raises):
    async def run(self, report: Report) -> None:
        while True:
            await asyncio.sleep(0.1)
            report(RobotReport(VirtualClock().now_ns(), (0.0, 0.0, 0.0), math.inf))


@driven_by(Endless)
@flown(RobotConfig(kind="ground", frame="dock", start_m=(1.0, 0.0, 0.0)))
async def test_start_of_a_silent_robot_is_converted_from_its_frame(
    pilotage: Pilotage,
) -> None:
    frame = Frame(id="dock", position_m=(0.5, -0.2, 0.0), orientation_xyzw=(0.0, 0.0, 0.0, 1.0))
    health = pilotage.bench.collect(HEALTH, f"robot.{ROBOT}")
    pilotage.bench.put(MAP, ROOM.model_copy(update={"frames": (frame,), "stamp_ns": 2}))
    lost = await pilotage.until(lambda state: state.position_m == (1.5, -0.2, 0.0))
    assert lost.phase == "lost"
    await asyncio.sleep(3.0)
    said = " ".join(warning for each in health for warning in each.warnings)
    assert "no number" in said
    assert "ValueError" not in said


@driven_by(Raises)
@flown()
async def test_driver_that_raises_is_reported_and_restarted(
    pilotage: Pilotage,
) -> None:
    health = pilotage.bench.collect(HEALTH, f"robot.{ROBOT}")
    await pilotage.until(lambda state: state.phase == "landed")
    lost = await pilotage.until(lambda state: state.phase == "lost")
    assert lost.reason == "the driver of the robot has ended; it is started again"
    assert lost.reason_code == "lost"
    assert pilotage.objects[-1].objects == ()
    await pilotage.until(lambda state: state.phase == "landed")
    said = " ".join(warning for each in health for warning in each.warnings)
    assert "LookupError: the robot speaks another language" in said
    assert "command failed (KeyError: 'Stop')" in said


@flown()
async def test_robot_is_found_and_stopped_and_absent_ones_are_reported(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "landed")
    bus = pilotage.bench.bus
    (row,) = rows(await find_robots(bus))
    assert (row["robot"], row["kind"], row["phase"], row["user"]) == (ROBOT, "quadrotor", "landed", "")
    assert (row["x_m"], row["reason"]) == (0.0, "")
    problems = await stop_robots(bus, [ROBOT, "nobody"], "a child runs there")
    assert list(problems) == ["nobody"]
    stopped = await pilotage.until(lambda state: bool(state.reason))
    assert "(a child runs there)" in stopped.reason


@flown()
async def test_robot_whose_process_was_killed_is_listed_as_lost(pilotage: Pilotage) -> None:
    await pilotage.until(lambda state: state.phase == "landed")
    pilotage.bench.put(ROBOT_PLAN, RobotPlan(stamp_ns=1), "cart")  # as the keeper has it
    there, gone = sorted(rows(await find_robots(pilotage.bench.bus)), key=lambda row: row["phase"] == "lost")
    assert there["robot"] == ROBOT
    assert (gone["robot"], gone["phase"], gone["x_m"]) == ("cart", "lost", None)
    assert "process has ended" in str(gone["reason"])


AGV = {"broker": "hub", "manufacturer": "acme", "serial_number": "7"}


@pytest.mark.parametrize(
    ("service", "parameters", "problem"),
    [
        (Robot, {"driver": "vda5050"}, "robot.one: broker: is missing"),
        (Robot, {"driver": "vda5050", "vda5050": {"broker": "hub"}}, "robot.one: manufacturer: is missing"),
        (
            Robot,
            {"driver": "ros2", "ros2": {"backend": {"endpoint": "hub"}}},
            "robot.one: backend.endpoint: ",
        ),
        (AgvTracker, {}, "agv-tracker.one: broker: is missing"),
        (AgvTracker, {"broker": "hub", "username": "me", "password_file": "/none"}, "password_file: /none"),
        (RobotReplay, {}, "robot-replay.one: recording: is missing"),
    ],
)
def test_wrong_parameters_are_refused_before_the_service_starts(
    service: type[AnyService], parameters: dict[str, Any], problem: str
) -> None:
    config = service.CONFIG.model_validate(parameters)
    with pytest.raises(ConfigError, match=problem):
        check_launches([Launch(service=service, config=config, name="one")])


GROUND = RobotConfig(kind="ground", aim_sigma_deg=0.5)
FLYER = RobotConfig(kind="quadrotor", aim_sigma_deg=0.5)
GOALS = Steering(stamp_ns=0, robot=ROBOT, mode="goals")
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
async def test_robot_that_returns_moves_only_when_taken_again(
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
async def test_robot_with_another_time_is_not_steered(
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
async def test_robot_that_drives_on_gets_repeated_orders_to_stop(
    pilotage: Pilotage, drivers: list[FaultyDriver]
) -> None:
    driver = await driving(pilotage, drivers)
    driver.is_deaf = True
    gone_m = 0.0
    speed = 1.0

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
async def test_goal_is_given_up_when_the_arm_is_silent(
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
