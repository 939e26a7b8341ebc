"""Rings of belts, and their capacities without deadlock."""

from collections.abc import Iterator

from pointit.services.conveyor_sim.network.network import Network
from pointit.services.conveyor_sim.network.piece import NONE, Piece


class Rings:
    """Rings of a network: sets of pieces that can be reached from each other.

    A full ring is deadlocked: each package waits for the next one. So it admits from outside one package less
    than fit between its junctions.
    """

    def __init__(self, network: Network, longest_m: float) -> None:
        self.of = [NONE] * len(network.pieces)
        """Ring by piece."""
        self.pieces: list[tuple[int, ...]] = []
        """Pieces by ring."""
        self.capacity: list[int] = []
        """By ring: largest number of packages on it when another one enters from outside."""
        for members in _connected(network):
            if len(members) == 1 and members[0] not in network.pieces[members[0]].successors:
                continue
            for index in members:
                self.of[index] = len(self.pieces)
            self.pieces.append(members)
            room = sum(_room(network, network.pieces[index], longest_m) for index in members)
            self.capacity.append(max(0, room - 2))


def _connected(network: Network) -> Iterator[tuple[int, ...]]:
    """Yield the strongly connected components (Kosaraju's algorithm: Sharir 1981).

    SciPy finds them, too, but loading its graphs takes a quarter of the start time of a run.
    """
    seen: set[int] = set()
    for root in reversed(network.front_first):
        members: list[int] = []
        waiting = [root]
        while waiting:
            index = waiting.pop()
            if index not in seen:
                seen.add(index)
                members.append(index)
                waiting += network.pieces[index].predecessors
        if members:
            yield tuple(sorted(members))


def _room(network: Network, piece: Piece, longest_m: float) -> int:
    """Return the number of packages that fit on `piece` if it is outside junctions, the last one in front."""
    if piece.junction != NONE:
        return 0
    follows_junction = any(network.pieces[index].junction != NONE for index in piece.predecessors)
    return int(piece.length_m / longest_m) + follows_junction
