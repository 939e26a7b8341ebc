"""Our backend and a genuine rclpy node over Fast DDS: topics, services, and what each sees of the other."""

from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from tests.interop.ros2_dds.driven import TYPES, Driven, cdr, value

pytestmark = pytest.mark.slow  # the first may fetch for a minute

POSE = "geometry_msgs/msg/PoseStamped"
ROTATION = "geometry_msgs/msg/QuaternionStamped"
BOOL = "std_msgs/msg/Bool"
SET = "std_srvs/srv/SetBool"
OURS = "/site1/pointit"


class Pair:
    """A node of ours and one of theirs."""

    def __init__(self, python: Path, folder: Path) -> None:
        self.ours = Driven(python, folder, "bridge_side.py", OURS)
        self.theirs = Driven(python, folder, "rclpy_peer.py", "robot")

    async def see(self, kind: str, topic: str) -> Any:
        """Wait until ours sees what theirs has."""
        wanted = [kind, "/robot", topic]
        graph = await self.ours.until("graph", lambda graph: any(end[:3] == wanted for end in graph["ends"]))
        if kind == "publisher":  # it may be seen before it knows of us
            await self.theirs.until("matched", bool, topic=topic)
        return graph


@pytest.fixture(scope="module")
def pair(rclpy_python: Path, tmp_path_factory: pytest.TempPathFactory) -> Generator[Pair]:
    """Return one pair for all tests here, each of which has topics of its own; the last closes ours."""
    pair = Pair(rclpy_python, tmp_path_factory.mktemp("pair"))
    try:
        pair.ours.wait()
        pair.theirs.wait()
        yield pair
    finally:
        pair.ours.kill()
        pair.theirs.kill()


def pose(x: float) -> dict[str, Any]:
    return {
        "header": TYPES.make("std_msgs/msg/Header", frame_id="world"),
        "pose": TYPES.make(
            "geometry_msgs/msg/Pose", position=TYPES.make("geometry_msgs/msg/Point", x=x, y=-1.5, z=0.25)
        ),
    }


async def test_every_published_pose_arrives_and_is_read_by_rclpy(pair: Pair) -> None:
    await pair.ours.do("advertise", topic="/user1/pointing_ray", type=POSE, depth=200)
    await pair.theirs.do("listen", topic="/user1/pointing_ray", type=POSE, depth=200)
    await pair.see("subscriber", "/user1/pointing_ray")
    sent = [cdr(POSE, **pose(float(index))) for index in range(200)]
    await pair.ours.do("say", topic="/user1/pointing_ray", cdrs=sent, apart_s=0.005)
    heard = await pair.theirs.until("heard", lambda heard: len(heard) >= 200, topic="/user1/pointing_ray")
    assert [each["pose"]["position"]["x"] for each in heard] == [float(index) for index in range(200)]
    assert heard[7]["header"]["frame_id"] == "world"
    assert heard[7]["pose"]["position"] == {"x": 7.0, "y": -1.5, "z": 0.25}
    assert heard[7]["pose"]["orientation"]["w"] == 1.0


async def test_a_rotation_comes_in_from_them(pair: Pair) -> None:
    topic = "/user1/metawear_ros/rotation"
    await pair.ours.do("listen", topic=topic, type=ROTATION, depth=5, reliable=False)
    await pair.theirs.do("advertise", topic=topic, type=ROTATION)
    await pair.see("publisher", topic)
    turned = {"header": {"frame_id": "arm"}, "quaternion": {"x": 0.5, "y": -0.5, "z": 0.5, "w": 0.5}}
    await pair.theirs.do("say", topic=topic, value=turned)
    (heard,) = await pair.ours.until("heard", bool, topic=topic)
    got = value(ROTATION, heard)
    assert got.header.frame_id == "arm"
    assert (got.quaternion.x, got.quaternion.y, got.quaternion.z, got.quaternion.w) == (0.5, -0.5, 0.5, 0.5)


async def test_late_joiner_gets_latched_messages_once_either_way(pair: Pair) -> None:
    await pair.ours.do("advertise", topic="/out", type=BOOL, depth=1, latched=True)
    await pair.theirs.do("advertise", topic="/in", type=BOOL, depth=1, latched=True)
    await pair.ours.do("say", topic="/out", cdrs=[cdr(BOOL, data=False), cdr(BOOL, data=True)])
    await pair.theirs.do("say", topic="/in", value={"data": False})
    await pair.theirs.do("say", topic="/in", value={"data": True})
    await pair.theirs.do("listen", topic="/out", type=BOOL, depth=1, latched=True)

    await pair.ours.do("listen", topic="/in", type=BOOL, depth=1, latched=True)
    await pair.theirs.until("heard", bool, topic="/out")
    await pair.ours.until("heard", bool, topic="/in")

    await pair.ours.do("say", topic="/out", cdrs=[cdr(BOOL, data=False)])
    await pair.theirs.do("say", topic="/in", value={"data": False})
    heard = await pair.theirs.until("heard", lambda heard: len(heard) >= 2, topic="/out")
    assert heard == [{"data": True}, {"data": False}]

    heard = await pair.ours.until("heard", lambda heard: len(heard) >= 2, topic="/in")
    assert [value(BOOL, each).data for each in heard] == [True, False]


async def test_own_messages_never_return_but_equal_ones_from_others_arrive(pair: Pair) -> None:
    await pair.ours.do("listen", topic="/both", type=BOOL, depth=200)
    await pair.ours.do("advertise", topic="/both", type=BOOL, depth=200)
    await pair.theirs.do("listen", topic="/both", type=BOOL, depth=200)
    await pair.theirs.do("advertise", topic="/both", type=BOOL, depth=200)
    await pair.see("subscriber", "/both")
    await pair.see("publisher", "/both")

    await pair.ours.do("say", topic="/both", cdrs=[cdr(BOOL, data=True)] * 100, apart_s=0.001)
    await pair.theirs.until("heard", lambda heard: len(heard) == 100, topic="/both")
    for _ in range(3):
        await pair.theirs.do("say", topic="/both", value={"data": True})
    await pair.theirs.do("say", topic="/both", value={"data": False})

    heard = await pair.ours.until(
        "heard", lambda heard: [each for each in heard if not value(BOOL, each).data], topic="/both"
    )
    assert [value(BOOL, each).data for each in heard] == [True, True, True, False]


async def test_services_are_answered_either_way(pair: Pair) -> None:
    response = cdr(TYPES.response_of(SET), success=True, message="ours")
    await pair.ours.do("serve", service="/site1/stop", type=SET, response=response, after_s=0.02)
    requests = [{"data": bool(index % 2)} for index in range(10)]
    answers = await pair.theirs.do("call", service="/site1/stop", type=SET, requests=requests)
    assert answers == [{"success": True, "message": "ours"}] * 10
    asked = [value(TYPES.request_of(SET), each).data for each in await pair.ours.do("requests")]
    assert asked == [each["data"] for each in requests]

    theirs = {"success": False, "message": "theirs"}
    await pair.theirs.do("serve", service="/robot/stop", type=SET, response=theirs)
    request = cdr(TYPES.request_of(SET), data=True)
    for _ in range(10):
        called, took_s = await pair.ours.do(
            "call", service="/robot/stop", type=SET, request=request, timeout_s=20
        )
        got = value(TYPES.response_of(SET), called)
        assert (got.success, got.message) == (False, "theirs")
        assert took_s < 20
    assert await pair.theirs.do("requests") == [{"data": True}] * 10


async def test_each_sees_what_the_other_has(pair: Pair) -> None:
    await pair.ours.do("advertise", topic="/user1/pose", type=POSE, depth=1, latched=True)
    await pair.ours.do("listen", topic="/user1/imu_in", type="sensor_msgs/msg/Imu", depth=5, reliable=False)
    await pair.theirs.do("advertise", topic="/user1/imu_in", type="sensor_msgs/msg/Imu")
    await pair.theirs.do("serve", service="/robot/go", type=SET, response={})

    has = [
        ["publisher", "/robot", "/user1/imu_in", "sensor_msgs/msg/Imu"],
        ["server", "/robot", "/robot/go", SET],
        ["publisher", OURS, "/user1/pose", POSE],
    ]
    graph = await pair.ours.until(
        "graph", lambda graph: all(any(end[:4] == one for end in graph["ends"]) for one in has)
    )
    assert {"/robot", OURS} <= set(graph["nodes"])

    (mine,) = (end for end in graph["ends"] if end[2] == "/user1/pose")
    assert mine == ["publisher", OURS, "/user1/pose", POSE, TYPES.kind(POSE).hash, True]

    wanted = [
        ["publisher", "/user1/pose", POSE, TYPES.kind(POSE).hash, True, True],
        [
            "subscriber",
            "/user1/imu_in",
            "sensor_msgs/msg/Imu",
            TYPES.kind("sensor_msgs/msg/Imu").hash,
            False,
            False,
        ],
    ]
    seen = await pair.theirs.until(
        "graph", lambda graph: all(end in graph["ends"] for end in wanted), node=OURS
    )
    assert OURS in seen["nodes"]

    await pair.theirs.do("silence", topic="/user1/imu_in")
    await pair.ours.until(
        "graph",
        lambda graph: not any(end[:3] == ["publisher", "/robot", "/user1/imu_in"] for end in graph["ends"]),
    )


async def test_unmatched_qos_and_missing_or_different_types_are_reported(pair: Pair) -> None:
    await pair.ours.do("listen", topic="/told", type=BOOL, depth=1, latched=True)
    await pair.theirs.do("advertise", topic="/told", type=BOOL)
    sentence = "node /robot on /told does not match ours"
    await pair.ours.until("shown", lambda shown: sentence in shown.get("QoS of /told", ""))
    await pair.theirs.do("silence", topic="/told")
    await pair.theirs.do("advertise", topic="/told", type=BOOL, latched=True)
    await pair.theirs.do("say", topic="/told", value={"data": True})
    (heard,) = await pair.ours.until("heard", bool, topic="/told")
    assert value(BOOL, heard).data
    await pair.ours.until("shown", lambda shown: "QoS of /told" not in shown)

    packages = "conveyor_msgs/msg/PackageList"
    await pair.ours.do("advertise", topic="/packages", type=packages)
    await pair.ours.do("say", topic="/packages", cdrs=[cdr(packages)])
    shown = await pair.ours.do("shown")
    assert "colcon build" in shown["package conveyor_msgs"]

    await pair.ours.do("advertise", topic="/strange", type=BOOL, hash="RIHS01_" + "0" * 64)
    shown = await pair.ours.do("shown")
    assert "another definition of std_msgs/msg/Bool" in shown[f"definition of {BOOL}"]


async def test_it_leaves_at_once(pair: Pair) -> None:
    await pair.ours.do("listen", topic="/here", type=BOOL)
    await pair.ours.do("serve", service="/here", type=SET, response=cdr(TYPES.response_of(SET)))
    await pair.theirs.until("graph", lambda graph: OURS in graph["nodes"], node="/x")
    threads = await pair.ours.do("close")
    assert not [name for name in threads if name == "rclpy-spin"]
    await pair.theirs.until("graph", lambda graph: OURS not in graph["nodes"], node="/x")
    assert "Traceback" not in pair.ours.complaints()
