"""Timed steps with speeds and feeders, from the ROS toolkit's `feeders_*.yaml` as they are."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from pointit.runtime.config.validation_message import describe_validation_error
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.feeding.feed import Feeder, FeedSpec


def _number_of_kind(value: object) -> object:
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


_Kind = Annotated[str, BeforeValidator(_number_of_kind)]
_Share = Annotated[float, Field(ge=0, le=1e6)]
_Interval = Annotated[float, Field(gt=0, le=3600)]


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class FeederEntry(_Entry):
    """One feeder in one step."""

    random: bool = False
    pack_proba: dict[_Kind, _Share] = {}
    kind_sequence: tuple[_Kind, ...] = ()
    min_interval: _Interval
    max_interval: _Interval


class StepEntry(_Entry):
    """One step; `feed: False` lets the belts run empty, whether feeders were told to rest or not."""

    speed: Annotated[float, Field(ge=-10, le=10)]
    duration: Annotated[float, Field(gt=0, le=86400)]
    feed: bool = True
    feeders: dict[str, FeederEntry] = {}


class ScheduleFile(_Entry):
    """The file as a whole; the steps follow each other as they stand there."""

    steps: Annotated[dict[_Kind, StepEntry], Field(min_length=1)]


def read_schedule(path: Path) -> ScheduleFile:
    """Return the schedule in a file.

    Raises:
        ConfigError: it cannot be read or used; names the file, the field and the value.
    """
    try:
        return ScheduleFile.model_validate(read_yaml(path))
    except ValidationError as error:
        raise ConfigError(f"{path}: {describe_validation_error(error, ScheduleFile)}") from error


@dataclass(frozen=True)
class Step:
    """A step with its feeders."""

    name: str
    speed_mps: float
    duration_s: float
    feeders: tuple[Feeder, ...]


class Schedule:
    """Goes through the steps once; after the last one nothing is fed and the speed stays."""

    def __init__(self, steps: Sequence[Step]) -> None:
        """Begin with the first of `steps`, at least one."""
        self._steps = tuple(steps)
        self.restart()

    def restart(self) -> None:
        """Begin again."""
        self.index = 0
        self.left_s = self._steps[0].duration_s
        """Time until the step ends, s; without end after the last one."""
        for step in self._steps:
            for feeder in step.feeders:
                feeder.restart()

    @property
    def count(self) -> int:
        """Return how many steps there are."""
        return len(self._steps)

    @property
    def step(self) -> Step:
        """Return the step that goes on, or the last one."""
        return self._steps[min(self.index, len(self._steps) - 1)]

    @property
    def name(self) -> str:
        """Return the name of the step, `end` after the last one."""
        return "end" if self.is_over else self.step.name

    @property
    def is_over(self) -> bool:
        """Return True if all steps are over."""
        return self.index >= len(self._steps)

    @property
    def feeders(self) -> tuple[Feeder, ...]:
        """Return what feeds now."""
        return () if self.is_over else self.step.feeders

    def tick(self, elapsed_s: float) -> bool:
        """Let time go by, no more than is left of the step. Return True if another step begins."""
        self.left_s -= elapsed_s
        if self.is_over or self.left_s > 0.5e-9:
            return False
        self.index += 1
        self.left_s = math.inf if self.is_over else self.step.duration_s
        return not self.is_over

    def resume(self, index: int, left_s: float) -> None:
        """Go on from where another one was."""
        self.index = index
        self.left_s = left_s if index < len(self._steps) else math.inf


def scheduled(config: ConveyorSimConfig, belts: Mapping[str, object], seed: int) -> Schedule | None:
    """Return the schedule that `config` names for `belts`; none if it names none.

    Raises:
        ConfigError: the file cannot be used, a feeder has no belt, or a kind's number no name.
    """
    if not config.schedule:
        return None
    path = Path(config.schedule).expanduser()
    file = read_schedule(path)
    return Schedule(
        [_step(path, name, entry, config, belts=belts, seed=seed) for name, entry in file.steps.items()]
    )


def check_schedule(config: ConveyorSimConfig) -> None:
    """Refuse a schedule that no map could make sense of.

    Raises:
        ConfigError: names the file, the step and what to do.
    """
    if config.schedule:
        path = Path(config.schedule).expanduser()
        for name, entry in read_schedule(path).steps.items():
            for feeder_name, feeder in entry.feeders.items():
                _supply(f"{path}: step {name}, feeder {feeder_name!r}", feeder, config)


def _step(
    path: Path,
    name: str,
    entry: StepEntry,
    config: ConveyorSimConfig,
    *,
    belts: Mapping[str, object],
    seed: int,
) -> Step:
    feeders: list[Feeder] = []
    for feeder_name, feeder in entry.feeders.items():
        where = f"{path}: step {name}, feeder {feeder_name!r}"
        belt = _belt(where, feeder_name, config, belts)
        supply = _supply(where, feeder, config)
        if entry.feed:
            feeders.append(Feeder(f"{name}/{feeder_name}", (belt,), supply, seed=seed))
    return Step(name, entry.speed, entry.duration, tuple(feeders))


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
