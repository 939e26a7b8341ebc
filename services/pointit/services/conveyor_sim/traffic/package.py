"""A package on the conveyor."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

NO_ZONE = -1


@dataclass(slots=True, eq=False)
class Package:
    """What it is, where it is and where it is going to."""

    id: str
    kind: str
    length_m: float
    piece: int = 0
    offset_m: float = 0.0
    """Of its centre, from the start of the piece."""
    speed_mps: float = 0.0
    """Along the piece; 0 while held."""
    bay: str = ""
    """Where it goes; empty: straight on."""
    user: str = ""
    """Who has it selected."""
    refused: str = ""
    """The bay for which it came too late; it is told once."""
    zone: int = NO_ZONE
    """The one that it may pass now."""
    way: tuple[int, ...] = ()
    """The pieces after its own until it is out of the zone; it goes that way whatever is wished meanwhile."""
    lane: tuple[str | int, ...] = ()
    """Which way through the zone that is."""
    is_exclusive: bool = False
    """Whether nothing else may be in the zone; else others of the same lane may follow."""
    turn: int = 0
    """The last step of the conveyor in which it moved."""

    def leave_zone(self) -> None:
        """Be out of the zone."""
        self.zone, self.way, self.lane, self.is_exclusive = NO_ZONE, (), (), False

    def to_state(self) -> list[Any]:
        """Return all of it as what JSON can hold."""
        return [
            *(self.id, self.kind, self.length_m, self.piece, self.offset_m, self.speed_mps),
            *(self.bay, self.user, self.refused),
            *(self.zone, list(self.way), list(self.lane), self.is_exclusive),
        ]

    @classmethod
    def from_state(cls, kept: Sequence[Any]) -> Self:
        """Return the package that `kept` was made of."""
        *others, zone, way, lane, is_exclusive = kept
        package = cls(*others)
        package.zone, package.way, package.lane = zone, tuple(way), tuple(lane)
        package.is_exclusive = is_exclusive
        return package
