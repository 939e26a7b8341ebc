"""Packages on a network of belts: they move in order, give way at junctions, and never overlap."""

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple, Self

from pointit.services.conveyor_sim.network import NONE, SHARP, BeltRoutes, Network, Piece

Way = tuple[int, ...]
"""Pieces in order."""

PAST_M = 1e-6
TOLERANCE_M = 1e-9
"""Overlap of touching packages by rounding."""
RETRY_M = 0.01
"""Distance of belt motion after which a package that waits for a junction tries again."""
STEP_S = 0.05
"""Longest time step with linked belts."""


@dataclass(slots=True, eq=False)
class Package:
    """Identity, position and destination of a package."""

    id: str
    kind: str
    length_m: float
    piece: int = 0
    offset_m: float = 0.0
    """Position of its centre from the start of the piece's section."""
    speed_mps: float = 0.0
    """Speed along the piece; 0 while held."""
    bay: str = ""
    """Its bay, or `""` for straight on."""
    user: str = ""
    """User who has it selected."""
    refused: str = ""
    """Bay for which its selection came too late; reported once."""
    way: tuple[int, ...] = ()
    """In a junction: its piece and those after it up to the end, which later selections do not change."""
    turn: int = 0
    """The last step of the conveyor in which it moved."""

    @property
    def decided(self) -> int:
        """Return the last piece of the way to which it is committed."""
        return self.way[-1] if self.way else self.piece

    def to_state(self) -> list[Any]:
        """Return the state as JSON values."""
        identity = (self.id, self.kind, self.length_m)
        motion = (self.piece, self.offset_m, self.speed_mps)
        destination = (self.bay, self.user, self.refused)
        return [identity + motion + destination, self.way]

    @classmethod
    def from_state(cls, state: Sequence[Any]) -> Self:
        """Return the package with the state `state`, on the network on which it was."""
        values, way = state
        return cls(*values, way=tuple(way))


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

        # Pieces and requests of each junction
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
        if junction == NONE:
            return ()
        way: list[int] = []
        while piece != NONE and piece not in way:
            if self._pieces[piece].junction != junction:
                break
            way.append(piece)
            piece = self._routes.next_of(piece, bay)
        return tuple(way)

    def inside(self, junction: int) -> list[Package]:
        """Return the packages in `junction`."""
        packages: list[Package] = []
        for piece in self._members[junction]:
            packages += self._held[piece]
        return packages

    def admits(self, package: Package, way: Way) -> bool:
        """Ask for `package` to enter a junction ahead on `way`. Return True if it may enter now."""
        junction = self._pieces[way[0]].junction
        if self._ring_takes(package, way):
            request = EntryRequest(self.turn, way[-1], is_ready=self._has_room(package, way))
        else:  # packages on the ring go first
            request = EntryRequest(self.turn, NONE, is_ready=False)
        if self._is_straight(way):
            is_open = self._is_on(way, junction)
        else:
            is_open = not self.inside(junction)
        return self._may_enter(package, junction, request, is_open=is_open)

    def admits_back(self, package: Package, junction: int, belt: Way) -> bool:
        """Ask for `package`, whose `belt` runs backwards, to enter `junction`. Return True if it may now."""
        request = EntryRequest(self.turn, NONE, is_ready=True)
        return self._may_enter(package, junction, request, is_open=self._is_on(belt, junction))

    def takes(self, piece: int) -> bool:
        """Return True if one more may be put on `piece`: its junction is empty, and its ring not filled."""
        junction = self._pieces[piece].junction
        if junction != NONE and self.inside(junction):
            return False
        ring = self._rings.of[piece]
        return ring == NONE or self._on_ring(ring) <= self._rings.capacity[ring]

    def _may_enter(self, package: Package, junction: int, request: EntryRequest, *, is_open: bool) -> bool:
        """Store the request of `package`. Return True if no earlier one has the right of way."""
        # Requests are repeated in every step: one that is missing has stopped asking
        waiting = self._waiting[junction]
        for other, last_request in list(waiting.items()):
            if last_request.turn < self.turn - 1:
                del waiting[other]
        waiting[package] = request
        if not request.is_ready or not is_open:
            return False

        # Earlier ones that are ready go first, and those that wait for room at the same exit
        for other, earlier in waiting.items():
            if other is package:
                break
            if earlier.is_ready:
                return False
            if request.exit != NONE and earlier.exit == request.exit:
                return False
        del waiting[package]
        return True

    def _is_on(self, way: Way, junction: int) -> bool:
        """Return True if all packages in `junction` stay on `way`."""
        pieces = set(way)
        return all(pieces.issuperset(package.way) for package in self.inside(junction))

    def _is_straight(self, way: Way) -> bool:
        """Return True if `way` stays on one belt or has no sharp turn."""
        first = self._pieces[way[0]]
        last = self._pieces[way[-1]]
        pieces = [self._pieces[index] for index in way]
        if all(piece.belt == first.belt and not piece.target for piece in pieces):
            return True
        cosine = float(first.direction(first.from_m) @ last.direction(last.to_m))
        return cosine >= SHARP

    def _ring_takes(self, package: Package, way: Way) -> bool:
        """Return True if `way` leads from outside to no ring or to one with room for one more."""
        ring = self._rings.of[way[-1]]
        if ring == NONE or self._rings.of[package.piece] == ring:
            return True

        # Packages in the junction count, too, if they come from outside and are committed to the ring
        coming = 0
        for other in self.inside(self._pieces[way[0]].junction):
            if self._rings.of[other.piece] != ring and self._rings.of[other.decided] == ring:
                coming += 1
        return self._on_ring(ring) + coming <= self._rings.capacity[ring]

    def _on_ring(self, ring: int) -> int:
        return sum(len(self._held[piece]) for piece in self._rings.pieces[ring])

    def _has_room(self, package: Package, way: Way) -> bool:
        """Return True if `package` and all packages in its junction fit behind it, before the next one."""
        if not all(self._runs(piece) for piece in way):
            return False

        # Room of the pieces behind the junction, up to the next one or a belt that stands still
        lengths_m = [other.length_m for other in self.inside(self._pieces[way[0]].junction)]
        room_m = 0.0
        passed = list(way)
        while True:
            index = self._routes.next_of(passed[-1], package.bay)
            if index == NONE or index in passed:
                return True
            piece = self._pieces[index]
            held = self._held[index]
            if piece.junction != NONE:
                break
            if not self._runs(index):  # packages stop where it starts
                for other in held[:1]:
                    apart_m = other.offset_m - piece.from_m
                    room_m -= max(0.0, (package.length_m + other.length_m) / 2.0 - apart_m)
                break
            lengths_m += [other.length_m for other in held]
            room_m += piece.length_m
            passed.append(index)

        # The first and the last package stick out by half
        first_m = lengths_m[0] if lengths_m else package.length_m
        ends_m = (first_m + package.length_m) / 2.0
        return sum(lengths_m) + package.length_m - ends_m <= room_m + PAST_M

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
            first = members[0]
            if len(members) == 1 and first not in network.pieces[first].successors:
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
    predecessors = [network.pieces[index] for index in piece.predecessors]
    follows_junction = any(predecessor.junction != NONE for predecessor in predecessors)
    return int(piece.length_m / longest_m) + follows_junction


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
        self._undecided_ways: dict[tuple[int, str, str], Way] = {}

    def time_left_s(self, package: Package, wanted: str) -> float:
        """Return the shortest time in which `package` can pass its last way to bay `wanted`, s.

        Infinite while belts on the way there stand still or run backwards. Packages that wait for others take
        longer. 0: it may pass it now, or has passed it.
        """
        if not self._routes.reaches(package.decided, wanted):
            return 0.0
        decided = package.way or (package.piece,)
        undecided = self._undecided_way(package.decided, package.bay, wanted)
        time_s = 0.0
        from_m = package.offset_m
        for index in decided + undecided:
            piece = self._pieces[index]
            if index != package.piece:
                from_m = piece.from_m
            speed_mps = self._speeds[piece.belt]
            if speed_mps <= 0.0:
                return math.inf
            time_s += max(0.0, piece.to_m - from_m) / speed_mps
        return time_s

    def _undecided_way(self, piece: int, bay: str, wanted: str) -> Way:
        """Return the pieces after `piece` on the way to `bay` from which a way leads to `wanted`, too."""
        key = (piece, bay, wanted)
        if key not in self._undecided_ways:
            way: list[int] = []
            following = self._routes.next_of(piece, bay)
            while following != NONE:
                ahead = self._right_of_way.way(following, bay) or (following,)
                if not self._routes.reaches(ahead[-1], wanted):
                    break
                way += ahead
                following = self._routes.next_of(ahead[-1], bay)
            self._undecided_ways[key] = tuple(way)
        return self._undecided_ways[key]


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
        return chain.from_iterable(self.held)

    @property
    def size(self) -> int:
        """Return the number of packages."""
        return sum(map(len, self.held))

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

        # Backwards, the packages ahead are those on pieces with lower numbers
        backward: set[int] = set()
        for name, pieces in self.network.sections.items():
            if self.speeds[name] < 0.0:
                backward.update(piece.index for piece in pieces)
        forward = [index for index in self.network.front_first if index not in backward]
        self._order = forward + sorted(backward)

    def clear(self) -> None:
        """Remove all packages."""
        for packages in self.held:
            packages.clear()

    def put(self, package: Package, piece: Piece, offset_m: float) -> None:
        """Put `package` at `offset_m` of `piece`, after `is_clear` returned True."""
        package.piece = piece.index
        package.offset_m = offset_m
        package.way = self._right_of_way.way(piece.index, package.bay)
        self._insert(package)
        package.speed_mps = self._speed(piece)

    def restore(self, packages: Iterable[Package]) -> None:
        """Put `packages`, in the order of the property `packages`, at their own positions."""
        for package in packages:
            self._insert(package)

    def wait_m(self, piece: Piece, offset_m: float, length_m: float) -> float:
        """Return the distance that the belt must move until a package of `length_m` fits there; 0: now."""
        candidate = Package("", "", length_m, piece.index, offset_m)
        behind_m, _ = self._room(candidate, is_ahead=False)
        ahead_m, _ = self._room(candidate, is_ahead=True)
        missing_m = -min(behind_m, ahead_m)
        if not self._right_of_way.takes(piece.index):
            missing_m = max(missing_m, RETRY_M)
        return missing_m if missing_m > TOLERANCE_M else 0.0

    def is_clear(self, piece: Piece, offset_m: float, length_m: float) -> bool:
        """Return True if a package of `length_m` may be put there: nothing near, no junction in use."""
        return self.wait_m(piece, offset_m, length_m) == 0.0

    def move(self, elapsed_s: float) -> list[Package]:
        """Advance by `elapsed_s`, at most `step_s`. Return the packages that left at an end, in order."""
        self._right_of_way.turn += 1
        turn = self._right_of_way.turn
        passed_packages: list[Package] = []
        for index in self._order:
            if not self.held[index]:
                continue

            # A copy in the order of travel: packages may leave the piece meanwhile
            packages = self.held[index].copy()
            if self._speed(self.network.pieces[index]) > 0.0:
                packages.reverse()
            for package in packages:
                if package.turn != turn:  # it may have come in this step from a piece that moved earlier
                    package.turn = turn
                    self._advance(package, elapsed_s, passed_packages)
        return passed_packages

    def _speed(self, piece: Piece) -> float:
        speed_mps = self.speeds[piece.belt]
        return max(0.0, speed_mps) if piece.target else speed_mps  # bridges do not run backwards

    def _insert(self, package: Package) -> None:
        packages = self.held[package.piece]
        position = bisect_left(packages, package.offset_m, key=_offset_m)
        packages.insert(position, package)
        self._longest_m = max(self._longest_m, package.length_m)

    def _advance(self, package: Package, elapsed_s: float, passed_packages: list[Package]) -> None:
        """Move `package`, the first of those of its piece that have not moved yet."""
        while True:
            piece = self.network.pieces[package.piece]
            speed_mps = self._speed(piece)
            if speed_mps == 0.0:
                package.speed_mps = 0.0
                return

            # As far as the belt moves, up to the next package
            is_ahead = speed_mps > 0.0
            belt_m = abs(speed_mps) * elapsed_s
            room_m, next_mps = self._room(package, is_ahead=is_ahead, further_m=belt_m)
            step_m = min(belt_m, max(room_m, 0.0))

            # It stays on its piece
            end_m = piece.to_m if is_ahead else piece.from_m
            remaining_m = abs(end_m - package.offset_m)
            following = self._following(package, is_ahead=is_ahead)
            is_leaving = following != NONE and self.network.pieces[following].junction == NONE
            tolerance_m = TOLERANCE_M if is_leaving else 0.0
            if step_m <= remaining_m - tolerance_m:
                package.offset_m += math.copysign(step_m, speed_mps)
                package.speed_mps = speed_mps
                if room_m <= belt_m + TOLERANCE_M:  # it goes on as fast as the next one
                    slowest, fastest = sorted((0.0, speed_mps))
                    package.speed_mps = min(max(next_mps, slowest), fastest)
                return

            # It waits at the end of its piece. A linked belt that runs backwards holds it at its start
            can_leave = is_ahead or piece.belt not in self.network.linked
            is_end = following == NONE and can_leave
            if not is_end and not self._goes_on(package, following, is_ahead=is_ahead):
                package.offset_m = end_m
                package.speed_mps = 0.0
                return

            # It leaves the network, or enters the next piece and goes on for the time that remains
            self.held[piece.index].remove(package)
            if is_end:
                passed_packages.append(package)
                return
            elapsed_s = max(0.0, elapsed_s - remaining_m / abs(speed_mps))
            entered = self.network.pieces[following]
            package.piece = following
            if is_ahead:
                package.offset_m = entered.from_m
                self.held[following].insert(0, package)
            else:
                package.offset_m = entered.to_m
                self.held[following].append(package)

    def _following(self, package: Package, *, is_ahead: bool) -> int:
        """Return the next piece of `package`, or `NONE` at its last one."""
        if not is_ahead:
            return self.network.pieces[package.piece].before
        if len(package.way) > 1:
            return package.way[1]
        return self._routes.next_of(package.piece, package.bay)

    def _goes_on(self, package: Package, following: int, *, is_ahead: bool) -> bool:
        """Return True if `package` may go on to `following`, and update its way through a junction."""
        if following == NONE:
            return False
        piece = self.network.pieces[package.piece]
        junction = self.network.pieces[following].junction
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
        # The next one on the same piece
        neighbour = self._neighbour(package, is_ahead=is_ahead)
        if neighbour is not None:
            apart_m = abs(neighbour.offset_m - package.offset_m)
            return apart_m - (package.length_m + neighbour.length_m) / 2.0, neighbour.speed_mps

        # Else the nearest one on the pieces beyond, as far as the longest package reaches
        pieces = self.network.pieces
        piece = pieces[package.piece]
        end_m = piece.to_m - package.offset_m if is_ahead else package.offset_m - piece.from_m
        waiting = [(end_m, piece)]
        nearest = (math.inf, 0.0)
        seen = {package.piece}
        while waiting:
            far_m, piece = waiting.pop()
            if far_m > self._longest_m + further_m:
                continue
            beyond_indices = piece.successors if is_ahead else piece.predecessors
            for index in beyond_indices:
                beyond = pieces[index]
                held = self.held[index]
                if held:
                    other = held[0] if is_ahead else held[-1]
                    inside_m = other.offset_m - beyond.from_m if is_ahead else beyond.to_m - other.offset_m
                    apart_m = far_m + inside_m
                    if other is not package:  # in a ring it follows itself
                        room_m = apart_m - (package.length_m + other.length_m) / 2.0
                        nearest = min(nearest, (room_m, other.speed_mps))
                elif index not in seen:
                    seen.add(index)
                    waiting.append((far_m + beyond.length_m, beyond))
        return nearest

    def _neighbour(self, package: Package, *, is_ahead: bool) -> Package | None:
        """Return the next package ahead (or behind) on the same piece, or None."""
        packages = self.held[package.piece]
        if package in packages:
            position = packages.index(package)
            ahead = position + 1
        else:
            position = bisect_left(packages, package.offset_m, key=_offset_m)
            ahead = position
        if is_ahead:
            return packages[ahead] if ahead < len(packages) else None
        return packages[position - 1] if position > 0 else None


def _offset_m(package: Package) -> float:
    return package.offset_m
