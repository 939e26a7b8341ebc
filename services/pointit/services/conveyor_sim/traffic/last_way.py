"""Time until a package passes the last place where its ways to another bay and to its own part."""

import math
from collections.abc import Mapping

from pointit.services.conveyor_sim.network.network import Network
from pointit.services.conveyor_sim.network.piece import NONE
from pointit.services.conveyor_sim.network.routes import BeltRoutes
from pointit.services.conveyor_sim.traffic.package import Package
from pointit.services.conveyor_sim.traffic.right_of_way import RightOfWay, Way


class LastWay:
    """Looks ahead along a package's way to its bay.

    A way is decided where a junction begins: a package in a junction goes through it to the bay it had then.
    """

    def __init__(
        self, network: Network, routes: BeltRoutes, right_of_way: RightOfWay, speeds: Mapping[str, float]
    ) -> None:
        """Use the belts' `speeds`, which other classes change."""
        self._pieces = network.pieces
        self._routes = routes
        self._right_of_way = right_of_way
        self._speeds = speeds
        self._known: dict[tuple[int, str, str], Way] = {}

    def time_left_s(self, package: Package, wanted: str) -> float:
        """Return the shortest time in which `package` can pass its last way to bay `wanted`, s.

        Infinite while belts on the way there stand still or run backwards. Packages that wait for others take
        longer. 0: it may pass it now, or has passed it.
        """
        if not self._routes.reaches(package.decided, wanted):
            return 0.0
        key = (package.decided, package.bay, wanted)
        if key not in self._known:
            self._known[key] = self._undecided(*key)
        left_s, from_m = 0.0, package.offset_m
        for index in (*(package.way or (package.piece,)), *self._known[key]):
            piece = self._pieces[index]
            if index != package.piece:
                from_m = piece.from_m
            speed_mps = self._speeds[piece.belt]
            if speed_mps <= 0.0:
                return math.inf
            left_s += max(0.0, piece.to_m - from_m) / speed_mps
        return left_s

    def _undecided(self, piece: int, bay: str, wanted: str) -> Way:
        """Return the pieces after `piece` on the way to `bay` from which a way leads to `wanted`, too."""
        way: list[int] = []
        while (piece := self._routes.next_of(piece, bay)) != NONE:
            ahead = self._right_of_way.way(piece, bay) or (piece,)
            piece = ahead[-1]
            if not self._routes.reaches(piece, wanted):
                break
            way += ahead
        return tuple(way)
