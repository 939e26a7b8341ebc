"""Closest point of a segment to a ray, by angle and by metres, in closed form (pointing.md §5).

A ray starts at o and has the unit direction d. A segment runs from o + a to o + a + u. Its points are
o + a + t·u with t from 0 to 1. Plain Python for single segments; `ray_cast` has the same formulas on arrays.
"""

import math
from typing import Literal, NamedTuple

from pointit.geometry import vector
from pointit.geometry.vector import Vec3

Measure = Literal["angle", "metres"]
"""Quantity to minimize: the angle at the ray's origin, or the distance to the ray."""

TINY = 1e-30
"""Replaces vanishing denominators, so that quotients grow large but not infinite."""


class Hit(NamedTuple):
    """A point of a target, and its distances to the ray."""

    target: int
    """Index of the target."""
    position_m: float
    """Arc length along the target from its start, 0 for a point."""
    point_m: Vec3
    miss_m: float
    """Distance of the point to the ray, or to its origin if the point lies behind it."""
    miss_rad: float
    """Angle at the ray's origin between the ray and the point, 0 to pi."""
    range_m: float
    """Distance from the ray's origin to the point."""
    uv_m: tuple[float, float] | None = None
    """Position on a thing with an area, in its own two axes."""


def make_hit(target: int, position_m: float, point_m: Vec3, origin_m: Vec3, direction: Vec3) -> Hit:
    """Return the hit of `point_m` with its misses by the ray from `origin_m` along the unit `direction`."""
    (px, py, pz), (ox, oy, oz), (dx, dy, dz) = point_m, origin_m, direction
    x, y, z = px - ox, py - oy, pz - oz
    along = dx * x + dy * y + dz * z
    across = math.hypot(dy * z - dz * y, dz * x - dx * z, dx * y - dy * x)
    range_m = math.hypot(x, y, z)
    miss_m = across if along >= 0.0 else range_m
    return Hit(target, position_m, point_m, miss_m, math.atan2(across, along), range_m)


def nearest_in_angle(a: Vec3, u: Vec3, d: Vec3) -> tuple[float, float]:
    """Return t of the segment's point at the smallest angle from d, and minus that angle's cosine.

    The cosine (p + q·t) / |a + t·u|, with p = d·a and q = d·u, has a single stationary point, t = (q·a² -
    p·(a·u)) / (p·u² - q·(a·u)). A maximum counts, clamped to the segment. If it is a minimum, an end is
    nearest. The point at the ray's own origin has no angle and is chosen last.
    """
    (ax, ay, az), (ux, uy, uz), (dx, dy, dz) = a, u, d
    p, q = dx * ax + dy * ay + dz * az, dx * ux + dy * uy + dz * uz
    aa, au, uu = ax * ax + ay * ay + az * az, ax * ux + ay * uy + az * uz, ux * ux + uy * uy + uz * uz
    best_t, best_cost = 0.0, (-p / math.sqrt(aa) if aa > TINY else 1.0)
    square = aa + (2.0 * au + uu)
    cost = -(p + q) / math.sqrt(square) if square > TINY else 1.0
    if cost < best_cost:
        best_t, best_cost = 1.0, cost
    along = p * uu - q * au
    t = (q * aa - p * au) / (along if along > TINY else TINY)  # noqa: FURB136 - `max` costs as much as all this
    if 0.0 < t < 1.0:  # beyond, it is an end
        square = aa + t * (2.0 * au + t * uu)
        cost = -(p + t * q) / math.sqrt(square) if square > TINY else 1.0
        if cost < best_cost:
            best_t, best_cost = t, cost
    return best_t, best_cost


def nearest_in_metres(a: Vec3, u: Vec3, d: Vec3) -> tuple[float, float]:
    """Return t of the segment's point nearest to the ray, and its squared distance, m².

    Two points are compared: the one nearest to the whole line (correct unless it lies behind the ray's
    origin) and the one nearest to the origin. If the segment is parallel to the ray, any of its equally near
    points may be returned.
    """
    p, q = vector.dot(d, a), vector.dot(d, u)
    aa, au, uu = vector.dot(a, a), vector.dot(a, u), vector.dot(u, u)
    best_t, best_cost = 0.0, math.inf
    for quotient in ((p * q - au) / max(uu - q * q, TINY), -au / max(uu, TINY)):
        t = min(max(quotient, 0.0), 1.0)
        ahead = max(p + t * q, 0.0)
        cost = aa + t * (2.0 * au + t * uu) - ahead * ahead
        if cost < best_cost:
            best_t, best_cost = t, cost
    return best_t, best_cost


def clip_to_reach(p: float, q: float, reach_m: float) -> tuple[float, float] | None:
    """Return the interval of t in which a segment is within `reach_m` along the ray, or None.

    Args:
        p: distance along the ray of the segment's start, d·a.
        q: additional distance of its end, d·u.
        reach_m: maximum distance along the ray.
    """
    if max(p, p + q) <= reach_m:
        return 0.0, 1.0
    if min(p, p + q) > reach_m:
        return None
    crossing = (reach_m - p) / q
    return (0.0, crossing) if q > 0.0 else (crossing, 1.0)
