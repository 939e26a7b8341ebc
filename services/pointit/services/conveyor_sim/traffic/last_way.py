"""Time until a package passes the last place where its ways to another bay and to its own part."""

import math
from collections.abc import Mapping

from pointit.services.conveyor_sim.network.network import Network
from pointit.services.conveyor_sim.network.routes import END, Routes
from pointit.services.conveyor_sim.network.zones import Zones
from pointit.services.conveyor_sim.traffic.package import NO_ZONE, Package
from pointit.services.conveyor_sim.traffic.zone_interlock import ZoneInterlock

Legs = tuple[tuple[int, float], ...]
"""Pieces in order, each with the offset up to which it is passed, m."""


class LastWay:
    """Looks ahead along a package's way to its bay, piece by piece.

    A way is decided at the end of a piece, or at the beginning of the zone at its end: a package that has
    entered a zone goes through it to the bay it had then.
    """

    def __init__(
        self,
        network: Network,
        routes: Routes,
        zones: Zones,
        guard: ZoneInterlock,
        speeds: Mapping[str, float],
    ) -> None:
        """Use the belts' `speeds`, which other classes change."""
        self._pieces = network.pieces
        self._routes = routes
        self._gates = zones.gates
        self._guard = guard
        self._speeds = speeds
        self._known: dict[tuple[int, str, str, int], Legs] = {}

    def time_left_s(self, package: Package, wanted: str) -> float:
        """Return the shortest time in which `package` can pass its last way to bay `wanted`, s.

        Infinite while belts on the way there stand still or run backwards. Packages that wait for others take
        longer. 0: it may pass it now, or has passed it.
        """
        here = package.way[-1] if package.way else package.piece
        legs = self._legs(here, package.bay, wanted, package.zone)
        if package.way and legs:
            decided = (package.piece, *package.way[:-1])
            legs = (*((index, self._pieces[index].length_m) for index in decided), *legs)
        left_s, from_m = 0.0, package.offset_m
        for index, to_m in legs:
            speed_mps = self._speeds[self._pieces[index].belt]
            if speed_mps <= 0.0:
                return math.inf
            left_s += max(0.0, to_m - from_m) / speed_mps
            from_m = 0.0
        return left_s

    def _legs(self, piece: int, bay: str, wanted: str, zone: int) -> Legs:
        """Return the way from the start of `piece`, in `zone`, to the decision; () if already decided."""
        key = (piece, bay, wanted, zone)
        if key not in self._known:
            self._known[key] = tuple(self._undecided(piece, bay, wanted, zone))
        return self._known[key]

    def _undecided(self, piece: int, bay: str, wanted: str, zone: int) -> list[tuple[int, float]]:
        legs: list[tuple[int, float]] = []
        while self._routes.reaches(piece, wanted):
            decided_m, way, zone = self._next_decision(piece, bay, zone)
            legs.append((piece, decided_m))
            if not way or not self._routes.reaches(way[-1], wanted):
                break
            legs[-1] = (piece, self._pieces[piece].length_m)
            legs += [(index, self._pieces[index].length_m) for index in way[:-1]]
            piece = way[-1]
        return legs

    def _next_decision(self, piece: int, bay: str, zone: int) -> tuple[float, list[int], int]:
        """Return the offset on `piece` of the next decision, the pieces that follow, and their zone."""
        length_m = self._pieces[piece].length_m
        for gate in self._gates[piece]:
            if gate.end_m > length_m and gate.zone != zone:
                way, _ = self._guard.way(piece, gate, bay)
                if way:
                    return gate.start_m, way, gate.zone
        following = self._routes.next_of(piece, bay)
        if following == END:
            return length_m, [], NO_ZONE
        is_inside = any(gate.zone == zone and gate.start_m < 0.0 for gate in self._gates[following])
        return length_m, [following], zone if is_inside else NO_ZONE  # a ring may lead into it again
