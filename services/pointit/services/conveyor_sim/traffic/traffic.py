"""Packages on a network of belts: they move with their belts, in order, and never overlap."""

import math
from collections.abc import Iterable, Iterator

from pointit.services.conveyor_sim.network.network import Network, NetworkEdge
from pointit.services.conveyor_sim.network.rings import Rings
from pointit.services.conveyor_sim.network.routes import END, Routes
from pointit.services.conveyor_sim.network.zones import Zones
from pointit.services.conveyor_sim.traffic.gaps import Gaps
from pointit.services.conveyor_sim.traffic.last_way import LastWay
from pointit.services.conveyor_sim.traffic.package import NO_ZONE, Package
from pointit.services.conveyor_sim.traffic.zone_interlock import ZoneInterlock

TOLERANCE_M = 1e-9
"""Packages that touch may overlap by this, the rounding of sums."""
RETRY_M = 0.01
"""Who waits for a junction to be free looks again after the belt has moved this far."""
STEP_S = 0.05
"""Where belts are linked, time goes on in steps of at most this."""


class Traffic:
    """All packages by piece, and the speeds of the belts.

    One package after the other moves on, those ahead first, each at most as far as the others let it; so
    nothing overlaps whatever the speeds do. Whoever is held holds those behind it.
    """

    def __init__(self, network: Network, routes: Routes, *, longest_m: float) -> None:
        """Have nothing on the belts, which stand still; junctions are laid out for `longest_m`."""
        self.network = network
        self.routes = routes
        self.longest_m = longest_m
        self.held: list[list[Package]] = [[] for _ in network.pieces]
        """By piece, in the order of their offsets."""
        self.zones = Zones(network, longest_m)
        self.speeds = dict.fromkeys(network.lines, 0.0)
        rings = Rings(network, self.zones, longest_m)
        self.guard = ZoneInterlock(network, routes, self.zones, rings, held=self.held, speeds=self.speeds)
        self.last_way = LastWay(network, routes, self.zones, self.guard, self.speeds)
        self._gaps = Gaps(network, routes, self.held, longest_m)
        self._order = list(network.front_first)

    @property
    def packages(self) -> Iterator[Package]:
        """Yield every package, belt by belt."""
        return (package for held in self.held for package in held)

    @property
    def size(self) -> int:
        """Return how many packages there are."""
        return sum(len(held) for held in self.held)

    @property
    def step_s(self) -> float:
        """Return how much time may pass at once."""
        if not self.network.links:
            return math.inf
        fastest_mps = max(abs(speed_mps) for speed_mps in self.speeds.values())
        return min(STEP_S, self.longest_m / 2.0 / max(fastest_mps, 1e-9))

    def set_speed(self, belt: str, speed_mps: float) -> None:
        """Have `belt` run at `speed_mps`; what is on it is held by others as before."""
        self.speeds[belt] = speed_mps
        sections = {piece.index for name in self.speeds for piece in self.network.sections[name]
                    if self.speeds[name] < 0.0}  # fmt: skip
        ahead = [index for index in self.network.front_first if index not in sections]
        self._order = ahead + sorted(sections)

    def clear(self) -> None:
        """Take everything off."""
        for held in self.held:
            held.clear()
        self.guard.clear()

    def put(self, package: Package, piece: NetworkEdge, offset_m: float) -> None:
        """Put `package` at `offset_m` of `piece`, where `is_clear` has said that there is room."""
        package.piece, package.offset_m = piece.index, offset_m
        held = self.held[piece.index]
        behind = sum(1 for other in held if other.offset_m < offset_m)
        held.insert(behind, package)
        self._gaps.register_length(package.length_m)
        gate = self.zones.at(piece.index, offset_m)
        if gate is not None and package.zone == NO_ZONE:
            self.guard.occupy(package, gate)
        package.speed_mps = max(0.0, self.speeds[piece.belt]) if piece.is_bridge else self.speeds[piece.belt]

    def restore(self, packages: Iterable[Package]) -> None:
        """Have `packages`, in the order in which `packages` yielded them, be where they say they are."""
        for package in packages:
            self.held[package.piece].append(package)
            self._gaps.register_length(package.length_m)
            if package.zone != NO_ZONE:
                self.guard.restore(package)

    def wait_m(
        self, piece: NetworkEdge, offset_m: float, length_m: float, *, is_reverse: bool = False
    ) -> float:
        """Return how far the belt must move until a package of `length_m` fits there; 0: now."""
        missing_m = -self._gaps.behind_m(piece, offset_m, length_m)
        if not is_reverse:
            missing_m = max(missing_m, -self._gaps.ahead_m(piece, offset_m, length_m))
            gate = self.zones.at(piece.index, offset_m)
            is_busy = gate is not None and not self.guard.is_free(gate.zone)
            if is_busy or not self.guard.takes(piece.index):
                missing_m = max(missing_m, RETRY_M)
        return missing_m if missing_m > TOLERANCE_M else 0.0

    def is_clear(self, piece: NetworkEdge, offset_m: float, length_m: float) -> bool:
        """Return True if a package of `length_m` may be put there: nothing near, no zone that is in use."""
        return self.wait_m(piece, offset_m, length_m) == 0.0

    def move(self, elapsed_s: float) -> list[Package]:
        """Let `elapsed_s` pass, at most `step_s`; return what left at an end, in its order."""
        self.guard.turn += 1
        passed: list[Package] = []
        for index in self._order:
            held = self.held[index]
            if not held:
                continue
            piece = self.network.pieces[index]
            speed_mps = self.speeds[piece.belt]
            if speed_mps < 0.0 and not piece.is_bridge:
                for package in list(held):
                    self._go_back(package, speed_mps * elapsed_s, passed)
            elif speed_mps <= 0.0:
                for package in held:
                    package.speed_mps = 0.0
            else:
                for package in reversed(held.copy()):
                    self._go_on(package, elapsed_s, passed)
        return passed

    def _go_on(self, package: Package, elapsed_s: float, passed: list[Package]) -> None:
        """Move `package`, the first of those of its piece that have not moved yet."""
        if package.turn == self.guard.turn:  # round a ring it comes to a piece whose turn is yet to come
            return
        package.turn = self.guard.turn
        pieces = self.network.pieces
        while True:
            piece = pieces[package.piece]
            speed_mps = self.speeds[piece.belt]
            if speed_mps <= 0.0:
                package.speed_mps = 0.0
                return
            wanted_m = package.offset_m + speed_mps * elapsed_s
            limit_m, next_mps = self._gaps.limit(package, piece, wanted_m)
            to_m = min(wanted_m, limit_m)
            to_m, is_stopped = self._gated(package, piece, to_m)
            if is_stopped:
                next_mps = 0.0
            following = self._following(package)
            to_m = max(to_m, package.offset_m)
            if to_m <= piece.length_m:
                is_free = to_m >= wanted_m and limit_m > wanted_m + TOLERANCE_M
                package.speed_mps = speed_mps if is_free else min(speed_mps, max(0.0, next_mps))
                package.offset_m = to_m
                self._leave_zone(package)
                return
            self.held[package.piece].remove(package)
            if following == END:
                passed.append(package)
                self.guard.release(package)
                return
            elapsed_s -= (piece.length_m - package.offset_m) / speed_mps
            package.piece, package.offset_m = following, 0.0
            self.held[following].insert(0, package)
            if package.zone != NO_ZONE:
                if package.way:
                    package.way = package.way[1:]
                else:
                    self.guard.release(package)

    def _gated(self, package: Package, piece: NetworkEdge, to_m: float) -> tuple[float, bool]:
        """Return how far zones let `package` go towards `to_m`, and whether one stops it."""
        for gate in self.zones.gates[piece.index]:
            if package.offset_m - TOLERANCE_M <= gate.start_m < to_m and gate.zone != package.zone:
                self._leave_zone(package, gate.start_m)
                if not self.guard.may_enter(package, gate, piece.index):
                    return gate.start_m, True
        if to_m > piece.length_m:
            following = self._following(package)
            if following != END:
                for gate in self.zones.gates[following]:
                    if gate.start_m < 0.0 and gate.zone != package.zone:
                        self._leave_zone(package, piece.length_m)
                        if not self.guard.may_enter(package, gate, following):
                            return piece.length_m, True
        return to_m, False

    def _leave_zone(self, package: Package, offset_m: float | None = None) -> None:
        """Leave the zone when `package`, or `offset_m` of its piece, is behind or before it."""
        if package.zone == NO_ZONE:
            return
        at_m = package.offset_m if offset_m is None else offset_m
        for gate in self.zones.gates[package.piece]:
            if gate.zone == package.zone and gate.start_m < at_m < gate.end_m:
                return
        self.guard.release(package)

    def _following(self, package: Package) -> int:
        if package.zone != NO_ZONE and package.way:
            return package.way[0]
        return self.routes.next_of(package.piece, package.bay)

    def _go_back(self, package: Package, distance_m: float, passed: list[Package]) -> None:
        """Move `package` back by the negative `distance_m`; those behind it have moved already."""
        if package.turn == self.guard.turn:  # it has only just come, from a belt that runs forwards
            return
        package.turn = self.guard.turn
        while True:
            piece = self.network.pieces[package.piece]
            held = self.held[piece.index]
            sections = self.network.sections[piece.belt]
            before = sections[sections.index(piece) - 1] if piece is not sections[0] else None
            wanted_m = package.offset_m + distance_m
            mine = held.index(package)
            if mine:
                behind = held[mine - 1]
                room_m = package.offset_m - behind.offset_m - (package.length_m + behind.length_m) / 2.0
            else:
                room_m = self._gaps.behind_m(piece, package.offset_m, package.length_m, package, -distance_m)
            to_m = max(wanted_m, package.offset_m - max(0.0, room_m))
            to_m = self._gated_back(package, piece, before, to_m)
            if to_m >= 0.0 or (before is None and piece.belt in self.network.linked):
                package.offset_m = max(to_m, 0.0)
                is_free = package.offset_m <= wanted_m + TOLERANCE_M
                package.speed_mps = self.speeds[piece.belt] if is_free else 0.0
                self._leave_zone(package)
                return
            held.remove(package)
            if before is None:
                passed.append(package)
                return
            distance_m += package.offset_m
            if package.zone != NO_ZONE:
                package.way = (piece.index, *package.way)
            package.piece, package.offset_m = before.index, before.length_m
            self.held[before.index].append(package)

    def _gated_back(
        self, package: Package, piece: NetworkEdge, before: NetworkEdge | None, to_m: float
    ) -> float:
        """Return how far zones let `package` go back towards `to_m`."""
        for gate in reversed(self.zones.gates[piece.index]):
            if to_m < gate.end_m <= package.offset_m + TOLERANCE_M and gate.zone != package.zone:
                self._leave_zone(package, gate.end_m)
                if not self.guard.may_enter_reversed(package, gate):
                    return gate.end_m
        if to_m < 0.0 and before is not None:
            for gate in self.zones.gates[before.index]:
                if gate.end_m > before.length_m and gate.zone != package.zone:
                    self._leave_zone(package, 0.0)
                    if not self.guard.may_enter_reversed(package, gate):
                        return 0.0
        return to_m
