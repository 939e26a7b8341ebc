"""Belts that lead back to themselves: how many packages they take without coming to a standstill."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from pointit.services.conveyor_sim.network import Network
from pointit.services.conveyor_sim.zones import Zones

NO_RING = -1


class Rings:
    """The rings of a network: pieces of which each can be reached from each other.

    A ring that is full stands still for ever: everybody waits for the next one to go on. So it takes one
    package less from outside than have room between its zones.
    """

    def __init__(self, network: Network, zones: Zones, longest_m: float) -> None:
        count = len(network.pieces)
        leads = [(piece.index, following) for piece in network.pieces for following in piece.nexts]
        graph = np.array(leads, dtype=np.intp).reshape(-1, 2)
        ones = np.ones(len(graph), dtype=np.int8)
        _, labels = connected_components(
            csr_array((ones, (graph[:, 0], graph[:, 1])), shape=(count, count)), connection="strong"
        )
        self.of = [NO_RING] * count
        """By piece."""
        self.pieces: list[tuple[int, ...]] = []
        """By ring."""
        self.most: list[int] = []
        """By ring: so many packages may be on it when another one comes from outside."""
        for label in np.unique(labels):
            members = tuple(int(index) for index in np.flatnonzero(labels == label))
            if len(members) == 1 and members[0] not in network.pieces[members[0]].nexts:
                continue
            for index in members:
                self.of[index] = len(self.pieces)
            self.pieces.append(members)
            room = sum(_room(network.pieces[index].length_m, zones, index, longest_m) for index in members)
            self.most.append(max(0, room - 2))


def _room(length_m: float, zones: Zones, piece: int, longest_m: float) -> int:
    """Return how many packages have room on `piece` outside zones, whatever is on those beside it."""
    room, free_from_m, is_bounded = 0, 0.0, False
    for gate in zones.gates[piece]:
        if gate.start_m > free_from_m:
            room += int((gate.start_m - free_from_m) / longest_m) + is_bounded
        free_from_m, is_bounded = gate.end_m, True
    return room + int(max(0.0, length_m - free_from_m) / longest_m)
