"""The rays of the people who point, smoothed, and the person who uses the arm."""

from collections.abc import Callable
from dataclasses import dataclass

from pointit.plugins import NS_PER_S, Cursor, vector

from .simulated_arm import Vec3

SMOOTH_S = 0.15
"""Time constant of the smoothing of a ray, s."""
FRESH_S = 1.0
"""Age up to which a ray counts, s."""
QUIET_S = 2.0
"""Time without a ray near the boxes after which others may use the arm, s."""


@dataclass(frozen=True)
class Ray:
    """Pointing ray of one person."""

    stamp_ns: int
    origin_m: Vec3
    direction: Vec3
    """Unit vector."""

    def angle_to(self, point_m: Vec3) -> float:
        """Return the angle between the ray and `point_m`, rad."""
        return vector.angle_between(self.direction, vector.subtract(point_m, self.origin_m))


class Pointers:
    """Everybody's ray. One person owns the arm, until they point elsewhere for a while."""

    def __init__(self) -> None:
        self.owner = ""
        """Person who uses the arm, or `""`."""
        self._rays: dict[str, Ray] = {}
        self._near_ns = 0
        """Last time at which the owner pointed near a box, ns."""

    def __contains__(self, user: str) -> bool:
        """Return True if `user` points."""
        return user in self._rays

    @property
    def owners_ray(self) -> Ray | None:
        """The ray of the owner, if they point."""
        return self._rays.get(self.owner)

    def on_cursor(self, cursor: Cursor, user: str) -> None:
        """Store a person's newest ray, smoothed with their earlier ones."""
        if cursor.origin_m is None or cursor.direction is None:
            self._rays.pop(user, None)
            return
        direction = cursor.direction
        before = self._rays.get(user)
        if before is not None:
            passed_s = max(cursor.stamp_ns - before.stamp_ns, 0) / NS_PER_S
            share = min(passed_s / SMOOTH_S, 1.0)
            turn = vector.subtract(direction, before.direction)
            direction = vector.add(before.direction, vector.scale(turn, share))
        self._rays[user] = Ray(cursor.stamp_ns, cursor.origin_m, vector.normalized(direction))

    def choose_owner(self, now_ns: int, is_near: Callable[[Ray], bool], *, is_busy: bool) -> None:
        """Give the arm to somebody else if its owner has pointed elsewhere, and it is not busy for them."""
        oldest_ns = now_ns - FRESH_S * NS_PER_S
        self._rays = {user: ray for user, ray in self._rays.items() if ray.stamp_ns > oldest_ns}
        candidates = [user for user, ray in self._rays.items() if is_near(ray)]
        if self.owner in candidates:
            self._near_ns = now_ns
            return
        is_quiet = now_ns - self._near_ns > QUIET_S * NS_PER_S
        if not self.owner or (is_quiet and not is_busy):
            self.owner = min(candidates, default="")
            self._near_ns = now_ns
