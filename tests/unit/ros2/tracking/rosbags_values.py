"""Values of ROS types, which the serializer of rosbags writes as CDR."""

import math
from typing import Any

import numpy as np

from pointit.bridges.ros2.types.definitions import Definitions
from pointit.plugins import NS_PER_S
from tests.unit.ros2.scenes import NOW_NS, jazzy

STORE = Definitions("jazzy").store
NAN = math.nan
QUARTER = math.sqrt(0.5)
UP, BACKWARDS, LEFT = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, QUARTER, QUARTER)
"""Orientations of a robot that faces x, -x, and y."""
Quaternion = tuple[float, float, float, float]


def message(name: str, *values: Any) -> Any:
    return STORE.types[name](*values)


def header(frame: str, *, stamp_ns: int = NOW_NS) -> Any:
    time = message("builtin_interfaces/msg/Time", stamp_ns // NS_PER_S, stamp_ns % NS_PER_S)
    return message("std_msgs/msg/Header", time, frame)


def vector(x: float, y: float = 0.0, z: float = 0.0) -> Any:
    return message("geometry_msgs/msg/Vector3", x, y, z)


def posed(x: float, turned: Quaternion = UP) -> Any:
    point = message("geometry_msgs/msg/Point", x, 2.0, 0.0)
    return message("geometry_msgs/msg/Pose", point, message("geometry_msgs/msg/Quaternion", *turned))


def matrix(*diagonal: float, rest: float = 0.0) -> Any:
    values = np.full((6, 6), rest)
    np.fill_diagonal(values, (*diagonal, *(0.0,) * (6 - len(diagonal))))
    return values.reshape(36)


def odometry(
    *,
    frame: str = "map",
    child: str = "base_link",
    turned: Quaternion = BACKWARDS,
    forward_mps: float = 0.5,
    covariance: Any = None,
    twist_covariance: Any = None,
    x: float = 1.0,
    stamp_ns: int = NOW_NS,
) -> Any:
    """Return the decoded message, from bytes that rosbags has written."""
    unknown = np.zeros(36)
    pose = message(
        "geometry_msgs/msg/PoseWithCovariance",
        posed(x, turned),
        unknown if covariance is None else covariance,
    )
    twist = message(
        "geometry_msgs/msg/TwistWithCovariance",
        message("geometry_msgs/msg/Twist", vector(forward_mps), vector(0.0)),
        unknown if twist_covariance is None else twist_covariance,
    )
    name = "nav_msgs/msg/Odometry"
    return decoded(name, message(name, header(frame, stamp_ns=stamp_ns), child, pose, twist))


def decoded(name: str, value: Any) -> Any:
    return jazzy().decode(name, bytes(STORE.serialize_cdr(value, name)))


def transforms(*links: tuple[str, str, float], turned: Quaternion = UP, stamp_ns: int = NOW_NS) -> Any:
    made = [
        message(
            "geometry_msgs/msg/TransformStamped",
            header(parent, stamp_ns=stamp_ns),
            child,
            message(
                "geometry_msgs/msg/Transform", vector(x), message("geometry_msgs/msg/Quaternion", *turned)
            ),
        )
        for parent, child, x in links
    ]
    return message("tf2_msgs/msg/TFMessage", made)
