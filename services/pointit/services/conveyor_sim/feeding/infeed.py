"""Infeed: packages enter the conveyor when they are due and there is room."""

import math
from collections.abc import Callable, Sequence

from pointit.services.conveyor_sim.feeding.feed import Feeder
from pointit.services.conveyor_sim.network.piece import Piece
from pointit.services.conveyor_sim.traffic.package import Package
from pointit.services.conveyor_sim.traffic.traffic import TOLERANCE_M, Traffic

ROUNDING_S = 0.5e-9
"""Times are whole nanoseconds; sums of their floats are off by less than half a nanosecond."""


class NoRoomError(Exception):
    """A package does not fit now; the message is for users."""


class UnknownLaneError(Exception):
    """There is no such belt; the message lists the existing ones."""


class Infeed:
    """Puts packages on at the starts of belts, or at the ends of unlinked belts that run backwards."""

    def __init__(self, traffic: Traffic, send: Callable[[Package], None], *, prefix: str) -> None:
        """Number ids from `prefix`-1; `send` assigns a bay to a package that was put on."""
        self.prefix = prefix
        self.ids = 0
        self.fed = 0
        """Number of packages put on so far."""
        self.is_reverse = dict.fromkeys(traffic.network.lines, False)
        """True for a belt that runs backwards, or did before it stopped."""
        self._traffic = traffic
        self._network = traffic.network
        self._send = send

    def turn(self, belt: str, speed_mps: float) -> None:
        """Update the direction of `belt`, which runs at `speed_mps` from now on."""
        if speed_mps:
            self.is_reverse[belt] = speed_mps < 0.0

    def feed(self, feeders: Sequence[Feeder]) -> bool:
        """Put on all due packages that have room. Return True if there was one."""
        is_fed = False
        for feeder in feeders:
            while not feeder.is_done and feeder.due_s <= ROUNDING_S:
                belt, length_m = feeder.belt, feeder.supply.length_m
                if self._wait_m(belt, length_m) > 0.0:
                    break
                self._enter(feeder.take(), belt, length_m)
                is_fed = True
        return is_fed

    def next_s(self, feeders: Sequence[Feeder]) -> float:
        """Return the time until the next package can be fed at the current speeds, s."""
        return min(
            (
                max(feeder.due_s, self._room_in_s(feeder.belt, feeder.supply.length_m))
                for feeder in feeders
                if not feeder.is_done
            ),
            default=math.inf,
        )

    def add(self, kind: str, belt: str, length_m: float, position: float | None = None) -> str:
        """Put one package at the entry of `belt`, or at a share of its length, and return its id.

        Raises:
            UnknownLaneError: If there is no such belt.
            NoRoomError: If another package is in the way, or it is too long.
        """
        self.check(belt)
        longest_m = self._traffic.longest_m
        if self._network.links and length_m > longest_m:
            raise NoRoomError(
                f"{length_m:g} m do not fit round the junctions, at most {longest_m:g} m do; set longest_m"
            )
        if position is not None:
            at_m = position * self._network.lines[belt].length_m
            place = self._network.at(belt, at_m)
            if not self._traffic.is_clear(*place, length_m):
                raise NoRoomError(
                    f"lane {belt!r} has no room for {length_m:g} m at {at_m:.2f} m: ask again later"
                )
            package = self._package(kind, length_m)
            self._put(package, *place)
            return package.id
        wait_m = self._wait_m(belt, length_m)
        if wait_m > 0.0:
            speed_mps = self._traffic.speeds[belt]
            if not speed_mps:
                what = f"{wait_m:.2f} m are missing; the conveyor stands still: set a speed first"
            elif not math.isfinite(wait_m):
                what = "it runs backwards and cannot be fed: set another speed first"
            else:
                what = f"{wait_m:.2f} m are missing; ask again in {wait_m / abs(speed_mps):.1f} s"
            raise NoRoomError(f"lane {belt!r} has no room for {length_m:g} m now, {what}")
        return self._enter(kind, belt, length_m).id

    def fill(self, feeder: Feeder, initial: int) -> None:
        """Put on up to `initial` packages, as far as there is room, the first of each belt furthest along."""
        length_m = feeder.supply.length_m
        room = [int(self._network.lines[belt].length_m / length_m) for belt in feeder.belts]
        fills: list[list[Package]] = [[] for _ in feeder.belts]
        for index in range(initial):
            turn = index % len(feeder.belts)
            if feeder.is_done or len(fills[turn]) >= room[turn]:
                break
            fills[turn].append(self._package(feeder.take(), length_m))
        for belt, packages in zip(feeder.belts, fills, strict=True):
            spacing_m = self._network.lines[belt].length_m / max(1, len(packages))
            for index, package in enumerate(packages if self.is_reverse[belt] else packages[::-1]):
                place = self._network.at(belt, (index + 0.5) * spacing_m)
                if self._traffic.is_clear(*place, length_m):
                    self._put(package, *place)
                else:  # in a junction that is occupied
                    self.fed -= 1

    def check(self, belt: str) -> None:
        """Check that `belt` exists.

        Raises:
            UnknownLaneError: If it does not; lists the existing ones.
        """
        if belt not in self._network.lines:
            raise UnknownLaneError(
                f"there is no belt or lane {belt!r}; there are {', '.join(self._network.lines)}"
            )

    def _enter(self, kind: str, belt: str, length_m: float) -> Package:
        package = self._package(kind, length_m)
        self._put(package, *self._entry(belt))
        return package

    def _package(self, kind: str, length_m: float) -> Package:
        self.ids += 1
        self.fed += 1
        return Package(f"{self.prefix}-{self.ids}", kind, length_m)

    def _put(self, package: Package, piece: Piece, offset_m: float) -> None:
        package.piece = piece.index
        self._send(package)
        self._traffic.put(package, piece, offset_m)

    def _entry(self, belt: str) -> tuple[Piece, float]:
        sections = self._network.sections[belt]
        return (sections[-1], sections[-1].to_m) if self.is_reverse[belt] else (sections[0], 0.0)

    def _wait_m(self, belt: str, length_m: float) -> float:
        """Return the distance that `belt` must move until a package fits at the entry; 0: now."""
        if self.is_reverse[belt] and belt in self._network.linked:
            return math.inf
        return self._traffic.wait_m(*self._entry(belt), length_m)

    def _room_in_s(self, belt: str, length_m: float) -> float:
        wait_m = self._wait_m(belt, length_m)
        if wait_m <= TOLERANCE_M:
            return 0.0
        speed_mps = abs(self._traffic.speeds[belt])
        return wait_m / speed_mps if speed_mps else math.inf
