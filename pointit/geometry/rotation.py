"""Rotations as quaternions (x, y, z, w), scalar last; `world_from_arm` rotates arm vectors into the world."""

import math

from pointit.geometry.vector import Vec3

Quaternion = tuple[float, float, float, float]
"""x, y, z, w with norm 1."""

IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the product, b applied first: world_from_body is world_from_arm times arm_from_body."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    w = aw * bw - ax * bx - ay * by - az * bz
    return (x, y, z, w)


def inverse(q: Quaternion) -> Quaternion:
    """Return the inverse rotation."""
    return (-q[0], -q[1], -q[2], q[3])


def rotate(q: Quaternion, v: Vec3) -> Vec3:
    """Return `v` rotated by `q`."""
    x, y, z, w = q
    vx, vy, vz = v

    # v + w t + q x t, where t = 2 q x v
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    rotated_x = vx + w * tx + y * tz - z * ty
    rotated_y = vy + w * ty + z * tx - x * tz
    rotated_z = vz + w * tz + x * ty - y * tx
    return (rotated_x, rotated_y, rotated_z)


def from_axis_angle(axis: Vec3, angle_rad: float) -> Quaternion:
    """Return the rotation by `angle_rad` about the unit vector `axis`."""
    x, y, z = axis
    s = math.sin(angle_rad / 2.0)
    return (x * s, y * s, z * s, math.cos(angle_rad / 2.0))


def from_yaw(yaw_rad: float) -> Quaternion:
    """Return the rotation about z."""
    return from_axis_angle((0.0, 0.0, 1.0), yaw_rad)


def from_roll_pitch_yaw(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Return the rotation by roll about x, then pitch about y, then yaw about z, all axes fixed."""
    roll = from_axis_angle((1.0, 0.0, 0.0), roll_rad)
    pitch = from_axis_angle((0.0, 1.0, 0.0), pitch_rad)
    return multiply(from_yaw(yaw_rad), multiply(pitch, roll))


def from_azimuth_elevation(azimuth_rad: float, elevation_rad: float, roll_rad: float = 0.0) -> Quaternion:
    """Return the rotation whose x axis has that azimuth and elevation, after `roll_rad` about x."""
    pitch = from_axis_angle((0.0, 1.0, 0.0), -elevation_rad)  # upwards is a negative turn about y
    roll = from_axis_angle((1.0, 0.0, 0.0), roll_rad)
    return multiply(from_yaw(azimuth_rad), multiply(pitch, roll))


def angle_between(a: Quaternion, b: Quaternion) -> float:
    """Return the angle of the rotation from `a` to `b`, 0 to pi. Both signs of a quaternion are the same."""
    x, y, z, w = multiply(inverse(a), b)
    return 2.0 * math.atan2(math.hypot(x, y, z), abs(w))


def normalized(q: Quaternion) -> Quaternion:
    """Return `q` with norm 1.

    Raises:
        ValueError: If `q` is zero.
    """
    x, y, z, w = q
    length = math.hypot(x, y, z, w)
    if length == 0.0:
        raise ValueError("the null quaternion is no rotation")
    return (x / length, y / length, z / length, w / length)
