"""Parameters of the simulated conveyor."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from pointit.runtime.config.config import Config

SCHEDULE_LENGTH_M = 0.3
"""Length of the packages that a schedule feeds, m."""


def _text(value: object) -> object:
    is_number = isinstance(value, int) and not isinstance(value, bool)
    return str(value) if is_number else value


KindNumber = Annotated[str, BeforeValidator(_text)]
"""Number of a kind in a schedule, which YAML reads as an integer."""


class FeederConfig(Config):
    """Packages that are fed to the lanes in turn, and their interval."""

    sequence: tuple[str, ...] = Field(
        default=("red", "green", "blue"),
        description="kinds of the objects fed, repeated in this order; if empty, nothing is fed",
    )
    interval_s: float = Field(default=2.0, gt=0, le=3600, description="from one object to the next, s")
    length_m: float = Field(default=0.3, gt=0, le=5, description="length of the objects fed, m")
    count: int = Field(
        default=0, ge=0, description="number of objects fed, including initial ones; 0: unlimited"
    )
    initial: int = Field(
        default=0, ge=0, le=10_000, description="number of objects at the start, evenly spaced"
    )


class NamedFeederConfig(Config):
    """A feeder at the start of one belt."""

    belt: str = Field(description="id of the belt at whose start it feeds")
    sequence: tuple[str, ...] = Field(
        default=(), description="kinds, repeated in this order; or give probabilities"
    )
    probabilities: dict[str, float] = Field(
        default={}, description="relative frequency by kind; or give a sequence"
    )
    min_interval_s: float = Field(
        default=4.0, gt=0, le=3600, description="shortest time from one package to the next, s"
    )
    max_interval_s: float = Field(
        default=7.0, gt=0, le=3600, description="longest time from one package to the next, s"
    )
    length_m: float = Field(default=0.3, gt=0, le=5, description="length of the packages, m")
    count: int = Field(default=0, ge=0, description="number of packages fed; 0: unlimited")

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        if bool(self.sequence) == bool(self.probabilities):
            raise ValueError("give a sequence of kinds or their probabilities, one of both")
        if self.probabilities:
            frequencies = self.probabilities.values()
            if not min(frequencies) >= 0 < sum(frequencies):
                raise ValueError("probabilities must not be negative, and one of them must be above 0")
        if self.min_interval_s > self.max_interval_s:
            raise ValueError("min_interval_s must not be above max_interval_s")
        return self


class TrackingConfig(Config):
    """Faults of a simulated tracker; the default has none."""

    latency_s: float = Field(
        default=0.0, ge=0, le=5, description="age of a report's content and stamp when it is published, s"
    )


class ConveyorSimConfig(Config):
    """Moving belts and their speeds, feeders, bays, tracker and storage."""

    REPLACED: ClassVar[tuple[str, ...]] = ("feeders",)

    surface: Literal["strip", "belt"] = Field(
        default="belt", description="belt: the map's belts; strip: its LED strips, used as belts"
    )
    lanes: tuple[str, ...] = Field(
        default=(), description="ids of the belts or strips of the map that move; all of them if empty"
    )
    speed_mps: float = Field(
        default=0.5, ge=-10, le=10, description="speed at the start, m/s; negative: towards the lines' starts"
    )
    rate_hz: float = Field(default=25.0, gt=0, le=200, description="rate of the objects' reports, Hz")
    seed: int = Field(default=0, ge=0, description="seed of all random number generators")
    bay_selected: str = Field(default="1", description="bay of the map for selected packages")
    bay_rest: str = Field(default="3", description="bay of the map for all other packages")
    longest_m: float = Field(
        default=0.4,
        gt=0,
        le=5,
        description="longest package on a network of belts, m; junctions are kept clear that far",
    )
    feeder: FeederConfig = Field(
        default=FeederConfig(), description="feeder of the lanes in turn, without `feeders` and `schedule`"
    )
    feeders: dict[str, NamedFeederConfig] = Field(
        default={}, description="feeders by name, instead of `feeder`; those of a file replace the scenario's"
    )
    schedule: str = Field(
        default="", description="file of timed steps with speeds and feeders (the ROS toolkit's feeders_*)"
    )
    kinds: dict[KindNumber, str] = Field(
        default={"0": "blue", "1": "red"}, description="kind by its number in a schedule"
    )
    feeder_belts: dict[str, str] = Field(
        default={}, description="belts of a schedule's feeders; default: the feeder's name, or belt_, part_"
    )
    tracking: TrackingConfig = Field(default=TrackingConfig(), description="faults of the tracker")

    @property
    def longest_fed_m(self) -> float:
        """Return the length of packages for which junctions are laid out, m."""
        lengths = [self.longest_m, *(feeder.length_m for feeder in self.feeders.values())]
        if self.schedule:
            lengths.append(SCHEDULE_LENGTH_M)
        elif not self.feeders and self.feeder.sequence:
            lengths.append(self.feeder.length_m)
        return max(lengths)
