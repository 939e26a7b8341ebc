"""Small ROS values that messages are composed of; every value of our messages fits."""

from typing import Any

from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.bridges.ros2.types.types import Types
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.schemas.base import Rgb

LAST_S = 2**31 - 1
"""Last second of a ROS time, in 2038."""

MAX_TEXT = 1000
"""Maximum characters of a text."""


def time(types: Types, stamp_ns: int) -> Any:
    """Return a time in Unix ns, `LAST_S` at most."""
    seconds, rest_ns = divmod(stamp_ns, NS_PER_S)
    if seconds > LAST_S:
        seconds = LAST_S
        rest_ns = 0
    return types.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest_ns)


def header(types: Types, stamp_ns: int, frame: str) -> Any:
    """Return a header."""
    return types.make("std_msgs/msg/Header", stamp=time(types, stamp_ns), frame_id=frame)


def stamped(context: ConversionContext, kind: str, **fields: Any) -> Converted:
    """Return a message of type `kind` with the header of `context` and these fields."""
    types = context.state.types
    own_header = header(types, context.stamp_ns, context.frame)
    return (types.make(kind, header=own_header, **fields),)


def point(types: Types, place_m: Vec3) -> Any:
    """Return a point."""
    x, y, z = place_m
    return types.make("geometry_msgs/msg/Point", x=x, y=y, z=z)


def vector3(types: Types, values: Vec3) -> Any:
    """Return a vector."""
    x, y, z = values
    return types.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def quaternion(types: Types, orientation: Quaternion) -> Any:
    """Return a rotation."""
    x, y, z, w = orientation
    return types.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def pose(types: Types, place_m: Vec3, orientation: Quaternion) -> Any:
    """Return a pose."""
    return types.make(
        "geometry_msgs/msg/Pose", position=point(types, place_m), orientation=quaternion(types, orientation)
    )


def color(types: Types, rgb: Rgb, alpha: float = 1.0) -> Any:
    """Return a colour."""
    red, green, blue = rgb
    return types.make("std_msgs/msg/ColorRGBA", r=red / 255.0, g=green / 255.0, b=blue / 255.0, a=alpha)


def text(words: str) -> str:
    """Return `words` as a ROS string: without NUL, and shortened."""
    return words.replace("\0", "")[:MAX_TEXT]
