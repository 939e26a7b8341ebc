"""A node of ours on the stand-in for rclpy, and what it says."""

import threading
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import Graph, Qos, RosType
from pointit.bridges.ros2.graph.backends import opened
from pointit.bridges.ros2.over_rclpy import backend as rclpy_backend
from pointit.bridges.ros2.over_rclpy.backend import RclpyBackend
from tests.unit.ros2 import fake_rclpy
from tests.unit.ros2.fake_rclpy import Wire
from tests.unit.ros2.graph_of_one import Shown

BOOL = RosType(name="std_msgs/msg/Bool", hash=fake_rclpy.Bool.HASH)
SET = RosType(name="std_srvs/srv/SetBool", hash="RIHS01_" + "5" * 64)
QOS = Qos(depth=10)
TRUE = b"\0\1\0\0\1"
PADDED = TRUE + b"\0\0\0"


class Ours(Shown):
    """A node of ours, and what it says."""

    backend: RclpyBackend

    def __init__(self) -> None:
        super().__init__()
        self.graphs: list[Graph] = []

    def sees(self, kind: str, name: str) -> bool:
        ends = self.graphs[-1].endpoints
        return any((each.kind, each.name, each.is_ours) == (kind, name, False) for each in ends)


@asynccontextmanager
async def node_of_ours(**settings: Any) -> AsyncGenerator[Ours]:
    ours = Ours()
    config = BackendConfig.model_validate({"kind": "dds", "node": "/site1/pointit", **settings})
    backend = await opened(config, ours)
    assert isinstance(backend, RclpyBackend)
    ours.backend = backend
    backend.watch(ours.graphs.append)
    try:
        yield ours
    finally:
        await backend.close()
        assert not [each for each in threading.enumerate() if each.name == "rclpy-spin"]


def on_a_wire(monkeypatch: pytest.MonkeyPatch, *, has_info: bool = True) -> Wire:
    """Install the stand-in, in a terminal that says nothing of ROS; the graph is looked at often."""
    for variable in ("ROS_DOMAIN_ID", "ROS_DISTRO"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(rclpy_backend, "LOOK_S", 0.02)
    return fake_rclpy.installed(monkeypatch, has_info=has_info)


def profile(*, latched: bool = False) -> fake_rclpy.Profile:
    kept = fake_rclpy.Durability.TRANSIENT_LOCAL if latched else fake_rclpy.Durability.VOLATILE
    return fake_rclpy.Profile(10, fake_rclpy.Reliability.RELIABLE, kept)
