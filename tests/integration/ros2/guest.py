"""A person whose nodes are all of ROS: what these say all the time, and when she wants something."""

import asyncio
import contextlib
import time
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import SENSOR, Backend, Qos
from pointit.bridges.ros2.graph.backends import opened
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from tests.integration.ros2.nodes import DOMAIN, Shown

TYPES = Types("jazzy")
EYES_M = (0.0, 0.0, 1.64)
RAY_HZ = 50.0
COLOR = (1.0, 0.0, 1.0)
WIDTH_M = 0.3
make = TYPES.make


class Nodes:
    """Driver, pointing node, localizer and supervisor of one person, as one node."""

    def __init__(self, backend: Backend, user: str, at_m: Vec3, yaw_rad: float) -> None:
        self._user = user
        self._at_m, self._yaw_rad = at_m, yaw_rad
        self._azimuth_rad, self._elevation_rad = 0.0, 1.0
        self._frame = f"{user}/human_footprint"
        self._backend = backend
        self._kinds: dict[str, str] = {}
        self._writers: dict[str, Any] = {}
        self.heard: dict[str, list[bytes]] = {}
        self.nodes: dict[str, set[str]] = {}
        """By name of a topic, who publishes it."""
        self._ray = f"/{user}/pointing_ray"
        self._button = f"/{user}/metawear_ros/button"
        for name, kind, qos in (
            (self._ray, "geometry_msgs/msg/PoseStamped", SENSOR),
            ("/tf", "tf2_msgs/msg/TFMessage", Qos(depth=100)),
            ("/PUI_subscription", "conveyor_msgs/msg/PUISubscription", Qos(depth=10)),
            (self._button, "std_msgs/msg/Bool", Qos(depth=1, latched=True)),
        ):
            self._kinds[name] = kind
            self._writers[name] = backend.advertise(name, TYPES.kind(kind), qos)
            backend.subscribe(name, TYPES.kind(kind), qos, self.heard.setdefault(name, []).append)
        backend.watch(self._look)

    def points_at(self, target_m: Vec3) -> None:
        """Point at a place in the room."""
        way = vector.rotate_z(vector.subtract(target_m, self._at_m), -self._yaw_rad)
        wanted = vector.subtract(way, EYES_M)
        self._azimuth_rad, self._elevation_rad = vector.azimuth(wanted), vector.elevation(wanted)

    def wants_cursor(self, *, wants: bool) -> None:
        """Say so once."""
        red, green, blue = COLOR
        self._say(
            "/PUI_subscription",
            user_name=self._user,
            subscribe=wants,
            pointer_color=make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
            pointer_size=WIDTH_M,
        )

    def presses(self) -> None:
        """Press the button and let it go."""
        for is_down in (True, False):
            self._say(self._button, data=is_down)

    async def live(self) -> None:
        """Say the ray and the place until cancelled."""
        while True:
            header = self._header("world")
            at = make("geometry_msgs/msg/Vector3", **dict(zip("xyz", self._at_m, strict=True)))
            moved = make(
                "geometry_msgs/msg/Transform",
                translation=at,
                rotation=_turned(rotation.from_yaw(self._yaw_rad)),
            )
            frame = make(
                "geometry_msgs/msg/TransformStamped",
                header=header,
                child_frame_id=self._frame,
                transform=moved,
            )
            self._say("/tf", transforms=[frame])
            eyes = make("geometry_msgs/msg/Point", **dict(zip("xyz", EYES_M, strict=True)))
            way = rotation.from_azimuth_elevation(self._azimuth_rad, self._elevation_rad)
            pose = make("geometry_msgs/msg/Pose", position=eyes, orientation=_turned(way))
            self._say(self._ray, header=self._header(self._frame), pose=pose)
            await asyncio.sleep(1.0 / RAY_HZ)

    def _header(self, frame: str) -> Any:
        sec, nanosec = divmod(time.time_ns(), NS_PER_S)
        stamp = make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _say(self, name: str, **fields: Any) -> None:
        kind = self._kinds[name]
        self._writers[name].put(TYPES.encode(kind, make(kind, **fields)))

    def _look(self, graph: Any) -> None:
        self.nodes = {}
        for each in graph.endpoints:
            if each.kind == "publisher":
                self.nodes.setdefault(each.name, set()).add(each.node)


def _turned(q: rotation.Quaternion) -> Any:
    return make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", q, strict=True)))


@asynccontextmanager
async def nodes(endpoint: str, user: str, *, at_m: Vec3, yaw_rad: float) -> AsyncGenerator[Nodes]:
    """Yield the nodes of `user`, who stands at a place, in the ROS graph at `endpoint`."""
    config = BackendConfig(endpoint=endpoint, node=f"/{user}/nodes", domain_id=DOMAIN, mode="client")
    backend = await opened(config, Shown())
    made = Nodes(backend, user, at_m, yaw_rad)
    living = asyncio.create_task(made.live())
    try:
        yield made
    finally:
        living.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await living
        await backend.close()
