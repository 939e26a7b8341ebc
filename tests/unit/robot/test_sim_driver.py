"""The driver of simulated robots in virtual time: statuses, limits, refusals, a lost connection."""

import asyncio
import contextlib
import math
from collections.abc import AsyncGenerator
from dataclasses import replace
from pathlib import Path

import pytest

from pointit.runtime.clock import VirtualClock, run_virtually
from pointit.runtime.service.plugin_guard import NullHealth, Surroundings
from pointit.schemas import RobotKind
from pointit.services.robot.drivers.sim_driver import SIM, SimConfig
from pointit.services.robot.robot_driver import (
    Command,
    Follow,
    FollowPath,
    Land,
    OrderStatus,
    ReportItem,
    RobotDriver,
    RobotReport,
    Stop,
    TakeOff,
)
from tests.unit.robot.vda5050.agv_bench import SPEC


class Pilot:
    """Gives a driver commands, and collects what it reports."""

    def __init__(self, kind: RobotKind, clock: VirtualClock) -> None:
        spec = replace(SPEC, kind=kind)
        surroundings = Surroundings(clock=clock, health=NullHealth(), folder=Path("unused"))
        self.driver: RobotDriver = SIM.make(SimConfig(), spec, surroundings)
        self.items: list[ReportItem] = []

    @property
    def poses(self) -> list[RobotReport]:
        return [item for item in self.items if isinstance(item, RobotReport)]

    def states(self, order: int) -> list[str]:
        return [item.state for item in self.items if isinstance(item, OrderStatus) and item.order == order]

    @contextlib.asynccontextmanager
    async def connected(self) -> AsyncGenerator[None]:
        async with asyncio.TaskGroup() as group:
            task = group.create_task(self.driver.run(self.items.append))
            await asyncio.sleep(0.1)
            yield
            task.cancel()


def fly(
    *orders: tuple[Command, float], kind: RobotKind = "quadrotor", clock: VirtualClock | None = None
) -> Pilot:
    """Return the pilot after `orders`, each with the time of the loop until the next, s."""

    async def flight() -> Pilot:
        pilot = Pilot(kind, clock or VirtualClock())
        async with pilot.connected():
            for command, wait_s in orders:
                pilot.driver.command(command)
                await asyncio.sleep(wait_s)
        return pilot

    return run_virtually(flight())


def test_orders_are_active_and_done_and_a_replaced_one_is_cancelled() -> None:
    pilot = fly(
        (TakeOff(1, 0.5), 4.0),
        (FollowPath(2, ((5.0, 0.0, 0.5),)), 1.0),
        (Follow(3, (0.0, 0.0, 0.5)), 2.0),
        (Stop(4), 2.0),
        (Land(5), 10.0),
    )
    assert pilot.states(1) == ["active", "done"]
    assert pilot.states(2) == ["active", "cancelled"]
    assert pilot.states(3) == []
    assert pilot.states(4) == ["active", "done"]
    assert pilot.states(5) == ["active", "done"]
    assert not pilot.poses[-1].is_flying


@pytest.mark.parametrize("refused", [TakeOff(2, 1.0), Land(2)], ids=["take-off", "landing"])
def test_a_refused_order_says_why_and_leaves_the_one_before_alone(refused: Command) -> None:
    pilot = fly((FollowPath(1, ((1.0, 0.0, 0.0),)), 0.5), (refused, 4.0), kind="ground")
    assert pilot.states(1) == ["active", "done"]
    [said] = [item.reason for item in pilot.items if isinstance(item, OrderStatus) and item.order == 2]
    assert "ground robot" in said
    assert pilot.states(2) == ["refused"]
    assert pilot.poses[-1].position_m == pytest.approx((1.0, 0.0, 0.0), abs=0.03)


@pytest.mark.parametrize(
    "command",
    [
        Follow(1, (math.nan, 0.0, 0.0)),
        Follow(1, (1.0, 0.0, 0.0), max_speed_mps=-1.0),
        FollowPath(1, ((1.0, 0.0, 0.0),), max_speed_mps=math.nan),
        TakeOff(1, 0.0),
        Land(1, (0.0, math.nan, 0.0)),
    ],
)
def test_numbers_that_are_none_are_refused_and_move_nothing(command: Command) -> None:
    pilot = fly((command, 2.0))
    assert pilot.states(1) == ["refused"]
    assert {pose.position_m for pose in pilot.poses} == {(0.0, 0.0, 0.0)}


@pytest.mark.parametrize("kind", ["ground", "quadrotor"])
@pytest.mark.parametrize(
    "command",
    [Follow(2, (9.0, 0.0, 0.5), max_speed_mps=0.3), FollowPath(2, ((9.0, 0.0, 0.5),), max_speed_mps=0.3)],
    ids=["follow", "path"],
)
def test_a_speed_limit_of_an_order_is_kept(kind: RobotKind, command: Command) -> None:
    pilot = fly((TakeOff(1, 0.5), 4.0), (command, 4.0), kind=kind)
    assert 0.25 < max(math.hypot(*pose.velocity_mps[:2]) for pose in pilot.poses) < 0.301


def test_a_robot_that_is_connected_again_stops_instead_of_going_on() -> None:
    async def drive() -> Pilot:
        pilot = Pilot("ground", VirtualClock())
        async with pilot.connected():
            pilot.driver.command(Follow(1, (9.0, 0.0, 0.0)))
            await asyncio.sleep(2.0)
        async with pilot.connected():
            await asyncio.sleep(3.0)
        return pilot

    assert run_virtually(drive()).poses[-1].velocity_mps == (0.0, 0.0, 0.0)
