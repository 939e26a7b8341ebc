"""Shared by the tests of conversions: types, a room, the row of a name, values that went through CDR."""

import functools
import math
from typing import Any

import pointit.schemas as models
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.route_types import InboundRoute, OutboundRoute, ServiceRoute
from pointit.bridges.ros2.routing.routes import Routes, routes
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation
from pointit.geometry.vector import Vec3

NOW_NS = 1_700_000_000 * models.NS_PER_S + 5

ROOM = models.Environment(
    stamp_ns=NOW_NS,
    name="room",
    lamps=(models.Lamp(id="led_0", position_m=(1.0, 2.0, 3.0)),),
    strips=(models.Strip(id="0", line_m=((0.0, 0.0, 1.0), (4.0, 0.0, 1.0)), pixels=8),),
    belts=(
        models.Belt(id="part_a", line_m=((0.0, 0.0, 0.0), (0.0, 2.0, 0.0))),
        models.Belt(id="part_b", line_m=((0.0, 5.0, 0.0), (3.0, 5.0, 0.0))),
    ),
)

CURSOR = models.Cursor(
    stamp_ns=NOW_NS,
    surface="belt",
    surface_id="part_a",
    point_m=(0.0, 0.5, 0.0),
    position_m=0.5,
    miss_m=0.25,
    range_m=2.0,
    origin_m=(0.0, 0.5, 2.0),
    direction=(0.0, 0.0, -1.0),
)
POSE = models.UserPose(
    stamp_ns=NOW_NS,
    position_m=(1.0, 2.0, 0.5),
    yaw_rad=math.pi / 2.0,
    covariance=(0.04, 0.0, 0.001, 0.0, 0.01, 0.002, 0.001, 0.002, 0.003),
    z_sigma_m=0.1,
)


@functools.cache
def jazzy() -> Types:
    return Types("jazzy")


def time_of(stamp_ns: int) -> Any:
    sec, nanosec = divmod(stamp_ns, models.NS_PER_S)
    return jazzy().make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def stamped(stamp_ns: int = NOW_NS, frame: str = "") -> Any:
    return jazzy().make("std_msgs/msg/Header", stamp=time_of(stamp_ns), frame_id=frame)


def triple(name: str, at: Vec3) -> Any:
    x, y, z = at
    return jazzy().make(f"geometry_msgs/msg/{name}", x=x, y=y, z=z)


def quaternion(q: rotation.Quaternion) -> Any:
    x, y, z, w = q
    return jazzy().make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def pose_at(at: Vec3, q: rotation.Quaternion = rotation.IDENTITY) -> Any:
    return jazzy().make("geometry_msgs/msg/Pose", position=triple("Point", at), orientation=quaternion(q))


def transform(
    parent: str,
    child: str,
    at: Vec3 = (0.0, 0.0, 0.0),
    q: rotation.Quaternion = rotation.IDENTITY,
    stamp_ns: int = NOW_NS,
) -> Any:
    make = jazzy().make
    header = stamped(stamp_ns, parent)
    moved = make("geometry_msgs/msg/Transform", translation=triple("Vector3", at), rotation=quaternion(q))
    name = "geometry_msgs/msg/TransformStamped"
    return make(name, header=header, child_frame_id=child, transform=moved)


def furnished() -> ConversionState:
    scene = ConversionState(jazzy())
    scene.take("", ROOM, NOW_NS)
    return scene


def out(table: Routes, name: str) -> OutboundRoute:
    return next(row for row in table.outward if row.name == name)


def into(name: str) -> InboundRoute:
    return next(row for row in routes().inward if row.name == name)


def server(name: str) -> ServiceRoute:
    return next(row for row in routes().served if row.name == name)


def sent(
    row: OutboundRoute,
    message: models.Message,
    scene: ConversionState,
    name: str = "user1",
    *,
    again_ns: int | None = None,
) -> list[Any]:
    """ROS values of a message that comes now."""
    scene.take(name, message, max(scene.now_ns, NOW_NS))
    values = row.convert(message, name, scene, again_ns=again_ns)
    return [jazzy().decode(row.type, jazzy().encode(row.type, value)) for value in values]


def turned(value: Any) -> rotation.Quaternion:
    return (value.x, value.y, value.z, value.w)


def package(
    number: int, *, belt: str = "part_a", at_m: float = 1.0, kind: str = "red"
) -> models.TrackedObject:
    return models.TrackedObject(
        id=f"19-{number}",
        kind=kind,
        position_m=(0.0, at_m, 0.0),
        length_m=0.3,
        surface="belt",
        surface_id=belt,
        surface_position_m=at_m,
    )


def objects(*items: models.TrackedObject) -> models.TrackedObjects:
    return models.TrackedObjects(stamp_ns=NOW_NS, objects=items)
