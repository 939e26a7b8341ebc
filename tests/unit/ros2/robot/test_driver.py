"""The driver `ros2`: its pose, its link, its two ways to move a robot, and bad configurations."""

import asyncio
import contextlib
import dataclasses
import math
from collections.abc import AsyncGenerator
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit import plugins
from pointit.bridges.ros2.config import PoseSource
from pointit.bridges.ros2.robot.driver import Ros2Driver
from pointit.bridges.ros2.robot.plugin import Ros2RobotConfig
from pointit.bridges.ros2.robot.pose_input import PoseReader
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.config.config import Layers
from tests.support.bench import START_NS, until
from tests.unit.ros2.graph_of_one import Around
from tests.unit.ros2.robot.fake_nav2 import FakeNav2
from tests.unit.ros2.scenes import NOW_NS, jazzy
from tests.unit.ros2.tracking.test_trackers import ODOMETRY, POSE, TF, header, make, pose, transform
from tests.unit.ros2.values import any_value

GROUND = plugins.RobotSpec(
    name="agv-1",
    kind="ground",
    start_m=(0.0, 0.0, 0.0),
    start_yaw_rad=0.0,
    radius_m=0.3,
    hover_m=0.5,
    max_speed_mps=1.0,
    max_acceleration_mps2=1.0,
)
QUAD = dataclasses.replace(GROUND, name="quad", kind="quadrotor")
SETPOINTS = "/mavros/setpoint_position/local"


class Bench:
    """A running driver in a graph in which there is only the test."""

    def __init__(self, graph: FakeNav2, around: Around, driver: Ros2Driver) -> None:
        self.graph = graph
        self.around = around
        self.driver = driver
        self.items: list[plugins.ReportItem] = []

    @property
    def reports(self) -> list[plugins.RobotReport]:
        return [item for item in self.items if isinstance(item, plugins.RobotReport)]

    @property
    def news(self) -> list[tuple[int, str]]:
        return [(item.order, item.state) for item in self.items if isinstance(item, plugins.OrderStatus)]

    def is_at(self, x: float) -> None:
        """Publish the robot's pose, now."""
        self.say("/pose", POSE, header=header("map", self.around.clock.now_ns()), pose=pose(x))

    def say(self, topic: str, name: str, /, **fields: Any) -> None:
        self.graph.readers[topic](jazzy().encode(name, make(name, **fields)))


@contextlib.asynccontextmanager
async def driving(
    monkeypatch: pytest.MonkeyPatch, spec: plugins.RobotSpec, **parameters: Any
) -> AsyncGenerator[Bench]:
    graph = FakeNav2()
    around = Around()

    async def opened(config: Any, *_others: Any, **_more: Any) -> FakeNav2:
        graph.node = config.node
        return graph

    monkeypatch.setattr("pointit.bridges.ros2.robot.driver.opened", opened)

    def types(_distro: str) -> Types:
        return jazzy()

    monkeypatch.setattr("pointit.bridges.ros2.robot.driver.Types", types)
    config = Ros2RobotConfig.model_validate(parameters)
    made: Any = around
    bench = Bench(graph, around, Ros2Driver(config, spec, made))
    running = asyncio.create_task(bench.driver.run(bench.items.append))
    try:
        await until(lambda: "/tf" in graph.readers or running.done())
        yield bench
    finally:
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running


TOPIC = {"pose": {"topic": "/pose"}}


async def test_a_ground_robot_reports_drives_and_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    async with driving(monkeypatch, GROUND, **TOPIC) as bench:
        assert bench.graph.node == "/pointit_agv_1"
        (lost,) = bench.items
        assert isinstance(lost, plugins.LinkLost)
        assert "no pose comes from /pose" in lost.reason

        bench.driver.command(plugins.FollowPath(1, ((1.0, 0.0, 0.0),)))
        assert bench.news == [(1, "refused")]  # it is not connected
        bench.is_at(0.5)
        assert bench.reports[-1].position_m == (0.5, 0.0, 0.0)
        assert bench.reports[-1].stamp_ns == START_NS

        bench.driver.command(plugins.Stop(2))  # harmless
        bench.driver.command(plugins.FollowPath(3, ((1.0, 0.0, 0.0),)))
        await until(lambda: (3, "accepted") in bench.news)
        (goal,) = bench.graph.goals
    assert bench.graph.cancelled == [goal]
    assert not bench.graph.readers


async def test_bad_pose_is_a_warning_and_not_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    async with driving(monkeypatch, GROUND, **TOPIC) as bench:
        bench.say("/pose", POSE, header=header("moon"), pose=pose())
        assert "no transform leads from 'moon' to 'map'" in bench.around.now["pose"]
        bench.graph.readers["/pose"](b"\x00\x01\x00\x00short")
        assert "was dropped" in bench.around.now["pose"]
        assert bench.reports == []
        bench.is_at(0.0)
        assert bench.around.now["pose"] == ""


async def test_the_pose_of_a_frame_comes_from_tf(monkeypatch: pytest.MonkeyPatch) -> None:
    async with driving(monkeypatch, GROUND) as bench:
        bench.say("/tf", TF, transforms=[transform("odom", "base_link", 1.0)])
        assert bench.reports == []
        bench.say("/tf", TF, transforms=[transform("map", "odom", 2.0, math.pi / 2)])
        assert bench.reports[-1].position_m == pytest.approx((2.0, 1.0, 0.0))
        assert bench.reports[-1].yaw_rad == pytest.approx(math.pi / 2)


async def test_set_points_of_a_drone_are_in_its_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    async with driving(monkeypatch, QUAD, control="setpoints", **TOPIC) as bench:
        bench.is_at(0.0)
        bench.driver.command(plugins.TakeOff(1, 0.2))
        await until(lambda: bool(bench.graph.sent[SETPOINTS]))
        assert jazzy().decode(POSE, bench.graph.sent[SETPOINTS][0]).header.frame_id == "map"


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"action": "navigate_to_pose"}, "begin with /"),
        ({"pose": {"type": "conveyor_msgs/PackageList", "topic": "/packages"}}, "a robot's pose comes from"),
    ],
)
def test_parameters_that_cannot_work_are_refused(parameters: dict[str, Any], expected: str) -> None:
    layers = Layers()
    layers.add(parameters, "site.yaml")
    with pytest.raises(plugins.ConfigError, match=expected):
        layers.build(Ros2RobotConfig)


@pytest.mark.parametrize(
    ("spec", "parameters", "expected"),
    [
        (QUAD, {}, "set it to setpoints"),
        (GROUND, {"control": "setpoints"}, "set it to nav2"),
        (GROUND, {"backend": {"endpoint": "robot"}}, "no address"),
    ],
)
def test_a_driver_that_cannot_work_is_not_made(spec: Any, parameters: dict[str, Any], expected: str) -> None:
    with pytest.raises(plugins.ConfigError, match=expected):
        Ros2Driver(Ros2RobotConfig.model_validate(parameters), spec, cast("Any", Around()))


SOURCES = {
    POSE: PoseSource(topic="/pose"),
    ODOMETRY: PoseSource(topic="/odom", type="nav_msgs/Odometry"),
    TF: PoseSource(type="tf", frame="base_link"),
}


@pytest.mark.parametrize("name", SOURCES)
@given(data=st.data())
def test_any_pose_message_gives_a_finite_report_or_a_sentence(name: str, data: st.DataObject) -> None:
    reader = PoseReader(SOURCES[name], "map")
    value = data.draw(any_value(name))
    if name == TF:
        found = reader.transforms(value, NOW_NS, is_static=data.draw(st.booleans()))
    else:
        value.header = header("", 0)
        found = reader.message(value, NOW_NS)
    if isinstance(found, plugins.RobotReport):
        assert all(map(math.isfinite, (*found.position_m, *found.velocity_mps, found.yaw_rad)))
        assert found.stamp_ns <= NOW_NS + plugins.NS_PER_S
    else:
        assert len(found) < 300
