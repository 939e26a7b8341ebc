"""Right of way at junctions: one way at a time, in order of arrival, and room behind it and in rings."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from pointit.services.conveyor_sim.network.junctions import SHARP
from pointit.services.conveyor_sim.network.network import Network
from pointit.services.conveyor_sim.network.piece import NONE, Piece
from pointit.services.conveyor_sim.network.routes import BeltRoutes
from pointit.services.conveyor_sim.traffic.package import Package

PAST_M = 1e-6

Way = tuple[int, ...]
"""Pieces in order."""


class EntryRequest(NamedTuple):
    """Request of a package to enter a junction."""

    turn: int
    """Step of the conveyor."""
    exit: int
    """Last piece of its way, which takes no later arrival before it; or `NONE`."""
    is_ready: bool
    """True if there is room behind the junction."""


class RightOfWay:
    """Admits packages to junctions.

    A junction belongs to the way of the packages inside. Others enter behind them if all of these are on the
    same way, and it has no sharp turn.
    """

    def __init__(
        self,
        network: Network,
        routes: BeltRoutes,
        longest_m: float,
        *,
        held: Sequence[Sequence[Package]],
        speeds: Mapping[str, float],
    ) -> None:
        """Use the packages by piece in `held` and the belts' `speeds`, which other classes change."""
        self._pieces = network.pieces
        self._routes = routes
        self._rings = Rings(network, longest_m)
        self._held = held
        self._speeds = speeds
        self._members: list[list[int]] = [[] for _ in range(network.junctions)]
        """Pieces by junction."""
        for piece in network.pieces:
            if piece.junction != NONE:
                self._members[piece.junction].append(piece.index)
        self._waiting: list[dict[Package, EntryRequest]] = [{} for _ in range(network.junctions)]
        """By junction: the last requests of packages that wait, in order of arrival."""
        self.turn = 0
        """Number of steps of the conveyor."""

    def way(self, piece: int, bay: str) -> Way:
        """Return the pieces from `piece` through its junction on the way to `bay`; () if it is in none."""
        junction = self._pieces[piece].junction
        way: list[int] = []
        while NONE not in (junction, piece) and piece not in way and self._pieces[piece].junction == junction:
            way.append(piece)
            piece = self._routes.next_of(piece, bay)
        return tuple(way)

    def inside(self, junction: int) -> list[Package]:
        """Return the packages in `junction`."""
        return [package for piece in self._members[junction] for package in self._held[piece]]

    def admits(self, package: Package, way: Way) -> bool:
        """Ask for `package` to enter a junction ahead on `way`. Return True if it may enter now."""
        junction = self._pieces[way[0]].junction
        if self._ring_takes(package, way):
            request = EntryRequest(self.turn, way[-1], is_ready=self._has_room(package, way))
        else:  # packages on the ring go first
            request = EntryRequest(self.turn, NONE, is_ready=False)
        is_open = self._is_on(way, junction) if self._is_straight(way) else not self.inside(junction)
        return self._may_enter(package, junction, request, is_open=is_open)

    def admits_back(self, package: Package, junction: int, belt: Way) -> bool:
        """Ask for `package`, whose `belt` runs backwards, to enter `junction`. Return True if it may now."""
        request = EntryRequest(self.turn, NONE, is_ready=True)
        return self._may_enter(package, junction, request, is_open=self._is_on(belt, junction))

    def takes(self, piece: int) -> bool:
        """Return True if one more may be put on `piece`: its junction is empty, and its ring not filled."""
        junction, ring = self._pieces[piece].junction, self._rings.of[piece]
        is_free = junction == NONE or not self.inside(junction)
        return is_free and (ring == NONE or self._on_ring(ring) <= self._rings.capacity[ring])

    def _may_enter(self, package: Package, junction: int, request: EntryRequest, *, is_open: bool) -> bool:
        waiting = self._waiting[junction]
        for gone in [other for other, before in waiting.items() if before.turn < self.turn - 1]:
            del waiting[gone]  # it stopped asking
        waiting[package] = request
        if not (request.is_ready and is_open):
            return False
        for other, earlier in waiting.items():
            if other is package:
                break
            if earlier.is_ready or earlier.exit == request.exit != NONE:
                return False
        del waiting[package]
        return True

    def _is_on(self, way: Way, junction: int) -> bool:
        """Return True if all packages in `junction` stay on `way`."""
        return all(set(package.way) <= set(way) for package in self.inside(junction))

    def _is_straight(self, way: Way) -> bool:
        """Return True if `way` stays on one belt or has no sharp turn."""
        first, last = self._pieces[way[0]], self._pieces[way[-1]]
        if all(self._pieces[index].belt == first.belt and not self._pieces[index].target for index in way):
            return True
        return float(first.direction(first.from_m) @ last.direction(last.to_m)) >= SHARP

    def _ring_takes(self, package: Package, way: Way) -> bool:
        """Return True if `way` leads from outside to no ring or to one with room for one more."""
        ring = self._rings.of[way[-1]]
        if ring == NONE or self._rings.of[package.piece] == ring:
            return True
        inside = self.inside(self._pieces[way[0]].junction)
        coming = sum(self._rings.of[other.piece] != ring == self._rings.of[other.decided] for other in inside)
        return self._on_ring(ring) + coming <= self._rings.capacity[ring]

    def _on_ring(self, ring: int) -> int:
        return sum(len(self._held[piece]) for piece in self._rings.pieces[ring])

    def _has_room(self, package: Package, way: Way) -> bool:
        """Return True if `package` and all packages in its junction fit behind it, before the next one."""
        if not all(self._runs(piece) for piece in way):
            return False
        lengths_m = [other.length_m for other in self.inside(self._pieces[way[0]].junction)]
        room_m = 0.0
        passed = list(way)
        while True:
            here = self._routes.next_of(passed[-1], package.bay)
            if here == NONE or here in passed:
                return True
            piece, held = self._pieces[here], self._held[here]
            if piece.junction != NONE:
                break
            if not self._runs(here):  # packages stop where it starts
                for other in held[:1]:
                    apart_m = other.offset_m - piece.from_m
                    room_m -= max(0.0, (package.length_m + other.length_m) / 2.0 - apart_m)
                break
            lengths_m += [other.length_m for other in held]
            room_m += piece.length_m
            passed.append(here)
        ends_m = ((lengths_m[0] if lengths_m else package.length_m) + package.length_m) / 2.0
        return sum(lengths_m) + package.length_m - ends_m <= room_m + PAST_M  # the ends stick out by half

    def _runs(self, piece: int) -> bool:
        return self._speeds[self._pieces[piece].belt] > 0.0


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
