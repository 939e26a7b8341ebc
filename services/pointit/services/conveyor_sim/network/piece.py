"""Pieces of a network of belts."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3

Array = NDArray[np.float64]

NONE = -1
"""Instead of the index of a piece or junction: there is none."""


@dataclass(slots=True, eq=False)
class Piece:
    """A directed part of a section of a belt, or of the bridge of a link. It lies in one junction or in none.

    Positions on it are offsets from the start of its section.
    """

    index: int
    section: int
    """Number of the section or bridge."""
    belt: str
    """Belt whose speed it has; for a bridge the belt it comes from."""
    line: Polyline
    start_m: float
    """Arc length on `line` where the section starts."""
    from_m: float
    """Offset at which the piece starts."""
    to_m: float
    """Offset at which the piece ends."""
    target: str = ""
    """Belt that a bridge leads to, or `""` for a section."""
    halves: tuple[float | None, float | None] = (None, None)
    """For a bridge: arc length on its belt if it starts at the belt's end, and on its target's start, else
    None."""
    bay: str = ""
    """Bay at its end."""
    junction: int = NONE
    before: int = NONE
    """The previous piece of the same belt."""
    successors: list[int] = field(default_factory=list[int])
    """Pieces that begin at its end; straight on along the belt comes first."""
    predecessors: list[int] = field(default_factory=list[int])
    """Pieces that end at its beginning."""

    @property
    def length_m(self) -> float:
        """Return its length."""
        return self.to_m - self.from_m

    def point(self, offset_m: float) -> Vec3:
        """Return the position in {W} at `offset_m` from the start of this piece of a belt."""
        return self.line.point_at(self.start_m + offset_m)

    def direction(self, offset_m: float) -> Array:
        """Return the unit direction of travel there."""
        inside_m = min(max(offset_m, self.from_m + 1e-6), self.to_m - 1e-6)
        return np.asarray(self.line.tangent_at(self.start_m + inside_m))

    def place(self, offset_m: float) -> tuple[str, float]:
        """Return the belt to which an object there belongs, and its arc length, maybe beyond an end."""
        if not self.target:
            return self.belt, self.start_m + offset_m
        from_m, to_m = self.halves
        bridge_m = self.line.length_m
        if from_m is not None and (to_m is None or offset_m < bridge_m / 2.0):
            return self.belt, from_m + offset_m
        if to_m is not None:
            return self.target, to_m - (bridge_m - offset_m)
        return "", 0.0
