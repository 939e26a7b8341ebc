"""The service on sockets: a server of NatNet that answers and streams, by unicast and multicast."""

import contextlib
import math
import time
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager

import pytest

from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.natnet_client import find_servers
from pointit.bridges.mocap.service import Mocap
from pointit.geometry import rotation
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, check_launches, run_service
from pointit.schemas import Environment, Health, ImuSample, TrackedObjects, UserPose
from pointit.schemas.environment import Frame
from pointit.schemas.topics import HEALTH, IMU, MAP, OBJECTS, POSE
from tests.support.bench import background, repeated, until
from tests.unit.mocap.natnet_encoder import Body, Server, serving

YAW_RAD = 0.7
NAMES = {1: "cup", 2: "cap", 3: "cuff"}
BODIES = {"cup": {"kind": "red"}, "cap": {"person": "anna"}, "cuff": {"person": "anna", "part": "forearm"}}


def arm(now_ns: int) -> rotation.Quaternion:
    time_s = now_ns % 10**12 / 1e9
    return rotation.from_azimuth_elevation(
        0.4 * math.sin(7.0 * time_s), 0.3 * math.sin(5.0 * time_s), 0.2 * math.sin(6.0 * time_s)
    )


def bodies(now_ns: int) -> Sequence[Body]:
    """Return bodies with y up: a cup, a cap at (1, 2) and a cuff on the arm."""
    x, y, z, w = rotation.multiply(rotation.from_yaw(YAW_RAD), arm(now_ns))
    return Body(1), Body(2, (1.0, 1.7, -2.0)), Body(3, (1.2, 1.2, -2.0), (x, z, -y, w))


class Watcher:
    """Messages of the service at the site."""

    def __init__(self, bus: MemoryBus) -> None:
        self.objects: list[TrackedObjects] = []
        self.poses: list[UserPose] = []
        self.health: Health | None = None
        bus.subscribe(OBJECTS, lambda message, _: self.objects.append(message))
        bus.subscribe(POSE, lambda message, _: self.poses.append(message))
        bus.subscribe(HEALTH, self._on_health)

    def _on_health(self, health: Health, _name: str) -> None:
        self.health = health

    def sees(self, name: str) -> bool:
        return bool(self.objects) and name in {each.id for each in self.objects[-1].objects}

    def warns(self, sentence: str) -> bool:
        return self.health is not None and any(sentence in each for each in self.health.warnings)

    def figure(self, name: str) -> float | None:
        figures = () if self.health is None else self.health.figures
        return next((each.value for each in figures if each.name == name), None)


@asynccontextmanager
async def running(port: int, **parameters: object) -> AsyncGenerator[tuple[Watcher, MemoryBus]]:
    config = MocapConfig.model_validate({"server": "127.0.0.1", "port": port, "bodies": BODIES, **parameters})
    bus = MemoryBus(LocalBroker())
    watcher = Watcher(bus)
    async with background(run_service(Launch(service=Mocap, config=config), bus, WallClock())):
        yield watcher, bus
    await bus.close()


@asynccontextmanager
async def moving_wrist(
    bus: MemoryBus, moved: Callable[[int], rotation.Quaternion] = arm
) -> AsyncGenerator[None]:
    publisher = bus.publisher(IMU, "anna")

    def send() -> None:
        now_ns = time.time_ns()
        publisher.put(ImuSample(stamp_ns=now_ns, orientation_xyzw=moved(now_ns)))

    async with repeated(0.02, send):
        yield


async def check_cup_and_pose(watcher: Watcher) -> None:
    await until(lambda: watcher.sees("cup"))
    cup = next(each for each in watcher.objects[-1].objects if each.id == "cup")
    assert (cup.kind, cup.position_m) == ("red", (1.0, 2.0, 1.5))
    await until(lambda: bool(watcher.poses))
    pose = watcher.poses[-1]
    assert (pose.method, pose.position_m) == ("external", (1.0, 2.0, 0.0))
    yaw_error_rad = abs(math.remainder(pose.yaw_rad - YAW_RAD, math.tau))
    assert yaw_error_rad < max(0.05, 4 * math.sqrt(pose.covariance[8]))


def server(version: tuple[int, int] = (3, 1), multicast: str = "") -> Server:
    return Server(version, NAMES, time.time_ns, bodies, multicast)


@pytest.mark.parametrize("version", [(3, 1), (4, 1)])
async def test_bodies_become_objects_and_a_moving_arm_gives_a_pose(
    version: tuple[int, int],
) -> None:
    async with serving(server(version)) as port, running(port) as (watcher, bus), moving_wrist(bus):
        await check_cup_and_pose(watcher)
        await until(lambda: not watcher.sees("anna"), what="whose pose is known is no object")
        await until(lambda: (watcher.figure("clock sigma") or 9.0) < 9.0)


async def test_ground_truth_is_compared_with_the_localizer_without_changing_poses() -> None:
    found = UserPose(stamp_ns=0, position_m=(1.3, 2.4, 0.0), yaw_rad=YAW_RAD + 0.1, method="static_targets")
    async with serving(server()) as port, running(port, truth=True) as (watcher, bus), moving_wrist(bus):
        await until(lambda: watcher.sees("anna") and watcher.objects[-1].objects[-1].yaw_rad is not None)
        anna = watcher.objects[-1].objects[-1]
        assert (anna.id, anna.kind) == ("anna", "person_frame")
        assert anna.position_m == pytest.approx((1.0, 2.0, 1.7))
        localizer = bus.publisher(POSE, "anna")

        def is_compared() -> bool:
            localizer.put(found.model_copy(update={"stamp_ns": time.time_ns()}))
            return watcher.figure("yaw error of anna") is not None

        await until(is_compared)
        assert watcher.figure("position error of anna") == pytest.approx(0.5, abs=0.01)
        assert watcher.figure("yaw error of anna") == pytest.approx(math.degrees(0.1), abs=3.0)
        assert {pose.method for pose in watcher.poses} == {"static_targets"}


async def test_a_frame_of_the_map_is_waited_for_and_applied() -> None:
    async with serving(server()) as port, running(port, frame="motive") as (watcher, bus):
        publisher = bus.publisher(MAP)
        publisher.put(Environment(stamp_ns=1, name="room"))
        await until(lambda: watcher.warns("the map room has no frame 'motive'"))
        assert not watcher.objects
        frame = Frame(id="motive", position_m=(10.0, 0.0, 0.0))
        publisher.put(Environment(stamp_ns=2, name="room", frames=(frame,)))
        await until(lambda: watcher.sees("cup"))
        assert watcher.objects[-1].objects[0].position_m == (11.0, 2.0, 1.5)


async def test_objects_leave_when_the_server_ends_and_return_with_it() -> None:
    first = server()
    async with contextlib.AsyncExitStack() as stack:
        port = await stack.enter_async_context(serving(first))
        watcher, _ = await stack.enter_async_context(running(port))
        await until(lambda: watcher.sees("cup"))
        first.clients.clear()
        first.now_ns = lambda: 0  # its echoes are of another clock, and nobody gets its frames
        await until(lambda: not watcher.objects[-1].objects)
        first.now_ns = time.time_ns
        first.requests.clear()
        await until(lambda: 10 in first.requests, what="it is kept alive")
        await until(lambda: bool(watcher.objects[-1].objects), what="the objects are there again")


@pytest.mark.parametrize("interface", ["127.0.0.1"])
async def test_a_multicast_stream_is_received(interface: str) -> None:
    async with serving(server((4, 1), interface)) as port, running(port, interface=interface) as (watcher, _):
        await until(lambda: watcher.sees("cup"))


async def test_nobody_at_the_address_is_reported() -> None:
    async with running(9) as (watcher, _):
        await until(lambda: watcher.warns("127.0.0.1 does not answer by NatNet"))


async def test_servers_are_found_by_a_search() -> None:
    async with serving(server((4, 1))) as port:
        found = await find_servers(0.5, [("127.0.0.1", port)])
    assert [(each.label, each.details["stream"]) for each in found] == [
        ("Motive, NatNet 4.1, unicast", "unicast")
    ]


def test_a_server_must_be_named() -> None:
    with pytest.raises(ConfigError, match="mocap: server: is missing; name the machine with Motive"):
        check_launches([Launch(service=Mocap, config=MocapConfig())])
