"""Room between packages: around a place, and ahead on the way of a moving one."""

import math
from collections.abc import Iterator, Sequence

from pointit.services.conveyor_sim.network.network import Network, NetworkEdge
from pointit.services.conveyor_sim.network.routes import END, Routes
from pointit.services.conveyor_sim.traffic.package import Package


class Gaps:
    """Measures distances to the nearest packages, across junctions."""

    def __init__(
        self, network: Network, routes: Routes, held: Sequence[Sequence[Package]], longest_m: float
    ) -> None:
        """Use the packages by piece in `held`, in the order of their offsets, which other classes change."""
        self._pieces = network.pieces
        self._routes = routes
        self._held = held
        self._most_m = longest_m
        """Length of the longest package so far."""

    def register_length(self, length_m: float) -> None:
        """Update the longest length by that of a new package."""
        self._most_m = max(self._most_m, length_m)

    def ahead_m(self, piece: NetworkEdge, offset_m: float, length_m: float) -> float:
        """Return the room between a package there and the nearest ahead, whichever way it goes."""
        nearest_m = math.inf
        for start_m, index in self._reach(piece, -offset_m, 0.0, ahead=True):
            for other in self._held[index]:
                apart_m = start_m + other.offset_m
                if index == piece.index and start_m == -offset_m and apart_m < 0.0:
                    continue
                nearest_m = min(nearest_m, apart_m - (length_m + other.length_m) / 2.0)
                break
        return nearest_m

    def behind_m(
        self,
        piece: NetworkEdge,
        offset_m: float,
        length_m: float,
        package: Package | None = None,
        further_m: float = 0.0,
    ) -> float:
        """Return the room between a package there and the nearest behind, whichever way it came.

        Args:
            piece: its piece.
            offset_m: of its centre.
            length_m: its own.
            package: the package itself, if it is there already.
            further_m: distance that it is to go back.
        """
        nearest_m = math.inf
        for start_m, index in self._reach(piece, offset_m, further_m, ahead=False):
            ending_m = self._pieces[index].length_m
            for other in reversed(self._held[index]):
                is_here = index == piece.index and start_m == offset_m
                apart_m = offset_m - other.offset_m if is_here else start_m + ending_m - other.offset_m
                if other is package or (is_here and apart_m < 0.0):
                    continue
                nearest_m = min(nearest_m, apart_m - (length_m + other.length_m) / 2.0)
                break
        return nearest_m

    def limit(self, package: Package, piece: NetworkEdge, wanted_m: float) -> tuple[float, float]:
        """Return the offset to which the next package on its way limits `package`, and the next one's speed.

        Args:
            package: on `piece`.
            piece: the offsets count from its start.
            wanted_m: offset to which it is to go, maybe beyond the end.
        """
        if piece.twins:
            limit = self._twin_limit(package, piece, package.offset_m, 0.0)
            if limit is not None:
                return limit
        else:
            held = self._held[piece.index]
            following = held.index(package) + 1
            if following < len(held):
                ahead = held[following]
                return ahead.offset_m - (package.length_m + ahead.length_m) / 2.0, ahead.speed_mps
        start_m = piece.length_m
        reach_m = wanted_m + (package.length_m + self._most_m) / 2.0
        for index in self._route(package):
            if start_m > reach_m:
                break
            if self._pieces[index].twins:
                limit = self._twin_limit(package, self._pieces[index], -1.0, start_m)
                if limit is not None:
                    return limit
            for ahead in self._held[index]:
                if ahead is package:  # in a ring it follows itself
                    break
                apart_m = (package.length_m + ahead.length_m) / 2.0
                return start_m + ahead.offset_m - apart_m, ahead.speed_mps
            start_m += self._pieces[index].length_m
        return math.inf, 0.0

    def _twin_limit(
        self, package: Package, piece: NetworkEdge, beyond_m: float, start_m: float
    ) -> tuple[float, float] | None:
        """Return the limit by the nearest one beyond `beyond_m` of `piece`, `start_m` ahead, or its twins."""
        nearest: Package | None = None
        for index in (piece.index, *piece.twins):
            for other in self._held[index]:
                if other is not package and other.offset_m > beyond_m:
                    if nearest is None or other.offset_m < nearest.offset_m:
                        nearest = other
                    break
        if nearest is None:
            return None
        apart_m = (package.length_m + nearest.length_m) / 2.0
        return start_m + nearest.offset_m - apart_m, nearest.speed_mps

    def _reach(
        self, piece: NetworkEdge, start_m: float, further_m: float, *, ahead: bool
    ) -> list[tuple[float, int]]:
        """Return the pieces that begin (or end) within reach of a place on `piece`, with their distances.

        The first is `piece` itself with `start_m`.
        """
        reach_m = self._most_m + further_m
        found = [(start_m, piece.index)]
        waiting = [(start_m + piece.length_m if ahead else start_m, piece.index)]
        seen = {piece.index}
        while waiting:
            far_m, index = waiting.pop()
            if far_m > reach_m:
                continue
            for other in self._pieces[index].successors if ahead else self._pieces[index].predecessors:
                if other not in seen:
                    seen.add(other)
                    found.append((far_m, other))
                    waiting.append((far_m + self._pieces[other].length_m, other))
        return found

    def _route(self, package: Package) -> Iterator[int]:
        """Yield the pieces that it will pass after its own; endless in a ring."""
        here = package.piece
        for here in package.way:
            yield here
        while (here := self._routes.next_of(here, package.bay)) != END:
            yield here
