"""A package on the conveyor."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

NO_ZONE = -1


@dataclass(slots=True, eq=False)
class Package:
    """Identity, position and destination of a package."""

    id: str
    kind: str
    length_m: float
    piece: int = 0
    offset_m: float = 0.0
    """Position of its centre from the start of the piece."""
    speed_mps: float = 0.0
    """Speed along the piece; 0 while held."""
    bay: str = ""
    """Its bay, or `""` for straight on."""
    user: str = ""
    """User who has it selected."""
    refused: str = ""
    """Bay for which its selection came too late; reported once."""
    zone: int = NO_ZONE
    """The zone that it may pass now."""
    way: tuple[int, ...] = ()
    """Pieces after its own up to the end of the zone; later selections do not change them."""
    lane: tuple[str | int, ...] = ()
    """Way through the zone."""
    is_exclusive: bool = False
    """True if nothing else may be in the zone; else others of the same lane may follow."""
    turn: int = 0
    """The last step of the conveyor in which it moved."""

    def leave_zone(self) -> None:
        """Leave the zone."""
        self.zone, self.way, self.lane, self.is_exclusive = NO_ZONE, (), (), False

    def to_state(self) -> list[Any]:
        """Return the state as JSON values."""
        return [
            *(self.id, self.kind, self.length_m, self.piece, self.offset_m, self.speed_mps),
            *(self.bay, self.user, self.refused),
            *(self.zone, list(self.way), list(self.lane), self.is_exclusive),
        ]

    @classmethod
    def from_state(cls, state: Sequence[Any]) -> Self:
        """Return the package with the state `state`."""
        *others, zone, way, lane, is_exclusive = state
        package = cls(*others)
        package.zone, package.way, package.lane = zone, tuple(way), tuple(lane)
        package.is_exclusive = is_exclusive
        return package
