"""Feeding of a conveyor: which packages enter when, by configuration or timed steps."""

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pointit.runtime.config.config import validate
from pointit.runtime.config.validation_message import describe_validation_error
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import expand_home
from pointit.services.conveyor_sim.config import SCHEDULE_LENGTH_M, ConveyorSimConfig, KindNumber
from pointit.services.conveyor_sim.network import Piece
from pointit.services.conveyor_sim.traffic import TOLERANCE_M, Package, Traffic

_Share = Annotated[float, Field(ge=0, le=1e6)]
_Interval = Annotated[float, Field(gt=0, le=3600)]

END = "end"
"""Name of the step after the last one, when nothing more is fed."""
ROUNDING_S = 0.5e-9
"""Times are whole nanoseconds; sums of their floats are off by less than half a nanosecond."""


@dataclass(frozen=True, kw_only=True)
class FeedSpec:
    """Packages of a feeder and their intervals."""

    sequence: tuple[str, ...] = ()
    """Kinds, repeated in this order."""
    probabilities: Mapping[str, float] | None = None
    """Relative frequency of each kind, instead of `sequence`."""
    min_interval_s: float
    max_interval_s: float
    length_m: float
    count: int = 0
    """Number of packages; 0: unlimited."""


class Feeder:
    """Gives one package after the other, to one belt or to several in turn.

    All random values derive from the seed and the number of the package, so `taken` and `due_s` are the whole
    state of a feeder.
    """

    def __init__(self, name: str, belts: Sequence[str], supply: FeedSpec, *, seed: int) -> None:
        """Feed `belts`, at least one; the first wait is a random share of the interval's range."""
        self.name = name
        self.belts = tuple(belts)
        self.supply = supply
        self._seed = seed
        self.restart()

    def restart(self) -> None:
        """Restart with the same packages and intervals as before."""
        self.taken = 0
        """Number of packages taken since the start."""
        spread_s = self.supply.max_interval_s - self.supply.min_interval_s
        self.due_s = self._chance("first") * spread_s
        """Time until the next package, s; 0 while it waits to be taken."""

    @property
    def is_done(self) -> bool:
        """Return True if there is nothing more to feed."""
        supply = self.supply
        has_kinds = bool(supply.sequence or supply.probabilities)
        return not has_kinds or 0 < supply.count <= self.taken

    @property
    def belt(self) -> str:
        """Return the belt that gets the next package."""
        return self.belts[self.taken % len(self.belts)]

    def tick(self, elapsed_s: float) -> None:
        """Advance the time; a package that waits for room does not delay those behind it further."""
        self.due_s = max(0.0, self.due_s - elapsed_s)

    def take(self) -> str:
        """Return the next package's kind and start the interval to the one after it, unless it `is_done`."""
        supply = self.supply
        if supply.probabilities:
            kinds = list(supply.probabilities)
            weights = list(supply.probabilities.values())
            generator = random.Random(self._key("kind"))  # noqa: S311 - not for secrets
            kind = generator.choices(kinds, weights)[0]
        else:
            kind = supply.sequence[self.taken % len(supply.sequence)]

        # The interval belongs to this package: its number is counted afterwards
        spread_s = supply.max_interval_s - supply.min_interval_s
        random_s = self._chance("interval") * spread_s if spread_s else 0.0
        self.due_s = supply.min_interval_s + random_s
        self.taken += 1
        return kind

    def _key(self, purpose: str) -> str:
        return f"{self._seed}/{self.name}/{self.taken}/{purpose}"

    def _chance(self, purpose: str) -> float:
        return random.Random(self._key(purpose)).random()  # noqa: S311 - not for secrets


def configured(config: ConveyorSimConfig, entries: Sequence[str], seed: int) -> list[Feeder]:
    """Return the feeders of `config` except those of a schedule; `entries` are the belts fed in turn."""
    if config.schedule:
        return []
    if config.feeders:
        feeders: list[Feeder] = []
        for name, parameters in config.feeders.items():
            supply = FeedSpec(**parameters.model_dump(exclude={"belt"}))
            feeders.append(Feeder(name, (parameters.belt,), supply, seed=seed))
        return feeders
    feeder = config.feeder
    supply = FeedSpec(
        sequence=feeder.sequence,
        min_interval_s=feeder.interval_s,
        max_interval_s=feeder.interval_s,
        length_m=feeder.length_m,
        count=feeder.count,
    )
    return [Feeder("feeder", entries, supply, seed=seed)]


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class FeederEntry(_Entry):
    """One feeder in one step."""

    random: bool = False
    pack_proba: dict[KindNumber, _Share] = {}
    kind_sequence: tuple[KindNumber, ...] = ()
    min_interval: _Interval
    max_interval: _Interval


class StepEntry(_Entry):
    """One step; `feed: False` lets the belts run empty even if the feeders are on."""

    speed: Annotated[float, Field(ge=-10, le=10)]
    duration: Annotated[float, Field(gt=0, le=86400)]
    feed: bool = True
    feeders: dict[str, FeederEntry] = {}


class ScheduleFile(_Entry):
    """A schedule file; the steps run in the order of the file."""

    steps: Annotated[dict[KindNumber, StepEntry], Field(min_length=1)]


def read_schedule(path: Path) -> ScheduleFile:
    """Return the schedule in a file.

    Raises:
        ConfigError: If it cannot be read or used; names the file, the field and the value.
    """
    try:
        return validate(ScheduleFile, read_yaml(path))
    except ValidationError as error:
        raise ConfigError(f"{path}: {describe_validation_error(error, ScheduleFile)}") from error


@dataclass(frozen=True)
class FeedingStep:
    """A step with its feeders."""

    name: str
    speed_mps: float
    duration_s: float
    feeders: tuple[Feeder, ...]


class Schedule:
    """Runs the steps once; after the last one nothing is fed and the speed stays."""

    def __init__(self, steps: Sequence[FeedingStep]) -> None:
        """Start with the first of `steps`, at least one."""
        self._steps = tuple(steps)
        self.restart()

    def restart(self) -> None:
        """Restart from the first step."""
        self.index = 0
        self.left_s = self._steps[0].duration_s
        """Time until the step ends, s; infinite after the last one."""
        for step in self._steps:
            for feeder in step.feeders:
                feeder.restart()

    @property
    def count(self) -> int:
        """Return the number of steps."""
        return len(self._steps)

    @property
    def step(self) -> FeedingStep:
        """Return the current step, or the last one."""
        return self._steps[min(self.index, len(self._steps) - 1)]

    @property
    def is_over(self) -> bool:
        """Return True if all steps are over."""
        return self.index >= len(self._steps)

    @property
    def feeders(self) -> tuple[Feeder, ...]:
        """Return the current feeders."""
        return () if self.is_over else self.step.feeders

    def tick(self, elapsed_s: float) -> bool:
        """Advance the time, at most to the end of the step. Return True if another step begins."""
        self.left_s -= elapsed_s
        if self.is_over or self.left_s > 0.5e-9:
            return False
        self.index += 1
        self.left_s = math.inf if self.is_over else self.step.duration_s
        return not self.is_over

    def resume(self, index: int, left_s: float) -> None:
        """Continue from a saved position."""
        self.index = index
        self.left_s = left_s if index < len(self._steps) else math.inf


def scheduled(config: ConveyorSimConfig, belts: Mapping[str, object], seed: int) -> Schedule | None:
    """Return the schedule that `config` names for `belts`, or None if it names none.

    Raises:
        ConfigError: If the file cannot be used, or a feeder's belt or a kind's name is missing.
    """
    if not config.schedule:
        return None
    path = expand_home(config.schedule)
    steps: list[FeedingStep] = []
    for name, entry in read_schedule(path).steps.items():
        feeders: list[Feeder] = []
        for feeder_name, feeder in entry.feeders.items():
            place = f"{path}: step {name}, feeder {feeder_name!r}"
            belt = _belt(place, feeder_name, config, belts)
            supply = _supply(place, feeder, config)
            if entry.feed:  # checked even if not
                feeders.append(Feeder(f"{name}/{feeder_name}", (belt,), supply, seed=seed))
        steps.append(FeedingStep(name, entry.speed, entry.duration, tuple(feeders)))
    return Schedule(steps)


def check_schedule(config: ConveyorSimConfig) -> None:
    """Check the parts of a schedule that do not depend on a map.

    Raises:
        ConfigError: If it cannot be used. The message has the file, the step and the remedy.
    """
    if config.schedule:
        path = expand_home(config.schedule)
        for name, entry in read_schedule(path).steps.items():
            for feeder_name, feeder in entry.feeders.items():
                _supply(f"{path}: step {name}, feeder {feeder_name!r}", feeder, config)


def _belt(place: str, name: str, config: ConveyorSimConfig, belts: Mapping[str, object]) -> str:
    """Return the belt of the feeder `name` of a schedule. `place` is for the message if there is none."""
    candidates = (name, f"belt_{name}", f"part_{name}")
    if name in config.feeder_belts:
        candidates = (config.feeder_belts[name],)
    for belt in candidates:
        if belt in belts:
            return belt
    existing = ", ".join(belts) or "none"
    raise ConfigError(
        f"{place}: the map has no belt {' or '.join(candidates)}, there are {existing}; "
        f"set feeder_belts: {{{name}: BELT}}"
    )


def _supply(place: str, entry: FeederEntry, config: ConveyorSimConfig) -> FeedSpec:
    """Return the packages of a feeder of a schedule, checked. `place` is for messages about errors."""

    def kind(number: str) -> str:
        if number not in config.kinds:
            raise ConfigError(f"{place}: kind {number} has no name; set kinds: {{{number}: NAME}}")
        return config.kinds[number]

    if entry.min_interval > entry.max_interval:
        raise ConfigError(
            f"{place}: min_interval {entry.min_interval:g} is above max_interval {entry.max_interval:g}"
        )
    if entry.random and not sum(entry.pack_proba.values()):
        raise ConfigError(f"{place}: it feeds at random, but pack_proba has no number above 0")

    # Random kinds or a sequence; the other one is ignored
    sequence: tuple[str, ...] = ()
    probabilities: dict[str, float] | None = None
    if entry.random:
        probabilities = {kind(number): share for number, share in entry.pack_proba.items()}
    else:
        sequence = tuple(kind(number) for number in entry.kind_sequence)
    return FeedSpec(
        sequence=sequence,
        probabilities=probabilities,
        min_interval_s=entry.min_interval,
        max_interval_s=entry.max_interval,
        length_m=SCHEDULE_LENGTH_M,
    )


class Feeders:
    """Feeders of the configuration, or of the schedule's current step.

    While they pause their time stands still, so nothing piles up. The schedule continues with its speeds: a
    package comes if they are on and the step has a feeder.
    """

    def __init__(
        self,
        config: ConveyorSimConfig,
        *,
        entries: Sequence[str],
        belts: Mapping[str, object],
        seed: int,
        is_on: bool,
    ) -> None:
        """Feed `entries` in turn unless `config` names some of `belts`; they pause unless `is_on`.

        Raises:
            ConfigError: If the schedule cannot be used.
        """
        self.is_on = is_on
        """False while they pause."""
        self.schedule = scheduled(config, belts, seed)
        self._configured = configured(config, entries, seed)

    @property
    def step(self) -> str:
        """Return the name of the schedule's step, `""` without one, `end` after the last package or step."""
        if self.schedule is None:
            has_begun = any(feeder.taken for feeder in self.all)
            are_done = all(feeder.is_done for feeder in self.all)
            return END if has_begun and are_done else ""
        return END if self.schedule.is_over else self.schedule.step.name

    @property
    def all(self) -> Sequence[Feeder]:
        """Return the current feeders, paused or not."""
        return self._configured if self.schedule is None else self.schedule.feeders

    @property
    def active(self) -> Sequence[Feeder]:
        """Return the feeders that are not paused."""
        return self.all if self.is_on else ()

    def restart(self) -> None:
        """Restart the feeders and the schedule; paused ones stay paused."""
        for feeder in self._configured:
            feeder.restart()
        if self.schedule is not None:
            self.schedule.restart()

    def to_state(self) -> dict[str, Any]:
        """Return the state as JSON values."""
        step: list[float] | None = None
        if self.schedule is not None and not self.schedule.is_over:
            step = [self.schedule.index, self.schedule.left_s]
        feeders = [[feeder.taken, feeder.due_s] for feeder in self.all]
        return {"feeding": self.is_on, "feeders": feeders, "step": step}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Continue from the state `state`."""
        if self.schedule is not None:
            index, left_s = state["step"] or (self.schedule.count, 0.0)
            self.schedule.resume(index, left_s)
        for feeder, (taken, due_s) in zip(self.all, state["feeders"], strict=True):
            feeder.taken = taken
            feeder.due_s = due_s
        self.is_on = state["feeding"]


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
                belt = feeder.belt
                length_m = feeder.supply.length_m
                if self._wait_m(belt, length_m) > 0.0:
                    break
                self._enter(feeder.take(), belt, length_m)
                is_fed = True
        return is_fed

    def next_s(self, feeders: Sequence[Feeder]) -> float:
        """Return the time until the next package can be fed at the current speeds, s."""
        next_s = math.inf
        for feeder in feeders:
            if not feeder.is_done:
                room_s = self._room_in_s(feeder.belt, feeder.supply.length_m)
                next_s = min(next_s, max(feeder.due_s, room_s))
        return next_s

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

        # At a position of its own
        if position is not None:
            at_m = position * self._network.lines[belt].length_m
            piece, offset_m = self._network.at(belt, at_m)
            if not self._traffic.is_clear(piece, offset_m, length_m):
                raise NoRoomError(
                    f"lane {belt!r} has no room for {length_m:g} m at {at_m:.2f} m: ask again later"
                )
            package = self._package(kind, length_m)
            self._place_on_piece(package, piece, offset_m)
            return package.id

        # At the entry
        wait_m = self._wait_m(belt, length_m)
        if wait_m > 0.0:
            remedy = self._room_remedy(belt, wait_m)
            raise NoRoomError(f"lane {belt!r} has no room for {length_m:g} m now, {remedy}")
        return self._enter(kind, belt, length_m).id

    def _room_remedy(self, belt: str, wait_m: float) -> str:
        """Return when `belt`, which must move by `wait_m`, has room, or what to do for it."""
        speed_mps = self._traffic.speeds[belt]
        if not speed_mps:
            return f"{wait_m:.2f} m are missing; the conveyor stands still: set a speed first"
        if not math.isfinite(wait_m):
            return "it runs backwards and cannot be fed: set another speed first"
        wait_s = wait_m / abs(speed_mps)
        return f"{wait_m:.2f} m are missing; ask again in {wait_s:.1f} s"

    def fill(self, feeder: Feeder, initial: int) -> None:
        """Put on up to `initial` packages, as far as there is room, the first of each belt furthest along."""
        # Each belt in turn gets a package, until one is full
        length_m = feeder.supply.length_m
        belt_lengths_m = [self._network.lines[belt].length_m for belt in feeder.belts]
        rooms = [int(belt_length_m / length_m) for belt_length_m in belt_lengths_m]
        fills: list[list[Package]] = [[] for _ in feeder.belts]
        for index in range(initial):
            turn = index % len(feeder.belts)
            if feeder.is_done or len(fills[turn]) >= rooms[turn]:
                break
            fills[turn].append(self._package(feeder.take(), length_m))

        # They lie evenly spaced from the belt's start on, in the order in which they would have come
        for belt, belt_length_m, packages in zip(feeder.belts, belt_lengths_m, fills, strict=True):
            spacing_m = belt_length_m / max(1, len(packages))
            if not self.is_reverse[belt]:
                packages.reverse()
            for index, package in enumerate(packages):
                piece, offset_m = self._network.at(belt, (index + 0.5) * spacing_m)
                if self._traffic.is_clear(piece, offset_m, length_m):
                    self._place_on_piece(package, piece, offset_m)
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
        piece, offset_m = self._entry(belt)
        self._place_on_piece(package, piece, offset_m)
        return package

    def _package(self, kind: str, length_m: float) -> Package:
        self.ids += 1
        self.fed += 1
        return Package(f"{self.prefix}-{self.ids}", kind, length_m)

    def _place_on_piece(self, package: Package, piece: Piece, offset_m: float) -> None:
        package.piece = piece.index
        self._send(package)
        self._traffic.put(package, piece, offset_m)

    def _entry(self, belt: str) -> tuple[Piece, float]:
        sections = self._network.sections[belt]
        if self.is_reverse[belt]:
            return sections[-1], sections[-1].to_m
        return sections[0], 0.0

    def _wait_m(self, belt: str, length_m: float) -> float:
        """Return the distance that `belt` must move until a package fits at the entry; 0: now."""
        if self.is_reverse[belt] and belt in self._network.linked:
            return math.inf
        piece, offset_m = self._entry(belt)
        return self._traffic.wait_m(piece, offset_m, length_m)

    def _room_in_s(self, belt: str, length_m: float) -> float:
        wait_m = self._wait_m(belt, length_m)
        if wait_m <= TOLERANCE_M:
            return 0.0
        speed_mps = abs(self._traffic.speeds[belt])
        return wait_m / speed_mps if speed_mps else math.inf
