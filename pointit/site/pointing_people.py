"""People who point, by their rays in the room, and the one of them who uses a robot. Pure."""

from collections.abc import Callable
from dataclasses import dataclass

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor

MAX_CURSOR_AGE_S = 1.0
"""Age up to which a ray counts, s."""
TURN_S = 2.0
"""Time without pointing at what the robot is for after which others may use it, s."""
MIN_SLOPE = 0.05
"""Minimum vertical part of a unit direction that meets a horizontal plane at a usable distance."""


@dataclass(frozen=True)
class PersonRay:
    """Pointing ray of one person in the room's frame {W}."""

    stamp_ns: int
    origin_m: Vec3
    direction: Vec3
    """Unit vector."""

    def angle_to(self, point_m: Vec3) -> float:
        """Return the angle between the ray and `point_m`, rad."""
        return vector.angle_between(self.direction, vector.subtract(point_m, self.origin_m))

    def at_height(self, height_m: float) -> Vec3 | None:
        """Return the point at which the ray has this height, {W}, m.

        None if it is level, or leads away from that height.
        """
        slope = self.direction[2]
        rise_m = height_m - self.origin_m[2]
        if abs(slope) < MIN_SLOPE:
            return None
        if rise_m * slope < 0.0:
            return None
        x, y, _ = vector.add(self.origin_m, vector.scale(self.direction, rise_m / slope))
        return (x, y, height_m)


class PointingPeople:
    """Newest ray of each person who points. One person at a time owns the robot, until they point elsewhere.

    Rays are those of cursors, which the service `pointing` has smoothed.
    """

    def __init__(self, turn_s: float = TURN_S) -> None:
        """Create without people. `turn_s`: see `choose_owner`."""
        self.owner = ""
        """Person who uses the robot, or `""`."""
        self._turn_s = turn_s
        self._rays: dict[str, PersonRay] = {}
        self._wanted_ns = 0
        """Last time at which the owner pointed at what the robot is for, ns."""

    def __contains__(self, user: str) -> bool:
        """Return True if `user` points."""
        return user in self._rays

    @property
    def owners_ray(self) -> PersonRay | None:
        """Return the ray of the owner, or None if they do not point or there is no owner."""
        return self._rays.get(self.owner)

    def on_cursor(self, cursor: Cursor, user: str) -> None:
        """Store the newest ray of `user`: a handler for `topics.CURSOR`."""
        self._rays.pop(user, None)
        origin_m = cursor.origin_m
        direction = cursor.direction
        if origin_m is not None and direction is not None:
            self._rays[user] = PersonRay(cursor.stamp_ns, origin_m, vector.normalized(direction))

    def choose_owner(self, now_ns: int, is_wanted: Callable[[PersonRay], bool], *, is_busy: bool) -> None:
        """Remove old rays, and give the robot to another person if its owner has lost their turn.

        Args:
            now_ns: time, ns.
            is_wanted: returns True for a ray at what the robot is for.
            is_busy: True if the robot may not change hands, as it holds something.
        """
        oldest_ns = now_ns - MAX_CURSOR_AGE_S * NS_PER_S
        candidates: list[str] = []
        for user, ray in list(self._rays.items()):
            if ray.stamp_ns <= oldest_ns:
                del self._rays[user]
            elif is_wanted(ray):
                candidates.append(user)
        if self.owner in candidates:
            self._wanted_ns = now_ns
            return
        has_lost_turn = now_ns - self._wanted_ns > self._turn_s * NS_PER_S
        may_change = has_lost_turn and not is_busy
        if may_change or not self.owner:
            self.owner = min(candidates, default="")
            self._wanted_ns = now_ns
