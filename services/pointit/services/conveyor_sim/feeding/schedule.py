"""Feeders by configuration or by timed steps with speeds, as in `feeders_*.yaml` of the ROS toolkit."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pointit.runtime.config.config import validate
from pointit.runtime.config.validation_message import describe_validation_error
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import expand_home
from pointit.services.conveyor_sim.config import ConveyorSimConfig, KindNumber
from pointit.services.conveyor_sim.feeding.feed import Feeder, FeedSpec, configured

END = "end"
"""Name of the step after the last one, when nothing more is fed."""

_Share = Annotated[float, Field(ge=0, le=1e6)]
_Interval = Annotated[float, Field(gt=0, le=3600)]


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
            where = f"{path}: step {name}, feeder {feeder_name!r}"
            belt = _belt(where, feeder_name, config, belts)
            supply = _supply(where, feeder, config)
            if entry.feed:
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


def _belt(where: str, name: str, config: ConveyorSimConfig, belts: Mapping[str, object]) -> str:
    wanted = (
        (config.feeder_belts[name],)
        if name in config.feeder_belts
        else (name, f"belt_{name}", f"part_{name}")
    )
    for belt in wanted:
        if belt in belts:
            return belt
    raise ConfigError(
        f"{where}: the map has no belt {' or '.join(wanted)}, there are {', '.join(belts) or 'none'}; "
        f"set feeder_belts: {{{name}: BELT}}"
    )


def _supply(where: str, entry: FeederEntry, config: ConveyorSimConfig) -> FeedSpec:
    def kind(number: str) -> str:
        if number not in config.kinds:
            raise ConfigError(f"{where}: kind {number} has no name; set kinds: {{{number}: NAME}}")
        return config.kinds[number]

    if entry.min_interval > entry.max_interval:
        raise ConfigError(
            f"{where}: min_interval {entry.min_interval:g} is above max_interval {entry.max_interval:g}"
        )
    if entry.random and not sum(entry.pack_proba.values()):
        raise ConfigError(f"{where}: it feeds at random, but pack_proba has no number above 0")
    return FeedSpec(
        sequence=() if entry.random else tuple(kind(number) for number in entry.kind_sequence),
        probabilities={kind(n): p for n, p in entry.pack_proba.items()} if entry.random else None,
        min_interval_s=entry.min_interval,
        max_interval_s=entry.max_interval,
        length_m=config.schedule_length_m,
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
            has_ended = any(each.taken for each in self.all) and all(each.is_done for each in self.all)
            return END if has_ended else ""
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
        schedule = self.schedule
        return {
            "feeding": self.is_on,
            "feeders": [[feeder.taken, feeder.due_s] for feeder in self.all],
            "step": None if schedule is None or schedule.is_over else [schedule.index, schedule.left_s],
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Continue from the state `state`."""
        if self.schedule is not None:
            index, left_s = state["step"] or (self.schedule.count, 0.0)
            self.schedule.resume(index, left_s)
        for feeder, (taken, due_s) in zip(self.all, state["feeders"], strict=True):
            feeder.taken, feeder.due_s = taken, due_s
        self.is_on = state.get("feeding", True)  # older versions could not pause
