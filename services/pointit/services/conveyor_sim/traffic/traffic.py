"""Packages on a network of belts: they move with their belts, in order, and never overlap."""

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator

from pointit.services.conveyor_sim.network.network import Network
from pointit.services.conveyor_sim.network.piece import NONE, Piece
from pointit.services.conveyor_sim.network.routes import BeltRoutes
from pointit.services.conveyor_sim.traffic.last_way import LastWay
from pointit.services.conveyor_sim.traffic.package import Package
from pointit.services.conveyor_sim.traffic.right_of_way import RightOfWay

TOLERANCE_M = 1e-9
"""Overlap of touching packages by rounding."""
RETRY_M = 0.01
"""Distance of belt motion after which a package that waits for a junction tries again."""
STEP_S = 0.05
"""Longest time step with linked belts."""


class Traffic:
    """All packages by piece, and the speeds of the belts.

    Packages move one after the other, those ahead first, each at most up to the next one. So nothing overlaps
    at any speed, and a held package holds those behind it.
    """

    def __init__(self, network: Network, routes: BeltRoutes, *, longest_m: float) -> None:
        """Create empty belts at rest; `longest_m` is that for which `network` has its junctions."""
        self.network = network
        self.longest_m = longest_m
        self.held: list[list[Package]] = [[] for _ in network.pieces]
        """By piece, in the order of their offsets."""
        self.speeds = dict.fromkeys(network.lines, 0.0)
        self._right_of_way = RightOfWay(network, routes, longest_m, held=self.held, speeds=self.speeds)
        self.last_way = LastWay(network, routes, self._right_of_way, self.speeds)
        self._routes = routes
        self._longest_m = longest_m
        """Length of the longest package so far."""
        self._order = list(network.front_first)

    @property
    def packages(self) -> Iterator[Package]:
        """Yield every package, belt by belt."""
        return (package for blocked_packages in self.held for package in blocked_packages)

    @property
    def size(self) -> int:
        """Return the number of packages."""
        return sum(len(blocked_packages) for blocked_packages in self.held)

    @property
    def step_s(self) -> float:
        """Return the longest time step, s."""
        if not self.network.links:
            return math.inf
        fastest_mps = max(abs(speed_mps) for speed_mps in self.speeds.values())
        return min(STEP_S, self.longest_m / 2.0 / max(fastest_mps, 1e-9))

    def set_speed(self, belt: str, speed_mps: float) -> None:
        """Set the speed of `belt`."""
        self.speeds[belt] = speed_mps
        back = {
            piece.index
            for name, pieces in self.network.sections.items()
            if self.speeds[name] < 0.0
            for piece in pieces
        }
        self._order = [index for index in self.network.front_first if index not in back] + sorted(back)

    def clear(self) -> None:
        """Remove all packages."""
        for blocked_packages in self.held:
            blocked_packages.clear()

    def put(self, package: Package, piece: Piece, offset_m: float) -> None:
        """Put `package` at `offset_m` of `piece`, after `is_clear` returned True."""
        package.piece, package.offset_m = piece.index, offset_m
        package.way = self._right_of_way.way(piece.index, package.bay)
        self._insert(package)
        package.speed_mps = self._speed(piece)

    def restore(self, packages: Iterable[Package]) -> None:
        """Put `packages`, in the order of the property `packages`, at their own positions."""
        for package in packages:
            self._insert(package)

    def wait_m(self, piece: Piece, offset_m: float, length_m: float) -> float:
        """Return the distance that the belt must move until a package of `length_m` fits there; 0: now."""
        new = Package("", "", length_m, piece.index, offset_m)
        missing_m = -min(self._room(new, is_ahead=is_ahead)[0] for is_ahead in (False, True))
        if not self._right_of_way.takes(piece.index):
            missing_m = max(missing_m, RETRY_M)
        return missing_m if missing_m > TOLERANCE_M else 0.0

    def is_clear(self, piece: Piece, offset_m: float, length_m: float) -> bool:
        """Return True if a package of `length_m` may be put there: nothing near, no junction in use."""
        return self.wait_m(piece, offset_m, length_m) == 0.0

    def move(self, elapsed_s: float) -> list[Package]:
        """Advance by `elapsed_s`, at most `step_s`. Return the packages that left at an end, in order."""
        turn = self._right_of_way.turn = self._right_of_way.turn + 1
        passed_packages: list[Package] = []
        for index in self._order:
            if not self.held[index]:
                continue
            is_ahead = self._speed(self.network.pieces[index]) > 0.0
            for package in self.held[index][:: -1 if is_ahead else 1]:
                if package.turn != turn:  # it may have come in this step from a piece that moved earlier
                    package.turn = turn
                    self._advance(package, elapsed_s, passed_packages)
        return passed_packages

    def _speed(self, piece: Piece) -> float:
        speed_mps = self.speeds[piece.belt]
        return max(0.0, speed_mps) if piece.target else speed_mps  # bridges do not run backwards

    def _insert(self, package: Package) -> None:
        blocked_packages = self.held[package.piece]
        blocked_packages.insert(bisect_left(blocked_packages, package.offset_m, key=_offset_m), package)
        self._longest_m = max(self._longest_m, package.length_m)

    def _advance(self, package: Package, elapsed_s: float, passed_packages: list[Package]) -> None:
        """Move `package`, the first of those of its piece that have not moved yet."""
        while True:
            piece = self.network.pieces[package.piece]
            speed_mps = self._speed(piece)
            if speed_mps == 0.0:
                package.speed_mps = 0.0
                return
            is_ahead = speed_mps > 0.0
            wanted_m = abs(speed_mps) * elapsed_s
            room_m, next_mps = self._room(package, is_ahead=is_ahead, further_m=wanted_m)
            step_m = min(wanted_m, max(room_m, 0.0))
            end_m = piece.to_m if is_ahead else piece.from_m
            left_m = abs(end_m - package.offset_m)
            following = self._following(package, is_ahead=is_ahead)
            is_leaving = following != NONE and self.network.pieces[following].junction == NONE
            if step_m <= left_m - (TOLERANCE_M if is_leaving else 0.0):
                package.offset_m += math.copysign(step_m, speed_mps)
                package.speed_mps = speed_mps
                if room_m <= wanted_m + TOLERANCE_M:  # it goes on as fast as the next one
                    slowest, fastest = sorted((0.0, speed_mps))
                    package.speed_mps = min(max(next_mps, slowest), fastest)
                return
            is_end = following == NONE and (is_ahead or piece.belt not in self.network.linked)
            if not is_end and not self._goes_on(package, following, is_ahead=is_ahead):
                package.offset_m, package.speed_mps = end_m, 0.0
                return
            self.held[piece.index].remove(package)
            if is_end:
                passed_packages.append(package)
                return
            elapsed_s = max(0.0, elapsed_s - left_m / abs(speed_mps))
            entered = self.network.pieces[following]
            package.piece, package.offset_m = following, entered.from_m if is_ahead else entered.to_m
            self.held[following].insert(0 if is_ahead else len(self.held[following]), package)

    def _following(self, package: Package, *, is_ahead: bool) -> int:
        """Return the next piece of `package`, or `NONE` at its last one."""
        if not is_ahead:
            return self.network.pieces[package.piece].before
        return package.way[1] if len(package.way) > 1 else self._routes.next_of(package.piece, package.bay)

    def _goes_on(self, package: Package, following: int, *, is_ahead: bool) -> bool:
        """Return True if `package` may go on to `following`, and update its way through a junction."""
        if following == NONE:
            return False
        piece, junction = self.network.pieces[package.piece], self.network.pieces[following].junction
        is_entering = junction not in {NONE, piece.junction}
        if is_ahead:
            way = package.way[1:] or self._right_of_way.way(following, package.bay)
            is_admitted = not is_entering or self._right_of_way.admits(package, way)
        else:
            way = () if junction == NONE else (following, *package.way)
            belt = tuple(section.index for section in self.network.sections[piece.belt])
            is_admitted = not is_entering or self._right_of_way.admits_back(package, junction, belt)
        if is_admitted:
            package.way = way
        return is_admitted

    def _room(self, package: Package, *, is_ahead: bool, further_m: float = 0.0) -> tuple[float, float]:
        """Return the room to the nearest package ahead (or behind), whichever way it went, and its speed.

        `package` may not be put on its piece yet. `further_m` is looked beyond the longest one's reach.
        """
        pieces, blocked_packages = self.network.pieces, self.held[package.piece]
        is_there = package in blocked_packages
        here = (
            blocked_packages.index(package)
            if is_there
            else bisect_left(blocked_packages, package.offset_m, key=_offset_m)
        )
        for other in (
            blocked_packages[here + is_there :][:1] if is_ahead else blocked_packages[max(here - 1, 0) : here]
        ):
            apart_m = abs(other.offset_m - package.offset_m)
            return apart_m - (package.length_m + other.length_m) / 2.0, other.speed_mps
        piece = pieces[package.piece]
        waiting = [(piece.to_m - package.offset_m if is_ahead else package.offset_m - piece.from_m, piece)]
        nearest = (math.inf, 0.0)
        seen = {package.piece}
        while waiting:
            far_m, piece = waiting.pop()
            if far_m > self._longest_m + further_m:
                continue
            for index in piece.successors if is_ahead else piece.predecessors:
                beyond, there = pieces[index], self.held[index]
                if there:
                    other = there[0 if is_ahead else -1]
                    apart_m = far_m + (
                        other.offset_m - beyond.from_m if is_ahead else beyond.to_m - other.offset_m
                    )
                    if other is not package:  # in a ring it follows itself
                        room_m = apart_m - (package.length_m + other.length_m) / 2.0
                        nearest = min(nearest, (room_m, other.speed_mps))
                elif index not in seen:
                    seen.add(index)
                    waiting.append((far_m + beyond.length_m, beyond))
        return nearest


def _offset_m(package: Package) -> float:
    return package.offset_m
