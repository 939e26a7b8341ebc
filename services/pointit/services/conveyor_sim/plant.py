"""A conveyor plant: fed at its belts' starts, emptied at bays and ends, stepped in time."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pointit.geometry.polyline import Polyline
from pointit.schemas import NS_PER_S, ConveyorState, Environment, SelectionEvent, TrackedObjects
from pointit.schemas.environment import BeltSpeed
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.dispatch import Dispatch
from pointit.services.conveyor_sim.feeding import Feeder, configured
from pointit.services.conveyor_sim.network import Network, Piece
from pointit.services.conveyor_sim.package import Package
from pointit.services.conveyor_sim.routes import Routes
from pointit.services.conveyor_sim.schedule import scheduled
from pointit.services.conveyor_sim.sight import tracked_objects
from pointit.services.conveyor_sim.traffic import TOLERANCE_M, Traffic

ROUNDING_S = 0.5e-9
"""Times are whole nanoseconds; sums of their floats are off by less than half of one."""
SHORTEST_S = 1e-3
"""A feeder that found no room looks again after this at the earliest."""


class NoRoomError(Exception):
    """A package does not fit now; its text is one sentence for a person."""


class UnknownLaneError(Exception):
    """There is no such belt; its text lists those there are."""


class UnusableMapError(Exception):
    """The map does not have what the configuration needs; its text is one sentence for a person."""


class Plant:
    """Belts of a map with what moves on them.

    Packages enter with their centre at a belt's start and leave when it passes the end of a belt that leads
    nowhere, or their bay. A belt without links that runs backwards is fed at its end and emptied at its
    start; one with links holds back at its start what is on it, and is not fed. Without links, where a
    package is depends on the time alone, not on how often the plant is stepped.
    """

    def __init__(
        self, environment: Environment, config: ConveyorSimConfig, *, seed: int, start_ns: int
    ) -> None:
        """Take the belts (or strips) of `environment` that `config` names, its links and bays.

        Raises:
            UnusableMapError: a line, a feeder's belt or a bay is missing.
            ConfigError: the schedule cannot be used.
        """
        self.config = config
        self.network = network_of(environment, config)
        routes = Routes(self.network)
        self._traffic = Traffic(self.network, routes, longest_m=config.longest_fed_m)
        self._dispatch = Dispatch(routes, bay_selected=config.bay_selected, bay_rest=config.bay_rest)
        self._entries = list(config.lanes) or self.network.entries
        self._feeders = configured(config, self._entries, seed)
        self._schedule = scheduled(config, self.network.lines, seed)
        for feeder in self._feeders:
            for belt in feeder.belts:
                if belt not in self.network.lines:
                    raise UnusableMapError(
                        f"feeders.{feeder.name}: map {environment.name!r} has no {config.surface} {belt!r}, "
                        f"there are {', '.join(self.network.lines)}"
                    )
        self._prefix = f"{start_ns // 1_000_000:x}"  # unique across restarts and maps
        self._ids = 0
        self.fed = 0
        """Packages put on the conveyor so far."""
        self.changes = 0
        """Goes up with everything that must not be forgotten: feeds, departures, speeds, bays."""
        self._speed_mps = config.speed_mps
        self._own_speeds: dict[str, float] = {}
        self._is_reverse = dict.fromkeys(self.network.lines, False)
        self._now_ns = start_ns
        self._pending: list[SelectionEvent] = []
        self._run_at(self._schedule.step.speed_mps if self._schedule else config.speed_mps)
        self._fill()

    @property
    def size(self) -> int:
        """Return how many packages are on the conveyor."""
        return self._traffic.size

    @property
    def now_ns(self) -> int:
        """Return the time to which it was stepped."""
        return self._now_ns

    @property
    def speeds(self) -> Mapping[str, float]:
        """Return how fast each belt runs."""
        return self._traffic.speeds

    def step(self, now_ns: int) -> list[SelectionEvent]:
        """Go on to `now_ns`; return what left, was dispatched, refused. Time that went back stands still."""
        rest_s = max(0, now_ns - self._now_ns) / NS_PER_S
        self._now_ns = now_ns
        events, self._pending = self._pending, []
        was_foreseen = False
        while True:
            is_fed = self._feed()
            if rest_s <= 0.0:
                break
            most_s = min(rest_s, self._traffic.step_s)
            next_s = self._next_feed_s()
            if next_s <= 0.0 or (was_foreseen and not is_fed):  # somebody is held who was not foreseen to be
                next_s = max(next_s, SHORTEST_S)
            was_foreseen = next_s <= most_s
            until_s = min(most_s, next_s)
            events += self._pass(until_s)
            rest_s -= until_s
        self.changes += len(events)
        return events

    def stand_still(self, now_ns: int) -> None:
        """Let the time until `now_ns` go by without moving."""
        self._now_ns = now_ns

    def tracked(self, now_ns: int) -> TrackedObjects:
        """Return every package where it exactly is, belt by belt, stamped `now_ns`."""
        return TrackedObjects(stamp_ns=now_ns, objects=tuple(tracked_objects(self._traffic)))

    def state(self, now_ns: int) -> ConveyorState:
        """Return speeds and counts, stamped `now_ns`."""
        dispatch = self._dispatch
        return ConveyorState(
            stamp_ns=now_ns,
            speed_mps=self._speed_mps,
            fed=self.fed,
            left=dispatch.left,
            belts=tuple(
                BeltSpeed(id=belt, speed_mps=speed_mps)
                for belt, speed_mps in sorted(self._own_speeds.items())
            ),
            bays=dispatch.bays(),
            refused=dispatch.refused,
            step=self._schedule.name if self._schedule else "",
        )

    def select(self, owners: Mapping[str, str], now_ns: int) -> None:
        """Take who has which package selected by now; what came too late is told by the next step."""
        if dict(owners) != self._dispatch.selected:
            self._pending += self._dispatch.select(owners, self._traffic.packages, now_ns)
            self.changes += 1

    def set_speed(self, speed_mps: float, belts: Sequence[str] = ()) -> None:
        """Change the speed from the last step on, of `belts` alone or (empty) of all of them.

        Raises:
            UnknownLaneError: one of `belts` does not exist; nothing is changed.
        """
        for belt in belts:
            self._check_belt(belt)
        if not belts:
            self._run_at(speed_mps)
        for belt in belts:
            self._own_speeds[belt] = speed_mps
            self._turn(belt, speed_mps)
        self._traffic.move(0.0)  # so that packages have their new speeds at once
        self.changes += 1

    def add(self, kind: str, belt: str, length_m: float) -> str:
        """Put one package where `belt` begins (empty: the first entry), and return its id.

        Raises:
            UnknownLaneError: there is no such belt.
            NoRoomError: another package is in the way, or it is too long.
        """
        belt = belt or self._entries[0]
        self._check_belt(belt)
        if self.network.links and length_m > self._traffic.longest_m:
            raise NoRoomError(
                f"{length_m:g} m do not fit round the junctions, at most {self._traffic.longest_m:g} m do; "
                "set longest_m"
            )
        wait_m = self._wait_m(belt, length_m)
        if wait_m > 0.0:
            speed_mps = self._traffic.speeds[belt]
            if not speed_mps:
                what = f"{wait_m:.2f} m are missing; the conveyor stands still: set a speed first"
            elif not math.isfinite(wait_m):
                what = "it runs backwards and does not take anything: set another speed first"
            else:
                what = f"{wait_m:.2f} m are missing; ask again in {wait_m / abs(speed_mps):.1f} s"
            raise NoRoomError(f"lane {belt!r} has no room for {length_m:g} m now, {what}")
        return self._enter(kind, belt, length_m).id

    def reset(self) -> None:
        """Take everything off, set the counts to 0 and start the feeders again."""
        self._traffic.clear()
        self._dispatch.reset()
        self.fed = 0
        self._pending.clear()
        for feeder in self._feeders:
            feeder.restart()
        if self._schedule is not None:
            self._schedule.restart()
            self._run_at(self._schedule.step.speed_mps)
        self._fill()
        self.changes += 1

    def snapshot(self) -> dict[str, Any]:
        """Return all that is not in the map and the configuration, as what JSON can hold."""
        traffic, dispatch, schedule = self._traffic, self._dispatch, self._schedule
        return {
            "prefix": self._prefix,
            "ids": self._ids,
            "fed": self.fed,
            "left": dispatch.left,
            "refused": dispatch.refused,
            "counts": [[*key, *counts] for key, counts in dispatch.counts.items()],
            "speed_mps": self._speed_mps,
            "own_speeds": dict(self._own_speeds),
            "is_reverse": dict(self._is_reverse),
            "feeders": [[feeder.taken, feeder.due_s] for feeder in self._all_feeders()],
            "step": None if schedule is None or schedule.is_over else [schedule.index, schedule.left_s],
            "is_over": schedule is not None and schedule.is_over,
            "packages": [package.kept() for held in traffic.held for package in held],
        }

    def restore(self, kept: Mapping[str, Any]) -> None:
        """Be as the plant that made the snapshot `kept` of the same map and configuration."""
        traffic, dispatch, schedule = self._traffic, self._dispatch, self._schedule
        traffic.clear()
        self._prefix, self._ids, self.fed = kept["prefix"], kept["ids"], kept["fed"]
        dispatch.left, dispatch.refused = kept["left"], kept["refused"]
        dispatch.counts = {(bay, kind): (count, n) for bay, kind, count, n in kept["counts"]}
        self._run_at(kept["speed_mps"])
        if kept["own_speeds"]:
            for belt, speed_mps in kept["own_speeds"].items():
                self.set_speed(speed_mps, (belt,))
        self._is_reverse = dict(kept["is_reverse"])
        if schedule is not None:
            index, left_s = kept["step"] or (schedule.count, 0.0)
            schedule.resume(index, left_s)
        for feeder, (taken, due_s) in zip(self._all_feeders(), kept["feeders"], strict=True):
            feeder.taken, feeder.due_s = taken, due_s
        traffic.restore([Package.again(values) for values in kept["packages"]])
        dispatch.selected = {package.id: package.user for package in traffic.packages if package.user}

    def _all_feeders(self) -> Sequence[Feeder]:
        return self._feeders if self._schedule is None else self._schedule.feeders

    def _run_at(self, speed_mps: float) -> None:
        self._speed_mps = speed_mps
        self._own_speeds.clear()
        for belt in self.network.lines:
            self._turn(belt, speed_mps)
        self.changes += 1

    def _turn(self, belt: str, speed_mps: float) -> None:
        self._traffic.set_speed(belt, speed_mps)
        if speed_mps:
            self._is_reverse[belt] = speed_mps < 0.0

    def _pass(self, elapsed_s: float) -> list[SelectionEvent]:
        events = [
            self._dispatch.leave(package, self._bay_at(package), self._now_ns)
            for package in self._traffic.move(elapsed_s)
        ]
        for feeder in self._all_feeders():
            feeder.pass_time(elapsed_s)
        if self._schedule is not None:
            was = self._schedule.name
            if self._schedule.pass_time(elapsed_s):
                self._run_at(self._schedule.step.speed_mps)
            self.changes += self._schedule.name != was
        return events

    def _bay_at(self, package: Package) -> str:
        """Return the bay at which a package has left; empty: where a belt ends, or backwards at a start."""
        piece = self.network.pieces[package.piece]
        return "" if self._traffic.speeds[piece.belt] < 0.0 else piece.bay

    def _next_feed_s(self) -> float:
        """Return the time until something is to be fed, or a step of the schedule ends."""
        until_s = math.inf if self._schedule is None else self._schedule.left_s
        for feeder in self._all_feeders():
            if not feeder.is_done:
                room_s = self._room_in_s(feeder.belt, feeder.supply.length_m)
                until_s = min(until_s, max(feeder.due_s, room_s))
        return until_s

    def _feed(self) -> bool:
        is_fed = False
        for feeder in self._all_feeders():
            while not feeder.is_done and feeder.due_s <= ROUNDING_S:
                if self._wait_m(feeder.belt, feeder.supply.length_m) > 0.0:
                    break
                belt = feeder.belt
                self._enter(feeder.take(), belt, feeder.supply.length_m)
                is_fed = True
        return is_fed

    def _enter(self, kind: str, belt: str, length_m: float) -> Package:
        package = self._package(kind, length_m)
        self._traffic.put(package, *self._entry(belt))
        self._dispatch.send(package)
        return package

    def _package(self, kind: str, length_m: float) -> Package:
        self._ids += 1
        self.fed += 1
        self.changes += 1
        return Package(f"{self._prefix}-{self._ids}", kind, length_m)

    def _entry(self, belt: str) -> tuple[Piece, float]:
        """Return where packages enter `belt`."""
        sections = self.network.sections[belt]
        return (sections[-1], sections[-1].length_m) if self._is_reverse[belt] else (sections[0], 0.0)

    def _wait_m(self, belt: str, length_m: float) -> float:
        """Return how far `belt` must move until a package fits where they enter; 0: now."""
        if self._is_reverse[belt] and belt in self.network.linked:
            return math.inf
        return self._traffic.wait_m(*self._entry(belt), length_m, is_reverse=self._is_reverse[belt])

    def _room_in_s(self, belt: str, length_m: float) -> float:
        wait_m = self._wait_m(belt, length_m)
        if wait_m <= TOLERANCE_M:
            return 0.0
        speed_mps = abs(self._traffic.speeds[belt])
        return wait_m / speed_mps if speed_mps else math.inf

    def _check_belt(self, belt: str) -> None:
        if belt not in self.network.lines:
            raise UnknownLaneError(
                f"there is no lane {belt!r}; the lanes are {', '.join(self.network.lines)}"
            )

    def _fill(self) -> None:
        """Put the initial packages on, as many as have room, the first of each belt furthest along."""
        if self._schedule is not None or self.config.feeders or not self.config.feeder.initial:
            return
        feeder = self._feeders[0]
        length_m = feeder.supply.length_m
        room = [int(self.network.lines[belt].length_m / length_m) for belt in feeder.belts]
        fills: list[list[Package]] = [[] for _ in feeder.belts]
        for index in range(self.config.feeder.initial):
            turn = index % len(feeder.belts)
            if feeder.is_done or len(fills[turn]) >= room[turn]:
                break
            fills[turn].append(self._package(feeder.take(), length_m))
        for belt, packages in zip(feeder.belts, fills, strict=True):
            spacing_m = self.network.lines[belt].length_m / max(1, len(packages))
            for index, package in enumerate(packages if self._is_reverse[belt] else packages[::-1]):
                piece, offset_m = self.network.at(belt, (index + 0.5) * spacing_m)
                if self._traffic.is_clear(piece, offset_m, length_m):
                    self._traffic.put(package, piece, offset_m)
                    self._dispatch.send(package)
                else:  # in a junction that another one is in
                    self.fed -= 1


def network_of(environment: Environment, config: ConveyorSimConfig) -> Network:
    """Return the belts or strips of `environment` that `config` names as a network.

    Raises:
        UnusableMapError: one is missing, or is no line.
    """
    surface = config.surface
    there = environment.strips if surface == "strip" else environment.belts
    lines = {line.id: line.line_m for line in there}
    wanted = config.lanes or tuple(lines)
    missing = [lane for lane in wanted if lane not in lines]
    if missing or not wanted:
        what = f"no {surface} {missing[0]!r}" if missing else f"no {surface}s"
        listed = ", ".join(lines) or "none"
        raise UnusableMapError(
            f"lanes: map {environment.name!r} has {what}, there are {listed}; set surface and lanes"
        )
    try:
        chosen = {lane: Polyline(lines[lane]) for lane in wanted}
    except ValueError as error:
        raise UnusableMapError(
            f"lanes: a {surface} of map {environment.name!r} is no lane: {error}"
        ) from error
    if surface == "strip":
        return Network(chosen, surface=surface)
    bays = {bay.id: bay.belt for bay in environment.bays}
    return Network(chosen, environment.links, bays, surface=surface)
