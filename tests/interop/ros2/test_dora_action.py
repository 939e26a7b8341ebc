"""NavigateToPose served by an independent ROS node (dora-rs): accepted, reported on, done, cancelled."""

import asyncio
import contextlib
import functools
from collections.abc import AsyncGenerator, Callable
from pathlib import Path
from typing import Any, cast

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backends import opened
from pointit.bridges.ros2.robot.driver import Ros2Driver
from pointit.bridges.ros2.robot.plugin import Ros2RobotConfig
from pointit.bridges.ros2.types.definitions import NAVIGATE_TO_POSE
from pointit.plugins import FollowPath, OrderStatus, ReportItem, RobotReport, RobotSpec, Stop
from pointit.runtime.clock import WallClock
from tests.interop.ros2.ament import shape
from tests.interop.ros2.peers import DOMAIN, TYPES, Dora
from tests.support.bench import until
from tests.support.buses import free_port
from tests.unit.ros2.graph_of_one import Around

PATIENCE_S = 30.0
ACTION = "/navigate_to_pose"
SPEC = RobotSpec(
    name="agv", kind="ground", start_m=(0.0, 0.0, 0.0), start_yaw_rad=0.0, radius_m=0.3, hover_m=0.5,
    max_speed_mps=1.0, max_acceleration_mps2=1.0,
)  # fmt: skip
POSE = "geometry_msgs/msg/PoseStamped"


def zero(described: Any) -> Any:
    """A value of a shape, all 0."""
    if isinstance(described, dict):
        return {name: zero(each) for name, each in cast("dict[str, Any]", described).items()}
    return [] if isinstance(described, list) else "" if described == "string" else 0


class Site:
    """The driver, and the peer that serves the action."""

    def __init__(self, dora: Dora, driver: Ros2Driver, around: Around) -> None:
        self.dora = dora
        self.driver = driver
        self.around = around
        self.items: list[ReportItem] = []

    @property
    def news(self) -> list[tuple[int, str]]:
        return [(item.order, item.state) for item in self.items if isinstance(item, OrderStatus)]

    async def goals(self, count: int, fit: Callable[[list[Any]], bool] = bool) -> list[Any]:
        """Return the goals that the peer has, once there are so many, and they fit."""
        found: list[Any] = []
        async with asyncio.timeout(PATIENCE_S):
            while len(found) < count or not fit(found):
                found = await self.dora.do("goals", action=ACTION)
        return found

    async def until(self, order: int, state: str) -> None:
        await until(lambda: (order, state) in self.news, PATIENCE_S, f"{order} {state}")


@contextlib.asynccontextmanager
async def site(python: Path, folder: Path) -> AsyncGenerator[Site]:
    """Yield both, connected: the test is the router, the peer publishes the robot's pose."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    around: Any = Around(WallClock())
    router = await opened(
        BackendConfig(endpoint=endpoint, mode="router", domain_id=DOMAIN, node="/router"), around
    )
    dora = Dora(python, folder, endpoint, "robot")
    settings = {"backend": {"endpoint": endpoint, "domain_id": DOMAIN}, "pose": {"topic": "/pose"}}
    made = Site(dora, Ros2Driver(Ros2RobotConfig.model_validate(settings), SPEC, around), around)
    running = asyncio.create_task(made.driver.run(made.items.append))
    try:
        await asyncio.to_thread(dora.start)
        shapes = {part.lower(): shape(TYPES, f"{NAVIGATE_TO_POSE}_{part}") for part in ("Result", "Feedback")}
        empty = zero(shapes["result"])
        await dora.do("act", action=ACTION, type=NAVIGATE_TO_POSE, empty=empty, **shapes)
        await dora.advertises("/pose", POSE)
        await dora.sees("/MS/", "%pose/")
        pose = zero(shape(TYPES, POSE))
        pose["header"]["frame_id"] = "map"
        pose["pose"]["orientation"]["w"] = 1.0
        while not any(isinstance(item, RobotReport) for item in made.items):
            await dora.says("/pose", pose)
            await asyncio.sleep(0.02)
        moving = asyncio.create_task(_forever(functools.partial(dora.says, "/pose", pose)))
        try:
            yield made
        finally:
            moving.cancel()
            running.cancel()
            await asyncio.gather(moving, running, return_exceptions=True)
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        dora.kill()
        await router.close()


async def _forever(say: Any) -> None:
    while True:
        await say()
        await asyncio.sleep(0.2)


async def test_a_goal_is_done_and_another_is_cancelled(peers_python: Path, tmp_path: Path) -> None:
    async with site(peers_python, tmp_path) as place:
        place.driver.command(FollowPath(1, ((1.5, -0.5, 0.0),), yaw_rad=0.0))
        (goal,) = await place.goals(1)
        assert goal["value"]["pose"]["header"]["frame_id"] == "map"
        assert goal["value"]["pose"]["pose"]["position"] == {"x": 1.5, "y": -0.5, "z": 0.0}
        await place.until(1, "active")

        feedback = zero(shape(TYPES, f"{NAVIGATE_TO_POSE}_Feedback"))
        feedback["distance_remaining"] = 1.25
        await place.dora.do("feedback", action=ACTION, goal=goal["goal"], value=feedback)
        await until(lambda: place.around.metrics == {"way left": 1.25}, PATIENCE_S, "feedback")

        await place.dora.do(
            "end", action=ACTION, goal=goal["goal"], status="succeeded", value={"error_code": 0}
        )
        await place.until(1, "done")

        place.items.clear()

        place.driver.command(FollowPath(2, ((1.0, 0.0, 0.0), (2.0, 0.0, 0.0))))
        await place.goals(2)
        await place.until(2, "active")
        place.driver.command(Stop(3))
        assert (await place.goals(2, lambda goals: goals[1]["cancelled"]))[1]["cancelled"]
        place.items.clear()

        place.driver.command(FollowPath(4, ((3.0, 0.0, 0.0),)))
        third = (await place.goals(3))[2]
        await place.dora.do(
            "end", action=ACTION, goal=third["goal"], status="aborted", value={"error_code": 208}
        )
        await place.until(4, "failed")
        (reason,) = [item.reason for item in place.items if isinstance(item, OrderStatus) and item.reason]
        assert reason == "Nav2 gave up: error 208"
