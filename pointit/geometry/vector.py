"""3-D vectors in plain Python, which is several times faster than numpy for single vectors."""

import math

Vec3 = tuple[float, float, float]


def add(a: Vec3, b: Vec3) -> Vec3:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vec3, b: Vec3) -> Vec3:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a: Vec3, factor: float) -> Vec3:
    """Return factor · a."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def dot(a: Vec3, b: Vec3) -> float:
    """Return a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Return a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


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
    (x, y, z), (u, v, w) = a, b
    return math.atan2(math.hypot(y * w - z * v, z * u - x * w, x * v - y * u), x * u + y * v + z * w)


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
    c = math.cos(yaw_rad)
    s = math.sin(yaw_rad)
    return (c * a[0] - s * a[1], s * a[0] + c * a[1], a[2])


def wrap(angle_rad: float) -> float:
    """Return the same angle in (-pi, pi]."""
    return math.pi - (math.pi - angle_rad) % math.tau
