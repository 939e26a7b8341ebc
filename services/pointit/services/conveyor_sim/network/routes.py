"""Shortest ways from every piece of a network to every bay, by the next piece."""

import heapq
import math

from pointit.services.conveyor_sim.network.network import Network
from pointit.services.conveyor_sim.network.piece import NONE


class BeltRoutes:
    """Ways by bay, precomputed (Dijkstra). Without a bay: straight on, at ends by the first link."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self._next: dict[str, list[int]] = {}
        self._length_m: dict[str, list[float]] = {}
        straight = [piece.successors[0] if piece.successors else NONE for piece in network.pieces]
        self._next[""] = straight
        for bay in network.bays:
            self._next[bay], self._length_m[bay] = self._towards(bay)

    def next_of(self, piece: int, bay: str) -> int:
        """Return the piece after `piece` on the way to `bay` (`""`: straight on), `NONE` at the way's end."""
        return self._next[bay][piece]

    def reaches(self, piece: int, bay: str) -> bool:
        """Return True if a way leads from `piece` to `bay`."""
        lengths_m = self._length_m.get(bay)
        return lengths_m is not None and lengths_m[piece] < math.inf

    def has(self, bay: str) -> bool:
        """Return True if the network has a bay of that name."""
        return bay in self._length_m

    def best(self, piece: int, wanted: str) -> str:
        """Return `wanted` if it can be reached from `piece`, else the nearest bay, or `""`."""
        if self.reaches(piece, wanted):
            return wanted
        there = [bay for bay in self._length_m if self.reaches(piece, bay)]
        return min(there, key=lambda bay: self._length_m[bay][piece], default="")

    def _towards(self, bay: str) -> tuple[list[int], list[float]]:
        pieces = self._network.pieces
        lengths_m = [math.inf] * len(pieces)
        following = [NONE] * len(pieces)
        last = self._network.sections[self._network.bays[bay]][-1].index
        lengths_m[last] = pieces[last].length_m
        heap = [(lengths_m[last], last)]
        while heap:
            so_far_m, index = heapq.heappop(heap)
            if so_far_m > lengths_m[index]:
                continue
            for before in pieces[index].predecessors:
                length_m = so_far_m + pieces[before].length_m
                if length_m < lengths_m[before]:
                    lengths_m[before], following[before] = length_m, index
                    heapq.heappush(heap, (length_m, before))
        return following, lengths_m
