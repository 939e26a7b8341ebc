"""The driver `ros2` keeps the promises of robot drivers, with a drone and with a robot of Nav2."""

import asyncio
import itertools
import math
from abc import ABC, abstractmethod
from typing import Any

import pytest

from pointit.bridges.ros2.robot.driver import Ros2Driver
from pointit.bridges.ros2.robot.goal_book import GoalStatus
from pointit.bridges.ros2.robot.plugin import ROS2
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.testing import FakeDevice, RobotContract
from tests.unit.ros2.robot.fake_nav2 import FakeNav2
from tests.unit.ros2.scenes import jazzy, triple

POSE = "geometry_msgs/msg/PoseStamped"
SETPOINTS = "/setpoints"
TICK_S = 0.05
SPEED_MPS = 1.0
LAG_S = 0.15

NUMBERS = itertools.count(1)
DEVICES: dict[int, "FakeRobot"] = {}
"""Fake robots by the domain in which each is alone."""


class FakeRobot(FakeDevice, ABC):
    """A robot in a graph of its own; while it is plugged it publishes its pose, and moves as it is told."""

    def __init__(self) -> None:
        super().__init__()
        self.graph = FakeNav2()
        self.at_m: Vec3 = (0.0, 0.0, 0.0)
        self.speed_mps = 0.0
        self.domain = next(NUMBERS) % 200
        self._living: asyncio.Task[None] | None = None
        DEVICES[self.domain] = self

    async def plug(self) -> None:
        self._living = asyncio.create_task(self._live())

    async def unplug(self) -> None:
        living = self._living
        self._living = None
        if living is not None:
            living.cancel()
            await asyncio.wait({living})
        self.speed_mps = 0.0

    @abstractmethod
    def moved(self) -> Vec3:
        """Return where it is a tick later."""

    async def _live(self) -> None:
        while True:
            before_m = self.at_m
            self.at_m = self.moved()
            self.speed_mps = vector.norm(vector.subtract(self.at_m, before_m)) / TICK_S
            message = jazzy().make(POSE)
            message.pose.position = triple("Point", self.at_m)
            if "/pose" in self.graph.readers:
                self.graph.readers["/pose"](jazzy().encode(POSE, message))
            await asyncio.sleep(TICK_S)


class FakeDrone(FakeRobot):
    """Goes to the newest set-point with a lag."""

    def moved(self) -> Vec3:
        sent = self.graph.sent.get(SETPOINTS)
        if not sent:
            return self.at_m
        target = jazzy().decode(POSE, sent[-1]).pose.position
        left = vector.subtract((target.x, target.y, target.z), self.at_m)
        x, y, z = vector.add(self.at_m, vector.scale(left, 1.0 - math.exp(-TICK_S / LAG_S)))
        return x, y, max(z, 0.0)


class FakeRover(FakeRobot):
    """Drives to the newest goal that has not ended, and ends it there."""

    def moved(self) -> Vec3:
        open_goals = [goal for goal, end in self.graph.ends.items() if not end.done()]
        if not open_goals:
            return self.at_m
        for old in open_goals[:-1]:
            self.graph.end(old, GoalStatus.ABORTED)
        target = self.graph.goals[open_goals[-1]].pose.pose.position
        left = vector.subtract((target.x, target.y, target.z), self.at_m)
        left_m = vector.norm(left)
        if left_m <= SPEED_MPS * TICK_S:
            self.graph.end(open_goals[-1], GoalStatus.SUCCEEDED)
            return target.x, target.y, target.z
        return vector.add(self.at_m, vector.scale(left, SPEED_MPS * TICK_S / left_m))


def types_of(_distro: str) -> Types:
    return jazzy()


@pytest.fixture(autouse=True)
def _joins_the_graph_of_its_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    async def opened(config: Any, *_others: Any, **_more: Any) -> FakeNav2:
        return DEVICES[config.domain_id].graph

    driver = Ros2Driver.__module__
    monkeypatch.setattr(f"{driver}.opened", opened)
    monkeypatch.setattr(f"{driver}.Types", types_of)


class TestRover(RobotContract):
    plugin = ROS2
    virtual_time = True
    shows_motion = True
    device = FakeRover

    def parameters(self, device: FakeRobot) -> dict[str, Any]:
        return {"backend": {"domain_id": device.domain}, "pose": {"topic": "/pose"}}

    def is_moving(self, device: FakeRobot) -> bool:
        return device.speed_mps > 0.05


class TestDrone(TestRover):
    kind = "quadrotor"
    device = FakeDrone

    def parameters(self, device: FakeRobot) -> dict[str, Any]:
        return {**super().parameters(device), "control": "setpoints", "setpoint_topic": SETPOINTS}
