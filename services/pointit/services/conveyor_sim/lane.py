"""One lane: objects that move together along a line, in order, never overlapping."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.schemas import FARTHEST, TrackedObject

Array = NDArray[np.float64]
Surface = Literal["strip", "belt"]

TOLERANCE_M = 1e-9
"""Objects that touch may overlap by this, the rounding of sums."""


@dataclass(frozen=True, slots=True)
class Item:
    """An object on a lane, without its place."""

    id: str
    kind: str
    length_m: float


class Lane:
    """Objects by the arc length of their centre, from 0 to the line's length."""

    def __init__(self, surface: Surface, lane_id: str, line: Polyline) -> None:
        self.surface: Surface = surface
        self.id = lane_id
        self.line = line
        self.items: list[Item] = []
        """Ordered as `positions_m`."""
        self.positions_m: Array = np.empty(0)
        """Increasing."""

    def clear(self) -> None:
        """Take everything off."""
        self.items.clear()
        self.positions_m = np.empty(0)

    def move(self, distance_m: float) -> list[Item]:
        """Move everything along the line; return what passed an end, the first to pass first."""
        if not self.items:
            return []
        positions_m = self.positions_m + distance_m
        if distance_m >= 0.0:
            stay = int(np.searchsorted(positions_m, self.line.length_m, side="right"))
            passed = self.items[stay:][::-1]
            self.items = self.items[:stay]
            self.positions_m = positions_m[:stay]
        else:
            stay = int(np.searchsorted(positions_m, 0.0, side="left"))
            passed = self.items[:stay]
            self.items = self.items[stay:]
            self.positions_m = positions_m[stay:]
        return passed

    def wait_m(self, length_m: float, *, at_end: bool = False) -> float:
        """Return how far the lane must move until `length_m` fits at its start (or end); 0: now."""
        if not self.items:
            return 0.0
        nearest = -1 if at_end else 0
        centre_m = float(self.positions_m[nearest])
        gap_m = self.line.length_m - centre_m if at_end else centre_m
        missing_m = (self.items[nearest].length_m + length_m) / 2.0 - gap_m
        return missing_m if missing_m > TOLERANCE_M else 0.0

    def enter(self, item: Item, *, at_end: bool = False) -> None:
        """Put `item` with its centre at the start (or end).

        Raises:
            ValueError: there is no room.
        """
        if self.wait_m(item.length_m, at_end=at_end) > 0.0:
            raise ValueError(f"no room for {item.id} on lane {self.id}")
        if at_end:
            self.items.append(item)
            self.positions_m = np.append(self.positions_m, self.line.length_m)
        else:
            self.items.insert(0, item)
            self.positions_m = np.insert(self.positions_m, 0, 0.0)

    def fill(self, items: list[Item]) -> None:
        """Replace everything by `items`, evenly spaced along the line, in order of their positions."""
        self.items = list(items)
        spacing_m = self.line.length_m / max(1, len(items))
        self.positions_m = np.arange(0.5, len(items), dtype=np.float64) * spacing_m

    def tracked(self, speed_mps: float) -> list[TrackedObject]:
        """Return the objects as a tracker sees them, all moving at `speed_mps` along the line."""
        if not self.items:
            return []
        line = self.line
        segments = np.searchsorted(line.starts_m, self.positions_m, side="right") - 1
        velocities = line.tangents[np.clip(segments, 0, len(line.tangents) - 1)] * speed_mps
        rows = zip(
            self.items,
            self.positions_m.tolist(),
            np.clip(line.points_at(self.positions_m), -FARTHEST, FARTHEST).tolist(),  # but for rounding
            velocities.tolist(),
            strict=True,
        )
        return [
            TrackedObject(
                id=item.id,
                kind=item.kind,
                position_m=(point[0], point[1], point[2]),
                velocity_mps=(velocity[0], velocity[1], velocity[2]),
                length_m=item.length_m,
                surface=self.surface,
                surface_id=self.id,
                surface_position_m=position_m,
                surface_speed_mps=speed_mps,
            )
            for item, position_m, point, velocity in rows
        ]
