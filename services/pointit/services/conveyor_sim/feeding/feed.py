"""Feeders: kinds, belts and times of the packages to feed."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pointit.services.conveyor_sim.config import ConveyorSimConfig


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
        """Return the next package's kind and start the interval to the one after it.

        Raises:
            ValueError: If there is nothing more to feed.
        """
        if self.is_done:
            raise ValueError("there is nothing more to feed")
        supply = self.supply
        if supply.probabilities:
            kinds = list(supply.probabilities)
            weights = list(supply.probabilities.values())
            kind = random.Random(self._key("kind")).choices(kinds, weights)[0]  # noqa: S311 - not for secrets
        else:
            kind = supply.sequence[self.taken % len(supply.sequence)]
        spread_s = supply.max_interval_s - supply.min_interval_s
        self.due_s = supply.min_interval_s + (self._chance("interval") * spread_s if spread_s else 0.0)
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
        named = config.feeders.items()
        supplies = {name: FeedSpec(**feeder.model_dump(exclude={"belt"})) for name, feeder in named}
        return [Feeder(name, (feeder.belt,), supplies[name], seed=seed) for name, feeder in named]
    feeder = config.feeder
    supply = FeedSpec(
        sequence=feeder.sequence,
        min_interval_s=feeder.interval_s,
        max_interval_s=feeder.interval_s,
        length_m=feeder.length_m,
        count=feeder.count,
    )
    return [Feeder("feeder", entries, supply, seed=seed)]
