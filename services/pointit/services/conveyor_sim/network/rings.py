"""Belts that lead back to themselves: how many packages they take without coming to a standstill."""

from collections.abc import Iterator

from pointit.services.conveyor_sim.network.network import Network
from pointit.services.conveyor_sim.network.zones import Zones

NO_RING = -1


class Rings:
    """The rings of a network: pieces of which each can be reached from each other.

    A ring that is full stands still for ever: everybody waits for the next one to go on. So it takes one
    package less from outside than have room between its zones.
    """

    def __init__(self, network: Network, zones: Zones, longest_m: float) -> None:
        self.of = [NO_RING] * len(network.pieces)
        """By piece."""
        self.pieces: list[tuple[int, ...]] = []
        """By ring."""
        self.most: list[int] = []
        """By ring: so many packages may be on it when another one comes from outside."""
        for members in _connected(network):
            if len(members) == 1 and members[0] not in network.pieces[members[0]].successors:
                continue
            for index in members:
                self.of[index] = len(self.pieces)
            self.pieces.append(members)
            room = sum(_room(network.pieces[index].length_m, zones, index, longest_m) for index in members)
            self.most.append(max(0, room - 2))


def _connected(network: Network) -> Iterator[tuple[int, ...]]:
    """Yield the pieces of which each can be reached from each other (Kosaraju's way: Sharir 1981).

    SciPy finds them too, but to load its graphs is a quarter of what a run takes to start.
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


def _room(length_m: float, zones: Zones, piece: int, longest_m: float) -> int:
    """Return how many packages have room on `piece` outside zones, whatever is on those beside it."""
    room, free_from_m, is_bounded = 0, 0.0, False
    for gate in zones.gates[piece]:
        if gate.start_m > free_from_m:
            room += int((gate.start_m - free_from_m) / longest_m) + is_bounded
        free_from_m, is_bounded = gate.end_m, True
    return room + int(max(0.0, length_m - free_from_m) / longest_m)
