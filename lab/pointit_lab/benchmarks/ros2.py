"""The ROS 2 bridge in a process of its own: cost compared with a bare relay."""

import asyncio
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import psutil

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import Backend, Graph, Qos, Writer
from pointit.bridges.ros2.graph.backends import opened
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import PointingRay, WristSample
from pointit.schemas.topics import RAY, USER_ALIVE, WRIST
from pointit_lab.benchmarks import bare_zenoh
from pointit_lab.benchmarks.bare_zenoh import relay_cost
from pointit_lab.benchmarks.statistics import machine
from tests.support.buses import free_port

USERS = 10
HZ = 50.0
"""Rate of each topic and person: 500 messages per second in total."""
ROUNDS = 3
TIMEOUT_S = 60.0
SETTLE_S = 1.0
RAY_TYPE = "geometry_msgs/msg/PoseStamped"
ROTATION_TYPE = "geometry_msgs/msg/QuaternionStamped"
ROUTES = "routes: {pointing_ray: {rate_hz: 1000}, rotation_in: {rate_hz: 1000}}\n"
"""Raises the rate limits, which would determine the result."""


class StderrWarnings:
    """Prints warnings of the peer's node."""

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Print `sentence`."""
        line = f"{code} {subject}: {sentence}"
        print(line, file=sys.stderr)

    def clear(self, code: str, subject: str = "") -> None:
        """Do nothing."""


class Ends:
    """Both ends of the bridge: our bus, and a ROS node that is the router there."""

    def __init__(self, bus: ZenohBus, backend: Backend, process: psutil.Process) -> None:
        self.bus = bus
        self.peer = backend
        self.process = process
        self.types = Types("jazzy")
        self.users = [f"user{index}" for index in range(USERS)]
        self.rays: list[int] = []
        """Stamps of the rays that arrived in ROS, ns."""
        self.samples: list[WristSample] = []
        """Samples that arrived on our bus."""
        self._presences = [bus.announce(USER_ALIVE, user) for user in self.users]
        self._ours = {user: bus.publisher(RAY, user) for user in self.users}

        # the other end: wrists that publish, and a node that reads rays
        kind = self.types.kind(ROTATION_TYPE)
        self._ros_end: dict[str, Writer] = {}
        for user in self.users:
            name = f"/{user}/metawear_ros/rotation"
            self._ros_end[user] = backend.advertise(name, kind, Qos())
        ray_kind = self.types.kind(RAY_TYPE)
        for user in self.users:
            name = f"/{user}/pointing_ray"
            backend.subscribe(name, ray_kind, Qos(depth=100), self._on_message)
        self.reader = bus.subscribe(WRIST, self._on_sample)

    def _on_message(self, cdr: bytes) -> None:
        stamp = self.types.decode(RAY_TYPE, cdr).header.stamp
        stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
        self.rays.append(stamp_ns)

    def _on_sample(self, sample: WristSample, _user: str) -> None:
        self.samples.append(sample)

    def put_ray(self, user: str, stamp_ns: int) -> None:
        """Publish a ray on our bus."""
        ray = PointingRay(stamp_ns=stamp_ns, origin_m=(0.0, 0.0, 1.64), direction=(1.0, 0.0, 0.0))
        self._ours[user].put(ray)

    def put_rotation(self, user: str, stamp_ns: int) -> None:
        """Publish the orientation of an arm in ROS."""
        make = self.types.make
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        stamp = make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        header = make("std_msgs/msg/Header", stamp=stamp, frame_id="arm")
        x, y, z, w = rotation.from_azimuth_elevation(0.3, -0.2)
        quaternion = make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        message = make(ROTATION_TYPE, header=header, quaternion=quaternion)
        self._ros_end[user].put(self.types.encode(ROTATION_TYPE, message))

    async def ready(self) -> None:
        """Wait until messages of every person arrive both ways."""
        async with asyncio.timeout(TIMEOUT_S):
            while min(len(self.rays), len(self.samples)) < USERS:
                for user in self.users:
                    self.put_ray(user, time.time_ns())
                    self.put_rotation(user, time.time_ns())
                await asyncio.sleep(0.1)
        await asyncio.sleep(SETTLE_S)


async def measure(duration_s: float) -> dict[str, Any]:
    """Return cost and delivery of the bridge, and of a bare relay."""
    bare = await bare_zenoh.measure_relay(USERS * HZ, duration_s)
    async with bridged() as ends:
        await ends.ready()
        result: dict[str, Any] = {
            "users": USERS,
            "messages_per_second": USERS * HZ,
            "before": machine(),
            "bare_relay": bare,
        }
        result["nothing"] = await _cost(ends, duration_s, [])
        directions: dict[str, list[Callable[[str, int], None]]] = {
            "out": [ends.put_ray],
            "in": [ends.put_rotation],
            "both": [ends.put_ray, ends.put_rotation],
        }
        for direction, puts in directions.items():
            result[direction] = [await _cost(ends, duration_s, puts) for _ in range(ROUNDS)]
        memory_bytes = ends.process.memory_info().rss
        result["memory_mb"] = round(memory_bytes / 1e6, 1)
        result["after"] = machine()
        return result


@asynccontextmanager
async def bridged() -> AsyncGenerator[Ends]:
    """Yield both ends of a bridge that has started."""
    bus_endpoint = f"tcp/127.0.0.1:{free_port()}"
    ros_endpoint = f"tcp/127.0.0.1:{free_port()}"
    bus = await ZenohBus.open(Link(listen=(bus_endpoint,)))
    config = BackendConfig(mode="router", endpoint=ros_endpoint, node="/robot", domain_id=7)
    backend = await opened(config, StderrWarnings())
    with tempfile.TemporaryDirectory() as folder:
        routes = Path(folder) / "routes.yaml"
        routes.write_text(ROUTES)
        has_bridge = asyncio.Event()

        def on_graph(graph: Graph) -> None:
            nodes = {(endpoint.name, endpoint.node) for endpoint in graph.endpoints}
            if ("/packages", "/pointit") in nodes:
                has_bridge.set()

        # The graph is watched before the bridge starts: no change of it is missed.
        backend.watch(on_graph)
        command = [sys.executable, "-m", "pointit.services", "ros2"]
        command += ["--connect", bus_endpoint, "--routes", f"{routes}"]
        command += ["--backend.mode", "peer", "--backend.endpoint", ros_endpoint, "--backend.domain-id", "7"]
        child = await asyncio.create_subprocess_exec(*command, stderr=subprocess.DEVNULL)
        try:
            async with asyncio.timeout(TIMEOUT_S):
                await has_bridge.wait()
            yield Ends(bus, backend, psutil.Process(child.pid))
        finally:
            child.terminate()
            await child.wait()
            await backend.close()
            await bus.close()


async def _cost(ends: Ends, duration_s: float, puts: list[Callable[[str, int], None]]) -> dict[str, Any]:
    """Return the CPU share of the bridge while each of `puts` publishes `HZ` messages of each person."""
    ends.rays.clear()
    ends.samples.clear()
    superseded_before = ends.reader.traffic.dropped

    def put_all(turn: int) -> None:
        user = ends.users[turn % USERS]
        for put in puts:
            put(user, time.time_ns())

    turns_hz = HZ * USERS
    messages, figures = await relay_cost(ends.process, put_all, turns_hz, duration_s, per_turn=len(puts))
    # superseded by the same person's next one while this process was stopped
    superseded = ends.reader.traffic.dropped - superseded_before
    arrived = len(ends.rays) + len(ends.samples)
    lost = messages - arrived - superseded
    return {**figures, "superseded": superseded, "lost": lost}
