"""A conveyor plant of a map: fed at its belts' starts, emptied at assigned bays and ends, stepped in time."""

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pointit.geometry.polyline import Polyline
from pointit.runtime.config.parameters import set_option
from pointit.schemas import (
    NS_PER_S,
    BayCount,
    ConveyorState,
    Departure,
    Environment,
    SelectionEvent,
    TrackedObjects,
)
from pointit.schemas.environment import BeltSpeed
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.feeding import END, Feeders, Infeed
from pointit.services.conveyor_sim.network import BeltRoutes, Network
from pointit.services.conveyor_sim.tracking import ground_truth_objects
from pointit.services.conveyor_sim.traffic import LastWay, Package, Traffic

DEPARTURES = 50
"""Largest number of stored departures, which suffices for subscribers that were away."""

SHORTEST_S = 1e-3
"""Shortest time after which a feeder that found no room tries again."""


class Dispatch:
    """Sends selected packages to one bay and the rest to another, and counts them."""

    def __init__(self, routes: BeltRoutes, last_way: LastWay, *, bay_selected: str, bay_rest: str) -> None:
        self._routes = routes
        self._last_way = last_way
        self._bay_selected = bay_selected
        self._bay_rest = bay_rest
        self.selected: dict[str, str] = {}
        """User by selected package, as of the last selection."""
        self.reset()

    def reset(self) -> None:
        """Set all counts to 0."""
        self.left = 0
        """Number of packages that left, at a bay or at the end of a belt."""
        self.refused = 0
        self.counts: dict[tuple[str, str], tuple[int, int]] = {}
        """By bay (`""`: the end of a belt) and kind: number of packages that left, and of selected ones."""
        self.departures: deque[Departure] = deque(maxlen=DEPARTURES)
        """The latest packages that left and were selected, or were selected too late."""

    def assign_bay(self, package: Package) -> None:
        """Assign a new package its bay."""
        package.user = self.selected.get(package.id, "")
        wanted = self._bay_selected if package.user else self._bay_rest
        package.bay = self._routes.best(package.piece, wanted)

    def select(self, owners: Mapping[str, str], packages: Iterable[Package]) -> None:
        """Apply the selection. Where it is too late for a package, that goes on to its bay for its user."""
        self.selected = dict(owners)
        for package in packages:
            user = owners.get(package.id, "")
            if not package.bay:
                package.user = user
                continue
            wanted = self._bay_for(package, is_selected=bool(user))
            if package.bay == wanted or self._routes.reaches(package.decided, wanted):
                package.bay = wanted
                package.user = user
                package.refused = ""
            elif package.refused != wanted:
                package.refused = wanted
                self.refused += 1

    def until_ns(self, package: Package, now_ns: int) -> int | None:
        """Return the last time at which (de)selecting `package` changes its bay; 0: past, None: no limit."""
        wanted = self._bay_for(package, is_selected=not package.user)
        if not package.bay or package.bay == wanted:
            return None
        if not self._routes.reaches(package.decided, wanted):
            return 0
        remaining_s = self._last_way.time_left_s(package, wanted)
        if remaining_s == math.inf:
            return None
        return now_ns + int(remaining_s * NS_PER_S)

    def _bay_for(self, package: Package, *, is_selected: bool) -> str:
        """Return the bay of selected packages or of the rest, or the nearest one if the map lacks it."""
        wanted = self._bay_selected if is_selected else self._bay_rest
        if self._routes.has(wanted):
            return wanted
        return self._routes.best(package.decided, wanted)

    def leave(self, package: Package, bay: str, now_ns: int) -> SelectionEvent:
        """Count a package that left at `bay` (`""`: at the end of a belt) and return its event."""
        self.left += 1
        user = package.user
        if user or package.refused:
            self.departures.append(Departure(object_id=package.id, stamp_ns=now_ns, bay=bay, user=user))
        count, selected = self.counts.get((bay, package.kind), (0, 0))
        self.counts[bay, package.kind] = (count + 1, selected + bool(user))
        return SelectionEvent(
            stamp_ns=now_ns,
            event="dispatched" if bay else "left",
            object_id=package.id,
            kind=package.kind,
            user=user,
            bay=bay,
        )

    def bays(self) -> tuple[BayCount, ...]:
        """Return the counts as message parts."""
        counts: list[BayCount] = []
        for (bay, kind), (count, selected) in sorted(self.counts.items()):
            counts.append(BayCount(bay=bay, kind=kind, count=count, selected=selected))
        return tuple(counts)


class UnusableMapError(Exception):
    """The map lacks what the configuration needs; the message is for users."""


def network_of(environment: Environment, config: ConveyorSimConfig) -> Network:
    """Return the belts or strips of `environment` that `config` names as a network.

    Raises:
        UnusableMapError: If one is missing or not a valid line.
    """
    # The lanes that the configuration names, all of the surface by default
    surface = config.surface
    map_lines = environment.strips if surface == "strip" else environment.belts
    lines = {line.id: line.line_m for line in map_lines}
    lanes = config.lanes or tuple(lines)
    missing = [lane for lane in lanes if lane not in lines]
    if missing:
        raise _no_lanes(environment, surface, tuple(lines), f"no {surface} {missing[0]!r}")
    if not lanes:
        raise _no_lanes(environment, surface, tuple(lines), f"no {surface}s")
    try:
        polylines = {lane: Polyline(lines[lane]) for lane in lanes}
    except ValueError as error:
        raise UnusableMapError(
            f"lanes: a {surface} of map {environment.name!r} is not a valid lane: {error}"
        ) from error

    # Only belts have links and bays
    if surface == "strip":
        return Network(polylines, longest_m=config.longest_fed_m, surface=surface)
    bays = {bay.id: bay.belt for bay in environment.bays}
    return Network(polylines, environment.links, bays, longest_m=config.longest_fed_m)


def _no_lanes(environment: Environment, surface: str, names: Sequence[str], problem: str) -> UnusableMapError:
    """Return the error that a map has no lanes as configured: its lanes, and the two remedies."""
    listed = ", ".join(names) or "none"
    example = names[0] if names else ""
    other_surface = "belt" if surface == "strip" else "strip"
    lanes_option = set_option("conveyor-sim", "lanes", f"[{example}]")
    surface_option = set_option("conveyor-sim", "surface", other_surface)
    return UnusableMapError(
        f"lanes: map {environment.name!r} has {problem}, there are {listed}; use others, as by "
        f"{lanes_option}, or the other surface by {surface_option}"
    )


class Plant:
    """Belts of a map and the packages on them.

    Packages enter with their centre at a belt's start and leave when it passes their bay or the end of a belt
    without successor. An unlinked belt that runs backwards is fed at its end and emptied at its start; a
    linked one holds packages at its start and is not fed. Without links the position of a package depends on
    the time alone, not on the step size.
    """

    def __init__(
        self,
        environment: Environment,
        config: ConveyorSimConfig,
        *,
        seed: int,
        start_ns: int,
        is_feeding: bool = True,
    ) -> None:
        """Create the plant from the belts (or strips) that `config` names, and the links and bays.

        Raises:
            UnusableMapError: If a line, a feeder's belt or a bay is missing.
            ConfigError: If the schedule cannot be used.
        """
        # Belts, the packages on them, and where these go
        self.config = config
        self.network = network_of(environment, config)
        routes = BeltRoutes(self.network)
        self._traffic = Traffic(self.network, routes, longest_m=config.longest_fed_m)
        self._dispatch = Dispatch(
            routes, self._traffic.last_way, bay_selected=config.bay_selected, bay_rest=config.bay_rest
        )

        # Where they come from
        self._entries = list(config.lanes) or self.network.entries
        self._feeders = Feeders(
            config, entries=self._entries, belts=self.network.lines, seed=seed, is_on=is_feeding
        )
        self._check_feeders(environment)
        prefix = f"{start_ns // 1_000_000:x}"  # unique across restarts and maps
        self._infeed = Infeed(self._traffic, self._dispatch.assign_bay, prefix=prefix)
        self.changes = 0
        """Counter of changes that must be saved: feeds, departures, speeds, bays."""
        self._speed_mps = config.speed_mps
        self._own_speeds: dict[str, float] = {}
        self.now_ns = start_ns
        """Time of the last step."""
        self.speeds: Mapping[str, float] = self._traffic.speeds
        """Speed of each belt, m/s."""

        # Speeds first: they say at which end of a belt the first packages are
        speed_mps = config.speed_mps
        if self._feeders.schedule is not None:
            speed_mps = self._feeders.schedule.step.speed_mps
        self._run_at(speed_mps)
        self._fill()

    def _check_feeders(self, environment: Environment) -> None:
        """Check that the feeders' belts are in the map. Raises UnusableMapError if not."""
        for feeder in self._feeders.all:
            for belt in feeder.belts:
                if belt in self.network.lines:
                    continue
                belts = list(self.network.lines)
                option = set_option("conveyor-sim", f"feeders.{feeder.name}.belt", belts[0])
                raise UnusableMapError(
                    f"feeders.{feeder.name}: map {environment.name!r} has no {self.config.surface} "
                    f"{belt!r}, there are {', '.join(belts)}; {option}"
                )

    @property
    def fed(self) -> int:
        """Return the number of packages put on the conveyor so far."""
        return self._infeed.fed

    @property
    def is_feeding(self) -> bool:
        """Return True if the feeders are on."""
        return self._feeders.is_on

    @property
    def size(self) -> int:
        """Return the number of packages on the conveyor."""
        return self._traffic.size

    def step(self, now_ns: int) -> list[SelectionEvent]:
        """Advance to `now_ns` and return the events. An earlier time than before changes nothing."""
        remaining_s = max(0, now_ns - self.now_ns) / NS_PER_S
        self.now_ns = now_ns
        events: list[SelectionEvent] = []
        was_foreseen = False
        while True:
            # Feed at the exact times, so that positions do not depend on the step
            is_fed = self._infeed.feed(self._feeders.active)
            self.changes += is_fed
            if remaining_s <= 0.0:
                break
            max_step_s = min(remaining_s, self._traffic.step_s)
            next_s = self._infeed.next_s(self._feeders.active)
            if self._feeders.schedule is not None:
                next_s = min(next_s, self._feeders.schedule.left_s)

            # Without a minimum, a package that is held unexpectedly would stop the time
            is_held = was_foreseen and not is_fed
            if next_s <= 0.0 or is_held:
                next_s = max(next_s, SHORTEST_S)
            was_foreseen = next_s <= max_step_s
            step_s = min(max_step_s, next_s)
            events += self._advance(step_s)
            remaining_s -= step_s
        self.changes += len(events)
        return events

    def skip_time(self, now_ns: int) -> None:
        """Set the time to `now_ns` without motion."""
        self.now_ns = now_ns

    def tracked(self, now_ns: int) -> TrackedObjects:
        """Return every package at its exact position, belt by belt, stamped `now_ns`."""
        objects = ground_truth_objects(
            self._traffic, lambda package: self._dispatch.until_ns(package, now_ns)
        )
        return TrackedObjects(stamp_ns=now_ns, objects=tuple(objects), latency_sigma_s=0.0)

    def state(self, now_ns: int) -> ConveyorState:
        """Return speeds and counts, stamped `now_ns`."""
        dispatch = self._dispatch
        belts: list[BeltSpeed] = []
        for belt, speed_mps in sorted(self._own_speeds.items()):
            belts.append(BeltSpeed(id=belt, speed_mps=speed_mps))
        return ConveyorState(
            stamp_ns=now_ns,
            speed_mps=self._speed_mps,
            fed=self.fed,
            left=dispatch.left,
            belts=tuple(belts),
            bays=dispatch.bays(),
            refused=dispatch.refused,
            step=self._feeders.step,
            feeding=self.is_feeding,
            departures=tuple(dispatch.departures),
        )

    def select(self, owners: Mapping[str, str]) -> None:
        """Apply the selection."""
        if dict(owners) != self._dispatch.selected:
            self._dispatch.select(owners, self._traffic.packages)
            self.changes += 1

    @property
    def names(self) -> tuple[str, ...]:
        """Return the packages on the conveyor."""
        return tuple(package.id for package in self._traffic.packages)

    @property
    def refusals(self) -> Mapping[str, str]:
        """Return each package, with the reason if its selection came too late for its bay, else `""`."""
        reasons: dict[str, str] = {}
        for package in self._traffic.packages:
            reason = ""
            if package.refused:
                reason = f"it is past its last way to bay {package.refused} and goes on to bay {package.bay}"
            reasons[package.id] = reason
        return reasons

    def set_speed(self, speed_mps: float, belts: Sequence[str] = ()) -> None:
        """Change the speed from the last step on, of `belts` or (if empty) of all belts.

        Raises:
            UnknownLaneError: If one of `belts` does not exist; nothing is changed.
        """
        for belt in belts:
            self._infeed.check(belt)
        if not belts:
            self._run_at(speed_mps)
        for belt in belts:
            self._own_speeds[belt] = speed_mps
            self._turn(belt, speed_mps)
        self._traffic.move(0.0)  # updates the packages' speeds
        self.changes += 1

    def set_feeding(self, *, is_on: bool) -> None:
        """Turn the feeders on or off from the last step on. If they have ended, on restarts them."""
        self._feeders.is_on = is_on
        if is_on and self._feeders.step == END:
            self._restart_feeders()
        self.changes += 1

    def add(self, kind: str, belt: str, length_m: float, position: float | None = None) -> str:
        """Put one package on `belt` (`""`: the first entry), and return its id.

        `position` is a share of the belt's length from its start, or None for its entry.

        Raises:
            UnknownLaneError: If there is no such belt.
            NoRoomError: If another package is in the way, or it is too long.
        """
        self.changes += 1
        return self._infeed.add(kind, belt or self._entries[0], length_m, position)

    def reset(self) -> None:
        """Remove all packages, set the counts to 0 and restart the feeders; paused ones stay paused."""
        self._traffic.clear()
        self._dispatch.reset()
        self._infeed.fed = 0
        self._restart_feeders()
        self._fill()
        self.changes += 1

    def snapshot(self) -> dict[str, Any]:
        """Return all state besides the map and the configuration, as JSON values."""
        traffic = self._traffic
        dispatch = self._dispatch
        infeed = self._infeed
        counts = [[*key, *counted] for key, counted in dispatch.counts.items()]
        departures = [departure.model_dump() for departure in dispatch.departures]
        packages = [package.to_state() for package in traffic.packages]
        return {
            "prefix": infeed.prefix,
            "ids": infeed.ids,
            "fed": infeed.fed,
            "left": dispatch.left,
            "refused": dispatch.refused,
            "counts": counts,
            "departures": departures,
            "speed_mps": self._speed_mps,
            "own_speeds": dict(self._own_speeds),
            "is_reverse": dict(infeed.is_reverse),
            **self._feeders.to_state(),
            "packages": packages,
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Restore the plant that made the snapshot `snapshot` of the same map and configuration."""
        traffic = self._traffic
        dispatch = self._dispatch
        infeed = self._infeed
        traffic.clear()
        infeed.prefix = snapshot["prefix"]
        infeed.ids = snapshot["ids"]
        infeed.fed = snapshot["fed"]
        dispatch.left = snapshot["left"]
        dispatch.refused = snapshot["refused"]
        dispatch.counts = {
            (bay, kind): (count, selected) for bay, kind, count, selected in snapshot["counts"]
        }
        dispatch.departures.extend(Departure(**values) for values in snapshot["departures"])

        # Speeds before the packages, whose own speeds a change would update
        self._run_at(snapshot["speed_mps"])
        for belt, speed_mps in snapshot["own_speeds"].items():
            self.set_speed(speed_mps, (belt,))
        infeed.is_reverse = dict(snapshot["is_reverse"])
        self._feeders.resume(snapshot)
        packages = [Package.from_state(values) for values in snapshot["packages"]]
        traffic.restore(packages)
        dispatch.selected = {package.id: package.user for package in traffic.packages if package.user}

    def _run_at(self, speed_mps: float) -> None:
        self._speed_mps = speed_mps
        self._own_speeds.clear()
        for belt in self.network.lines:
            self._turn(belt, speed_mps)
        self.changes += 1

    def _restart_feeders(self) -> None:
        self._feeders.restart()
        if self._feeders.schedule is not None:
            self._run_at(self._feeders.schedule.step.speed_mps)

    def _turn(self, belt: str, speed_mps: float) -> None:
        self._traffic.set_speed(belt, speed_mps)
        self._infeed.turn(belt, speed_mps)

    def _fill(self) -> None:
        initial = self.config.feeder.initial
        has_other_feeders = self._feeders.schedule is not None or bool(self.config.feeders)
        if initial and not has_other_feeders:
            for feeder in self._feeders.active:  # one, unless paused
                self._infeed.fill(feeder, initial)

    def _advance(self, elapsed_s: float) -> list[SelectionEvent]:
        """Move packages, feeders and schedule by one step. Return the events of packages that left."""
        events: list[SelectionEvent] = []
        for package in self._traffic.move(elapsed_s):
            bay = self._bay_at(package)
            events.append(self._dispatch.leave(package, bay, self.now_ns))
        for feeder in self._feeders.active:
            feeder.tick(elapsed_s)
        schedule = self._feeders.schedule
        if schedule is not None:
            previous_index = schedule.index
            if schedule.tick(elapsed_s):
                self._run_at(schedule.step.speed_mps)
            self.changes += schedule.index != previous_index
        return events

    def _bay_at(self, package: Package) -> str:
        """Return the bay at which a package has left, or `""` at another end of a belt."""
        piece = self.network.pieces[package.piece]
        return "" if self._traffic.speeds[piece.belt] < 0.0 else piece.bay
