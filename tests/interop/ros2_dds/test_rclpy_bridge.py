"""The bridge, and the fetching of a map, in the environment of a genuine rclpy."""

import asyncio
import subprocess
import time
from collections.abc import Generator
from pathlib import Path

import pytest
import yaml

from pointit.bridges.ros2.map_parameters import tree_of
from pointit.maps.file import map_path
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Health, UserPose, WristSample
from pointit.schemas.topics import HEALTH, POSE, USER_ALIVE, WRIST
from tests.interop.ros2_dds.driven import DOMAIN, Driven, environment
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.parameter_server import parameters_of

pytestmark = pytest.mark.slow  # the first may fetch for a minute
START_S = 60.0
"""Within which processes start, however busy the machine."""


async def test_routes_work_and_those_of_missing_types_are_named(rclpy_python: Path, tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    command = [f"{rclpy_python}", "-m", "pointit.services", "ros2", "--connect", endpoint]
    command += ["--backend.kind", "dds", "--backend.domain-id", f"{DOMAIN}", "--ros4hri", "true"]
    said = tmp_path / "bridge.stderr"
    theirs = Driven(rclpy_python, tmp_path, "rclpy_peer.py", "robot")
    bus = await ZenohBus.open(Link(listen=(endpoint,)), patience_s=30)
    with said.open("w") as written:
        bridge = subprocess.Popen(  # noqa: ASYNC220 - takes a few ms
            command, env=environment(tmp_path), stdout=written, stderr=written
        )
    try:
        theirs.wait()
        healths: list[Health] = []
        samples: list[WristSample] = []
        bus.subscribe(HEALTH, lambda message, _name: healths.append(message))
        bus.subscribe(WRIST, lambda message, _name: samples.append(message))
        await until(lambda: bool(healths), START_S, "the bridge to start")
        bus.announce(USER_ALIVE, "user1")
        now_ns = time.time_ns()
        bus.publisher(POSE, "user1").put(
            UserPose(stamp_ns=now_ns, seq=1, position_m=(1.0, -2.0, 0.0), yaw_rad=0.0)
        )
        await theirs.do("listen", topic="/user1/pose", type="geometry_msgs/msg/PoseStamped", latched=True)
        heard = await theirs.until("heard", bool, topic="/user1/pose")
        assert heard[-1]["header"]["frame_id"] == "world"
        assert heard[-1]["header"]["stamp"] == {"sec": now_ns // 10**9, "nanosec": now_ns % 10**9}
        assert heard[-1]["pose"]["position"] == {"x": 1.0, "y": -2.0, "z": 0.0}

        topic = "/user1/metawear_ros/rotation"
        await theirs.do("advertise", topic=topic, type="geometry_msgs/msg/QuaternionStamped")
        turned = {"x": 0.5, "y": -0.5, "z": 0.5, "w": 0.5}
        for _ in range(1000):
            if samples:
                break
            now_ns = time.time_ns()
            stamp = {"sec": now_ns // 10**9, "nanosec": now_ns % 10**9}
            await theirs.do("say", topic=topic, value={"header": {"stamp": stamp}, "quaternion": turned})
            await asyncio.sleep(0.02)
        assert samples[0].orientation_xyzw == (0.5, -0.5, 0.5, 0.5)

        def warnings() -> tuple[str, ...]:
            return healths[-1].warnings if healths else ()

        person = "/humans/persons/user1"
        for name, kind, is_latched, expected in (
            ("anonymous", "std_msgs/msg/Bool", True, False),
            ("body_id", "std_msgs/msg/String", True, "user1_body"),
            ("location_confidence", "std_msgs/msg/Float32", False, 1.0),
        ):
            topic = f"{person}/{name}"
            await theirs.do("listen", topic=topic, type=kind, latched=is_latched)
            heard = await theirs.until("heard", bool, topic=topic)
            assert heard[-1] == {"data": expected}

        lacking = ("conveyor_msgs", "led_strip_msgs", "tf2_msgs", "install ros-jazzy-hri-msgs")
        await until(lambda: all(any(each in text for text in warnings()) for each in lacking), 10, "warnings")
        await theirs.do("listen", topic="/rosout", type="rcl_interfaces/msg/Log", latched=True, depth=1000)
        heard = await theirs.until(
            "heard", lambda lines: any("conveyor_msgs" in line["msg"] for line in lines), topic="/rosout"
        )
        (line,) = [each for each in heard if "conveyor_msgs" in each["msg"] and each["name"] != "robot"]
        assert (line["name"], line["level"]) == ("pointit.ros2", 30)
        bridge.terminate()
        assert bridge.wait(10) == 0, said.read_text()
        assert "Traceback" not in said.read_text()
    finally:
        bridge.kill()
        bridge.wait()
        theirs.kill()
        await bus.close()


TEXT = "lamps: {door: {position: [-1.5, 3.2, 1.8]}}\n"


@pytest.fixture
def theirs(rclpy_python: Path, tmp_path: Path) -> Generator[Driven]:
    robot = Driven(rclpy_python, tmp_path, "rclpy_peer.py", "robot")
    try:
        robot.wait()
        yield robot
    finally:
        robot.kill()


@pytest.fixture
def ours(rclpy_python: Path, tmp_path: Path) -> Generator[Driven]:
    side = Driven(rclpy_python, tmp_path, "bridge_side.py", "/site1/pointit")
    try:
        side.wait()
        yield side
    finally:
        side.kill()


async def test_a_map_comes_out_of_a_genuine_nodes_parameters(ours: Driven, theirs: Driven) -> None:
    with map_path("conveyor") as path:
        parameters = parameters_of(yaml.safe_load(path.read_text(encoding="utf-8")))
    await theirs.do("declare", parameters=parameters | {"room": TEXT})
    values = {"node": "/robot", "parameter": None, "prefix": None, "timeout_s": 20.0}
    assert await ours.do("fetch", **values) == tree_of(parameters)
    room = {"lamps": {"door": {"position": [-1.5, 3.2, 1.8]}}}
    assert await ours.do("fetch", **values | {"parameter": "room"}) == room
    with pytest.raises(AssertionError, match="NoAnswerError: there is no node /robbot in domain"):
        await ours.do("fetch", **values | {"node": "/robbot", "timeout_s": 4.0})
    with pytest.raises(
        AssertionError, match=r"ConfigError: no parameter of /robot begins with 'site\.'; it has use"
    ):
        await ours.do("fetch", **values | {"prefix": "site"})
