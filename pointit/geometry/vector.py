"""3-D vectors in plain Python, which is several times faster than numpy for single vectors."""

import math

Vec3 = tuple[float, float, float]


def add(a: Vec3, b: Vec3) -> Vec3:
    """Return a + b."""
    ax, ay, az = a
    bx, by, bz = b
    return (ax + bx, ay + by, az + bz)


def subtract(a: Vec3, b: Vec3) -> Vec3:
    """Return a - b."""
    ax, ay, az = a
    bx, by, bz = b
    return (ax - bx, ay - by, az - bz)


def scale(a: Vec3, factor: float) -> Vec3:
    """Return factor · a."""
    x, y, z = a
    return (x * factor, y * factor, z * factor)


def dot(a: Vec3, b: Vec3) -> float:
    """Return a · b."""
    ax, ay, az = a
    bx, by, bz = b
    return ax * bx + ay * by + az * bz


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Return a x b."""
    ax, ay, az = a
    bx, by, bz = b
    return (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def norm(a: Vec3) -> float:
    """Return |a|."""
    return math.hypot(a[0], a[1], a[2])


def normalized(a: Vec3) -> Vec3:
    """Return a / |a|.

    Raises:
        ValueError: If `a` is zero.
    """
    x, y, z = a
    length = math.hypot(x, y, z)
    if length == 0.0:
        raise ValueError("the null vector has no direction")
    factor = 1.0 / length
    return (x * factor, y * factor, z * factor)


def angle_between(a: Vec3, b: Vec3) -> float:
    """Return the angle from a to b, 0 to pi; exact for small angles too (Kahan)."""
    x, y, z = a
    u, v, w = b
    across = math.hypot(y * w - z * v, z * u - x * w, x * v - y * u)
    along = x * u + y * v + z * w
    return math.atan2(across, along)


def azimuth(a: Vec3) -> float:
    """Return the angle of a's horizontal part from x towards y, rad."""
    return math.atan2(a[1], a[0])


def elevation(a: Vec3) -> float:
    """Return the angle of a above the horizontal, rad."""
    return math.atan2(a[2], math.hypot(a[0], a[1]))


def direction(azimuth_rad: float, elevation_rad: float) -> Vec3:
    """Return the unit vector with that azimuth and elevation."""
    level = math.cos(elevation_rad)
    return (level * math.cos(azimuth_rad), level * math.sin(azimuth_rad), math.sin(elevation_rad))


def rotate_z(a: Vec3, yaw_rad: float) -> Vec3:
    """Return `a` rotated about z."""
    x, y, z = a
    c = math.cos(yaw_rad)
    s = math.sin(yaw_rad)
    return (c * x - s * y, s * x + c * y, z)


def wrap(angle_rad: float) -> float:
    """Return the same angle in (-pi, pi]."""
    return math.pi - (math.pi - angle_rad) % math.tau
