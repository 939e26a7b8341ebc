"""Who may pass a zone: first come, first served, and only who can leave it again."""

from collections.abc import Mapping
from dataclasses import dataclass

from pointit.services.conveyor_sim.network.network import Network
from pointit.services.conveyor_sim.network.rings import NO_RING, Rings
from pointit.services.conveyor_sim.network.routes import END, Routes
from pointit.services.conveyor_sim.network.zones import SHARP, Gate, Zones
from pointit.services.conveyor_sim.traffic.package import Package

NOTHING = -1
PAST_M = 1e-6


@dataclass(slots=True)
class _Waiting:
    """Somebody before a zone."""

    arrival: int
    turn: int
    """When it asked last; who does not ask any more does not wait."""
    lane: tuple[str | int, ...]
    is_ready: bool
    """Whether there is room behind the zone."""
    claims: int
    """The piece behind the zone whose next room is its own, before those who came later."""


@dataclass(frozen=True, slots=True)
class _Passage:
    """A way through a zone."""

    way: tuple[int, ...]
    lane: tuple[str | int, ...]
    is_exclusive: bool
    exit_m: float
    """Offset on the last piece of the way where the zone ends."""


class ZoneInterlock:
    """Lets packages into zones."""

    def __init__(
        self,
        network: Network,
        routes: Routes,
        zones: Zones,
        rings: Rings,
        *,
        held: list[list[Package]],
        speeds: Mapping[str, float],
    ) -> None:
        """Look at the packages by piece in `held` and the belts' `speeds`, which others change."""
        self._pieces = network.pieces
        self._routes = routes
        self._zones = zones
        self._rings = rings
        self._held = held
        self._speeds = speeds
        self._inside: list[dict[str, Package]] = [{} for _ in range(zones.count)]
        self._waiting: list[dict[str, _Waiting]] = [{} for _ in range(zones.count)]
        self._arrivals = 0
        self.turn = 0
        """Counts the steps of the conveyor."""

    def clear(self) -> None:
        """Have nobody in any zone."""
        for inside, waiting in zip(self._inside, self._waiting, strict=True):
            inside.clear()
            waiting.clear()

    def restore(self, package: Package) -> None:
        """Have `package` be in the zone that it says."""
        self._inside[package.zone][package.id] = package

    def release(self, package: Package) -> None:
        """Have `package` be out of its zone, if it is in one."""
        if package.zone >= 0:
            self._inside[package.zone].pop(package.id, None)
            package.leave_zone()

    def is_free(self, zone: int) -> bool:
        """Return True if nobody is in `zone`."""
        return not self._inside[zone]

    def occupy(self, package: Package, gate: Gate) -> None:
        """Have `package`, which has just been put on, be in the zone of `gate`, where nobody else is."""
        passage = self._passage(package, gate, package.piece)
        self._enter(package, gate.zone, passage)

    def may_enter(self, package: Package, gate: Gate, piece: int) -> bool:
        """Let `package` pass the zone of `gate` on `piece`, which it is about to enter, or not yet."""
        passage = self._passage(package, gate, piece)
        exit_piece = passage.way[-1] if passage.way else package.piece
        is_taken = self._ring_takes(package, gate.zone, passage)
        is_ready = is_taken and self._has_room(package, gate, passage)
        claims = exit_piece if is_taken else NOTHING  # who is on a ring must go on, whoever waits outside
        return self._decide(package, gate.zone, passage, is_ready=is_ready, claims=claims)

    def may_enter_reversed(self, package: Package, gate: Gate) -> bool:
        """Let `package`, whose belt runs backwards, into the zone of `gate` on its piece, or not yet."""
        lane = ("belt", self._pieces[package.piece].belt)
        return self._decide(
            package, gate.zone, _Passage((), lane, False, gate.end_m), is_ready=True, claims=NOTHING
        )

    def _decide(self, package: Package, zone: int, passage: _Passage, *, is_ready: bool, claims: int) -> bool:
        waiting = self._waiting[zone]
        mine = waiting.get(package.id)
        if mine is None or mine.turn < self.turn - 1:
            self._arrivals += 1
            mine = _Waiting(self._arrivals, self.turn, passage.lane, is_ready, claims)
            waiting[package.id] = mine
        mine.turn, mine.lane, mine.is_ready, mine.claims = self.turn, passage.lane, is_ready, claims
        if not is_ready:
            return False
        for other in self._inside[zone].values():
            if passage.is_exclusive or other.is_exclusive or other.lane != passage.lane:
                return False
        for name, rival in list(waiting.items()):
            if rival.turn < self.turn - 1:
                del waiting[name]
                continue
            is_before = rival.arrival < mine.arrival and rival.lane != passage.lane
            if is_before and (rival.is_ready or rival.claims == claims != NOTHING):
                return False
        del waiting[package.id]
        self._enter(package, zone, passage)
        return True

    def _enter(self, package: Package, zone: int, passage: _Passage) -> None:
        package.zone, package.way = zone, passage.way
        package.lane, package.is_exclusive = passage.lane, passage.is_exclusive
        self._inside[zone][package.id] = package

    def way(self, piece: int, gate: Gate, bay: str) -> tuple[list[int], Gate]:
        """Return the pieces after `piece` through the zone of `gate` on it, on the way to `bay`.

        And where on the last of them, or on `piece`, the zone lies.
        """
        way: list[int] = []
        here, inside = piece, gate
        while inside.end_m > self._pieces[here].length_m:
            following = self._routes.next_of(here, bay)
            if following == END or following in (piece, *way):
                break
            onward = next(
                (g for g in self._zones.gates[following] if g.zone == gate.zone and g.start_m < 0.0), None
            )
            if onward is None:  # the zone ends where this piece does
                break
            here, inside = following, onward
            way.append(here)
        return way, inside

    def _passage(self, package: Package, gate: Gate, piece: int) -> _Passage:
        way, inside = self.way(piece, gate, package.bay)
        if piece != package.piece:
            way.insert(0, piece)
        here = way[-1] if way else piece
        first, last = self._pieces[piece], self._pieces[here]
        exit_m = min(inside.end_m, last.length_m)
        along = first.direction(max(gate.start_m, 0.0)) @ last.direction(exit_m)
        belts = {self._pieces[index].belt for index in (piece, *way)}
        is_straight_on = len(belts) == 1 and not any(self._pieces[i].is_bridge for i in (piece, *way))
        lane: tuple[str | int, ...] = ("belt", first.belt) if is_straight_on else (piece, *way)
        return _Passage(tuple(way), lane, not is_straight_on and float(along) < SHARP, exit_m)

    def _ring_takes(self, package: Package, zone: int, passage: _Passage) -> bool:
        """Return True if the ring to which `passage` leads, if it does from outside, takes one more."""
        ring = self._rings.of[passage.way[-1]] if passage.way else NO_RING
        if ring == NO_RING or self._rings.of[package.piece] == ring:
            return True
        coming = sum(self._rings.of[other.piece] != ring for other in self._inside[zone].values())
        return self.on_ring(ring) + coming <= self._rings.most[ring]

    def on_ring(self, ring: int) -> int:
        """Return how many packages are on `ring`."""
        return sum(len(self._held[piece]) for piece in self._rings.pieces[ring])

    def takes(self, piece: int) -> bool:
        """Return True if one more may be put on `piece`; a ring is never filled."""
        ring = self._rings.of[piece]
        return ring == NO_RING or self.on_ring(ring) <= self._rings.most[ring]

    def _has_room(self, package: Package, gate: Gate, passage: _Passage) -> bool:
        """Return True if all that is on its way out of the zone, and `package`, fit before the next zone."""
        here = passage.way[-1] if passage.way else package.piece
        if not all(self._runs(piece) for piece in (here, *passage.way)):
            return False
        lengths_m = [other.length_m for other in self._inside[gate.zone].values()]
        room_m, from_m = 0.0, passage.exit_m
        seen: set[int] = set()
        while here not in seen:
            seen.add(here)
            piece = self._pieces[here]
            if not self._runs(here):  # who comes to it stands where it starts
                for other in self._held[here][:1]:
                    room_m -= max(0.0, (package.length_m + other.length_m) / 2.0 - other.offset_m)
                return self._fit(lengths_m, package, room_m)
            wall = next((g for g in self._zones.gates[here] if g.start_m >= from_m - PAST_M), None)
            to_m = piece.length_m if wall is None else wall.start_m
            lengths_m += [
                other.length_m for other in self._held[here] if from_m <= other.offset_m <= to_m + PAST_M
            ]
            room_m += to_m - from_m
            if wall is not None:
                return self._fit(lengths_m, package, room_m)
            if piece.bay and piece.bay == package.bay:
                return True
            here, from_m = self._routes.next_of(here, package.bay), 0.0
            if here == END:
                return True
            if any(g.start_m < 0.0 for g in self._zones.gates[here]):  # a zone begins with the piece
                return not lengths_m or sum(lengths_m) <= room_m + PAST_M
        return True

    def _runs(self, piece: int) -> bool:
        return self._speeds[self._pieces[piece].belt] > 0.0

    @staticmethod
    def _fit(lengths_m: list[float], package: Package, room_m: float) -> bool:
        """Return True if all have their centres within `room_m`; the first and the last stick out by half."""
        needed_m = sum(lengths_m) + package.length_m
        ends_m = ((lengths_m[0] if lengths_m else package.length_m) + package.length_m) / 2.0
        return needed_m - ends_m <= room_m + PAST_M
