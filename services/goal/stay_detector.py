"""Stays of a cursor within a radius, and the order of its messages."""

import math
from dataclasses import dataclass
from typing import Literal

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor

GAP_NS = 300_000_000
"""Time without cursors that ends a stay."""
BACK_NS = NS_PER_S
"""A cursor older than the one before by at most this is late. One older still is of a clock that was set."""

LEFT = 2.0
"""Distance at which a place is left, in radii."""


def cursor_order(previous: Cursor | None, cursor: Cursor) -> Literal["late", "next", "gap"]:
    """Return the order of `cursor`: late, next after the previous one, or next after a gap."""
    if previous is None:
        return "next"
    step_ns = cursor.stamp_ns - previous.stamp_ns
    if -BACK_NS <= step_ns < 0:
        return "late"
    return "next" if 0 <= step_ns <= GAP_NS else "gap"


@dataclass
class _Stay:
    first_m: Vec3
    surface_id: str
    since_ns: int
    total_m: Vec3 = (0.0, 0.0, 0.0)
    count: int = 0

    @property
    def mean_m(self) -> Vec3:
        return vector.scale(self.total_m, 1.0 / self.count)


class StayDetector:
    """Reports each stay of a cursor within a radius once. The next begins after that place was left."""

    def __init__(self, radius_m: float, dwell_s: float) -> None:
        """Detect stays of `dwell_s` within `radius_m` of the first cursor."""
        self._radius_m = radius_m
        self._dwell_ns = round(dwell_s * NS_PER_S)
        self._stay: _Stay | None = None
        self._over: tuple[str, Vec3] | None = None
        """Surface and place of the last reported stay, until it is left."""

    def interrupt(self) -> None:
        """End the current stay, as cursors are missing."""
        self._stay = None

    def reset(self) -> None:
        """Forget the current stay and the last one, so that the next may be anywhere."""
        self._stay = None
        self._over = None

    def bar(self, surface_id: str, place_m: Vec3) -> None:
        """Report no stay until the cursor has left `place_m`, {W}."""
        self._stay = None
        self._over = (surface_id, place_m)

    def on_cursor(self, place_m: Vec3 | None, surface_id: str, stamp_ns: int) -> Vec3 | None:
        """Return the mean place, {W}, of the stay that this cursor completes, None if it completes none.

        Args:
            place_m: an allowed place, or None.
            surface_id: id of the surface there.
            stamp_ns: stamp of the cursor, ns.
        """
        # After a report the next stay begins when that place was left
        if self._over is not None:
            over_surface_id, over_place_m = self._over
            if self.is_away(place_m, surface_id, over_surface_id, over_place_m):
                self.reset()
        if place_m is None:
            self._stay = None
        if place_m is None or self._over is not None:
            return None

        # The stay goes on within the radius of its first cursor
        stay = self._stay
        if stay is None or stay.surface_id != surface_id or math.dist(stay.first_m, place_m) > self._radius_m:
            stay = _Stay(place_m, surface_id, stamp_ns)
            self._stay = stay
        stay.total_m = vector.add(stay.total_m, place_m)
        stay.count += 1
        if stamp_ns - stay.since_ns < self._dwell_ns:
            return None
        self.bar(surface_id, stay.mean_m)
        return stay.mean_m

    def is_away(self, here_m: Vec3 | None, here_id: str, surface_id: str, place_m: Vec3) -> bool:
        """Return True if `here_m` on surface `here_id` is no longer at `place_m` on `surface_id`."""
        if here_m is None or here_id != surface_id:
            return True
        return math.dist(here_m, place_m) > LEFT * self._radius_m
