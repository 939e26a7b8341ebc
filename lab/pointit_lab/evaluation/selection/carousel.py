"""Packages on a ring of strips, as in the laboratory: packages leaving the last strip enter the first."""

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.polyline import Polyline
from pointit.schemas import NS_PER_S, Environment, SelectionEvent, TrackedObject, TrackedObjects

TARGET = "red"
"""Kind of the packages that are targets."""
OTHER = "blue"
"""Kind of the others."""


class Carousel:
    """A constant set of packages that stand, or move together."""

    def __init__(
        self,
        environment: Environment,
        positions_m: Array,
        kinds: list[str],
        *,
        length_m: float,
        speed_mps: float,
        start_ns: int,
    ) -> None:
        """Place packages of `kinds` on the strips of `environment`, in their order.

        Args:
            environment: the map.
            positions_m: n, centres along all strips.
            kinds: n.
            length_m: length of each package.
            speed_mps: speed along the strips.
            start_ns: time of `positions_m`.
        """
        self._ids = [strip.id for strip in environment.strips]
        self._lines = [Polyline(strip.line_m) for strip in environment.strips]
        # where each strip starts along the ring, and where the last one ends
        lengths_m = [line.length_m for line in self._lines]
        self._starts_m: Array = np.cumsum([0.0, *lengths_m])
        self._positions_m = positions_m
        self._kinds = kinds
        self._length_m = length_m
        self._speed_mps = speed_mps
        self._start_ns = start_ns
        self._seq = 0

    def step(self, now_ns: int) -> list[SelectionEvent]:
        """Do nothing: positions depend on the time alone, and nothing leaves."""
        del now_ns
        return []

    def select(self, owners: dict[str, str]) -> None:
        """Do nothing: a ring has no bays."""
        del owners

    def tracked(self, now_ns: int) -> TrackedObjects:
        """Return the packages at `now_ns`."""
        self._seq += 1
        passed_s = (now_ns - self._start_ns) / NS_PER_S
        moved_m: Array = self._positions_m + self._speed_mps * passed_s
        around_m: Array = moved_m % self._starts_m[-1]
        strips = np.searchsorted(self._starts_m, around_m, side="right") - 1
        objects: list[TrackedObject] = []
        for index, strip in enumerate(strips.tolist()):
            start_m = self._starts_m[strip]
            position_m = float(around_m[index] - start_m)
            objects.append(self._object(index, strip, position_m))
        return TrackedObjects(stamp_ns=now_ns, seq=self._seq, objects=tuple(objects))

    def _object(self, index: int, strip: int, position_m: float) -> TrackedObject:
        line = self._lines[strip]
        x, y, z = line.tangent_at(position_m)
        speed_mps = self._speed_mps
        velocity_mps = (speed_mps * x, speed_mps * y, speed_mps * z)
        return TrackedObject(
            id=f"package-{index + 1}",
            kind=self._kinds[index],
            position_m=line.point_at(position_m),
            velocity_mps=velocity_mps,
            length_m=self._length_m,
            surface="strip",
            surface_id=self._ids[strip],
            surface_position_m=position_m,
            surface_speed_mps=speed_mps,
        )
