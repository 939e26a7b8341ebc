"""A package on the conveyor."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

from pointit.services.conveyor_sim.network.network import Network
from pointit.services.conveyor_sim.network.piece import NONE

PAST_M = 1e-6


@dataclass(slots=True, eq=False)
class Package:
    """Identity, position and destination of a package."""

    id: str
    kind: str
    length_m: float
    piece: int = 0
    offset_m: float = 0.0
    """Position of its centre from the start of the piece's section."""
    speed_mps: float = 0.0
    """Speed along the piece; 0 while held."""
    bay: str = ""
    """Its bay, or `""` for straight on."""
    user: str = ""
    """User who has it selected."""
    refused: str = ""
    """Bay for which its selection came too late; reported once."""
    way: tuple[int, ...] = ()
    """In a junction: its piece and those after it up to the end, which later selections do not change."""
    turn: int = 0
    """The last step of the conveyor in which it moved."""

    @property
    def decided(self) -> int:
        """Return the last piece of the way to which it is committed."""
        return self.way[-1] if self.way else self.piece

    def to_state(self, network: Network) -> list[Any]:
        """Return the state as JSON values; places are sections."""
        piece = network.pieces[self.piece]
        sections = dict.fromkeys(network.pieces[index].section for index in self.way[1:])
        return [
            *(self.id, self.kind, self.length_m, piece.section, self.offset_m, self.speed_mps),
            *(self.bay, self.user, self.refused),
            *(piece.junction, list(sections)),
        ]

    @classmethod
    def from_state(cls, state: Sequence[Any], network: Network) -> Self:
        """Return the package with the state `state`, maybe of an older version that stored more.

        Raises:
            ValueError: If it lies outside a junction that now includes its position, or the other way round.
        """
        name, kind, length_m, stored, offset_m, speed_mps, bay, user, refused, junction, sections = state[:11]
        section = int(stored)
        for piece in network.parts[section]:
            is_as_stored = (piece.junction != NONE) == (junction != NONE)
            if is_as_stored and piece.from_m - PAST_M <= offset_m <= piece.to_m + PAST_M:
                break
        else:
            raise ValueError(f"the junctions have changed at {offset_m} m of section {section}")
        offset_m = min(max(offset_m, piece.from_m), piece.to_m)
        package = cls(name, kind, length_m, piece.index, offset_m, speed_mps, bay, user, refused)
        if piece.junction != NONE:
            package.way = (piece.index,)
            while following := [
                index
                for index in network.pieces[package.way[-1]].successors
                if network.pieces[index].junction == piece.junction
                and network.pieces[index].section in {section, *sections}
                and index not in package.way
            ]:
                package.way += (following[0],)
        return package
