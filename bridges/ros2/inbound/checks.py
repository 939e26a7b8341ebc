"""Validation of foreign values: each check returns the value, or the reason of its rejection."""

import math
from typing import Any

from pointit.bridges.ros2.routing.route_types import ConversionContext
from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import FARTHEST, NS_PER_S
from pointit.schemas.base import NORM_TOLERANCE
from pointit.schemas.message_age import message_age_ns
from pointit.schemas.text import one_line

LATE_NS = 10 * NS_PER_S
"""Stamps further in the past belong to another clock."""

STEEPEST_RAD = math.radians(70.0)
"""Maximum elevation of an x axis that defines a heading."""

MAX_NAME = 60
"""Maximum characters of a foreign name in a message."""


def quaternion(value: Any, label: str) -> Quaternion | str:
    """Return a geometry_msgs/Quaternion with norm 1, or the rejection."""
    q = (float(value.x), float(value.y), float(value.z), float(value.w))
    norm = math.hypot(*q)
    if not abs(norm - 1.0) <= NORM_TOLERANCE:  # false for NaN as well
        return f"{label} is not a rotation: the norm of its quaternion is {norm:.4g}; send one with norm 1"
    return rotation.normalized(q)


def place(value: Any, label: str) -> Vec3 | str:
    """Return a geometry_msgs/Point or Vector3 in metres, or the rejection."""
    x = float(value.x)
    y = float(value.y)
    z = float(value.z)
    if not all(abs(coordinate) <= FARTHEST for coordinate in (x, y, z)):
        position = f"({x:g}, {y:g}, {z:g}) m"
        return f"{label} is not a position: {position}; send metres"
    return (x, y, z)


def velocity(value: Any) -> Vec3 | str:
    """Return the velocity of a twist, a geometry_msgs/Vector3 in m/s, or why it cannot be used."""
    x = float(value.x)
    y = float(value.y)
    z = float(value.z)
    if not all(abs(component) <= FARTHEST for component in (x, y, z)):
        vector_text = f"({x:g}, {y:g}, {z:g}) m/s"
        return f"the twist is no velocity: {vector_text}; send m/s, or a covariance of -1 if unknown"
    return (x, y, z)


def heading(orientation: Quaternion, label: str) -> float | str:
    """Return the azimuth of the x axis, rad, or the rejection."""
    x_axis = rotation.rotate(orientation, (1.0, 0.0, 0.0))
    elevation = vector.elevation(x_axis)
    if abs(elevation) > STEEPEST_RAD:
        return (
            f"{label} has no heading: its x axis points {math.degrees(elevation):.0f}° up; send the frame at "
            "the person's feet, x forward, z up"
        )
    return vector.azimuth(x_axis)


def stated_ns(stamp: Any) -> int | None:
    """Return a builtin_interfaces/Time, Unix ns, or None for 0, by which ROS nodes state none."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec) or None


def stamp(value: Any, context: ConversionContext, label: str) -> tuple[int, str]:
    """Return the time of capture, Unix ns, and a warning, or `""`. A bad stamp is replaced by now."""
    stamp_ns = stated_ns(value)
    if stamp_ns is None:
        return context.stamp_ns, ""
    age_ns = message_age_ns(stamp_ns, context.stamp_ns)
    if -MAX_AHEAD_NS <= age_ns <= LATE_NS:
        return max(stamp_ns, 0), ""
    side = "behind" if age_ns > 0 else "ahead of"
    apart_s = abs(age_ns) / NS_PER_S
    sentence = (
        f"{label} is stamped {apart_s:.1f} s {side} the site's clock, and counts as of its "
        "arrival: synchronize the clocks, or let both follow /clock"
    )
    return context.stamp_ns, sentence


def named(name: str) -> str:
    """Return a foreign name for messages."""
    return one_line(repr(name), MAX_NAME)
