"""An independent ROS node drives a site: belts, packages, a person's arm and button; services both ways."""

import asyncio
import contextlib
import math
import time
from collections.abc import AsyncGenerator, Iterator
from pathlib import Path

import pytest
import pytest_asyncio

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import LATCHED
from pointit.bridges.ros2.graph.backends import opened
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import ConveyorState, Environment, PointingRay, StripsFrame, UserPose
from pointit.schemas import topics as ours
from tests.interop.ros2.peers import DOMAIN, TYPES, Site, site
from tests.support.bench import background, until
from tests.support.commands import Onlooker, onlooker
from tests.support.pace import Patience
from tests.unit.ros2.graph_of_one import Shown

NOTICED_S = 20.0
ARM_HZ = 50.0
ROTATION = "/user2/metawear_ros/rotation"
BUTTON = "/user2/metawear_ros/button"
BOOL = "std_msgs/msg/Bool"
SPEED = "conveyor_msgs/srv/SetBeltSpeed"
BRIGHTNESS = "led_strip_msgs/srv/SetBrightness"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, peers_python: Path) -> Iterator[Site]:
    with site(tmp_path_factory.mktemp("site"), peers_python) as made:
        made.run_with_bridge()
        made.dora.start()
        yield made


@pytest_asyncio.fixture
async def look(place: Site) -> AsyncGenerator[Onlooker]:
    """Look at our bus, once the bridge knows both people."""
    async with onlooker(place.ours) as seen:
        for user in ("user1", "user2"):
            await place.dora.sees("/SS/", f"/pointit/%{user}%")
        yield seen


async def comes(states: list[ConveyorState], speed_mps: float) -> None:
    await until(
        lambda: any(each.speed_mps == pytest.approx(speed_mps) for each in states),
        NOTICED_S,
        f"belts at {speed_mps} m/s",
    )


async def test_belts_go_as_the_peer_says(place: Site, look: Onlooker) -> None:
    states: list[ConveyorState] = []
    look.bus.subscribe(ours.CONVEYOR_STATE, lambda message, _: states.append(message))
    dora = place.dora
    await dora.advertises("/belt_cmd", "conveyor_msgs/msg/BeltCommand")
    await dora.sees("robot/%belt_cmd")
    await dora.says("/belt_cmd", {"name": ["*"], "velocity": [0.125]})
    await comes(states, 0.125)

    await dora.says("/belt_cmd", {"name": ["part_f"], "velocity": [0.25]})
    await until(
        lambda: {each.id: each.speed_mps for each in states[-1].belts}.get("part_f") == 0.25,
        NOTICED_S,
        "one belt at its own speed",
    )
    assert await dora.calls("/set_belt_speed", SPEED, speed=0.5) == {}

    await comes(states, 0.5)
    await dora.calls("/set_belt_speed", SPEED, speed=-0.25)
    await comes(states, -0.25)


async def test_packages_come_by_service_and_by_topic(place: Site, look: Onlooker) -> None:
    dora = place.dora
    await dora.do("listen", topic="/packages", type="conveyor_msgs/msg/PackageList", depth=1)
    kind = "conveyor_msgs/srv/AddPack"
    await dora.calls("/set_belt_speed", SPEED, speed=0.25)
    before = look.object_ids()
    assert await dora.calls("/add_pack", kind, uid=77, kind=1, position=0.0, belt=0) == {"result": True}

    one = await dora.hears("/packages", lambda value: 77 in {each["uid"] for each in value["packages"]})
    (package,) = [each for each in one["packages"] if each["uid"] == 77]
    assert (package["type"], package["position"]["name"]) == (1, "part_a")
    assert await dora.calls("/add_pack", kind, uid=77, kind=1, position=0.0, belt=0) == {"result": False}
    await until(lambda: bool(look.object_ids() - before), NOTICED_S, "the object on our bus")

    states: list[ConveyorState] = []
    look.bus.subscribe(ours.CONVEYOR_STATE, lambda message, _: states.append(message))
    await dora.calls("/set_belt_speed", SPEED, speed=0.0)  # nothing is fed any more
    await comes(states, 0.0)
    assert await dora.calls("/reset_pack_sim", "std_srvs/srv/Empty") == {}
    await until(lambda: not look.objects[-1].objects, NOTICED_S, "an empty conveyor")

    await dora.advertises("/add_package", "std_msgs/msg/UInt8")
    await dora.sees("robot/%add_package")
    await dora.says("/add_package", {"data": 1})
    await until(
        lambda: [each.kind for each in look.objects[-1].objects] == ["red"], NOTICED_S, "one red package"
    )


class Arm:
    """Has the peer say all the time how the arm of user2 is turned, and looks what our bus says of it."""

    def __init__(self, place: Site, look: Onlooker) -> None:
        self._dora = place.dora
        self._azimuth_rad = 0.0
        self._elevation_rad = -0.3
        self._look = look
        self.rooms: list[Environment] = []
        self._poses: list[UserPose] = []
        self.rays: list[PointingRay] = []
        look.bus.subscribe(ours.MAP, lambda message, _: self.rooms.append(message))
        look.bus.subscribe(ours.POSE, lambda message, _: self._poses.append(message), "user2")
        look.bus.subscribe(ours.RAY, lambda message, _: self.rays.append(message), "user2")

    @contextlib.asynccontextmanager
    async def moves(self) -> AsyncGenerator[None]:
        async with background(self._move()):
            yield

    async def _move(self) -> None:
        while True:
            sec, nanosec = divmod(time.time_ns(), 1_000_000_000)
            header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "arm"}
            turned = rotation.from_azimuth_elevation(self._azimuth_rad, self._elevation_rad)
            quaternion = dict(zip("xyzw", turned, strict=True))
            await self._dora.says(ROTATION, {"header": header, "quaternion": quaternion})
            await asyncio.sleep(1.0 / ARM_HZ)

    async def points_at(self, target_m: Vec3) -> None:
        """Turn the arm, as people do, by what is seen of the ray, until the cursor is at the place."""
        await until(lambda: bool(self.rooms and self._poses and self.rays), NOTICED_S, "rays of user2")
        pose = self._poses[-1]
        patience = Patience(NOTICED_S)
        seen = self._look.cursors["user2"]
        while not any(each.point_m and math.dist(each.point_m, target_m) < 0.1 for each in seen[-5:]):
            assert not patience.is_over(), f"{target_m} m: {seen[-1:]}"
            ray = self.rays[-1]
            way = vector.rotate_z(vector.subtract(target_m, pose.position_m), -pose.yaw_rad)
            wanted = vector.subtract(way, ray.origin_m)
            is_at = ray.direction
            self._azimuth_rad += (
                math.remainder(vector.azimuth(wanted) - vector.azimuth(is_at), math.tau) / 2.0
            )
            self._elevation_rad += (vector.elevation(wanted) - vector.elevation(is_at)) / 2.0
            await asyncio.sleep(0.1)


async def test_a_persons_cursor_follows_the_arm_that_the_peer_turns(place: Site, look: Onlooker) -> None:
    dora = place.dora
    await dora.advertises(BUTTON, BOOL)
    await dora.advertises(ROTATION, "geometry_msgs/msg/QuaternionStamped")
    await dora.sees("/MP/", f"/pointit/{ROTATION.replace('/', '%')}/", gone=True)  # it is left to the peer
    arm = Arm(place, look)
    async with arm.moves():
        await until(lambda: bool(arm.rays and arm.rooms), NOTICED_S, "rays of user2")
        states = look.interactions["user2"]  # who has an arm from elsewhere points as soon as it is heard
        await until(lambda: states[-1:] != [] and states[-1].state == "pointing", NOTICED_S, "pointing")

        lines_m = {belt.id: belt.line_m for belt in arm.rooms[-1].belts}
        for belt in ("part_a", "part_e"):
            await arm.points_at(vector.scale(vector.add(*lines_m[belt][:2]), 0.5))
        await dora.calls("/user2/metawear_ros/set_yaw_origin", "std_srvs/srv/Empty")
        arm.rays.clear()
        await until(
            lambda: any(abs(vector.azimuth(ray.direction)) < 0.1 for ray in arm.rays),
            NOTICED_S,
            "the arm to be ahead now",
        )

        for wanted in ("idle", "pointing"):
            await dora.says(BUTTON, {"data": True})
            await dora.says(BUTTON, {"data": False})
            await until(lambda wanted=wanted: states[-1].state == wanted, NOTICED_S, f"{wanted} by button")


async def test_services_are_left_to_a_peer_that_serves_them(place: Site, look: Onlooker) -> None:
    frames: list[StripsFrame] = []
    look.bus.subscribe(ours.STRIPS_FRAME, lambda message, _: frames.append(message))
    dora = place.dora
    assert await dora.calls("/set_brightness", BRIGHTNESS, brightness=0.5, channel_index_mask=255) == {}

    trigger = "std_srvs/srv/Trigger"
    await dora.serves("/is_ready", trigger, success=True, message="yes")
    node = await opened(
        BackendConfig(endpoint=place.ros, node="/asks", domain_id=DOMAIN, mode="client"), Shown()
    )
    try:
        request = TYPES.encode(TYPES.request_of(trigger), TYPES.make(TYPES.request_of(trigger)))
        for _ in range(20):
            cdr = await node.call("/is_ready", TYPES.kind(trigger), request, timeout_s=NOTICED_S)
            answer = TYPES.decode(TYPES.response_of(trigger), cdr)
            assert (answer.success, answer.message) == (True, "yes")
        assert len(await dora.do("asked", service="/is_ready")) == 20
    finally:
        await node.close()
    await dora.serves("/set_brightness", BRIGHTNESS)
    await dora.sees("/SS/", "/pointit/%set_brightness/", gone=True)


async def test_late_joiner_gets_latched_messages_both_ways(place: Site, look: Onlooker) -> None:
    dora = place.dora
    for number in (1, 2):  # the first and a later reader
        topic = "/pointit/map_markers" if number == 1 else "/tf_static"
        kind = "visualization_msgs/msg/MarkerArray" if number == 1 else "tf2_msgs/msg/TFMessage"
        await dora.do("listen", topic=topic, type=kind, latched=True, depth=1)
        assert await dora.hears(topic)
    await dora.advertises("/kept", BOOL, latched=True, depth=1)

    await dora.says("/kept", {"data": True})
    assert look.people >= {"user1"}
    node = await opened(
        BackendConfig(endpoint=place.ros, node="/late", domain_id=DOMAIN, mode="client"), Shown()
    )
    try:
        heard: list[bytes] = []
        node.subscribe("/kept", TYPES.kind(BOOL), LATCHED, heard.append)
        await until(lambda: bool(heard), NOTICED_S, "what was said before")
        assert TYPES.decode(BOOL, heard[0]).data is True
    finally:
        await node.close()
