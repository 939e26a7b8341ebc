"""What is fed next, where and when."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pointit.services.conveyor_sim.config import ConveyorSimConfig


@dataclass(frozen=True, kw_only=True)
class FeedSpec:
    """What a feeder has to give, and how often."""

    sequence: tuple[str, ...] = ()
    """Kinds in this order, over and over."""
    probabilities: Mapping[str, float] | None = None
    """Instead: how often each kind comes, relative to the others."""
    min_interval_s: float
    max_interval_s: float
    length_m: float
    count: int = 0
    """In all; 0: without end."""


class Feeder:
    """Gives one package after the other, to one belt or to several in turn.

    Everything random comes from the seed and the number of the package: a feeder is told by `taken` and
    `due_s` alone.
    """

    def __init__(self, name: str, belts: Sequence[str], supply: FeedSpec, *, seed: int) -> None:
        """Feed `belts`, at least one; the first package comes after what intervals may differ by."""
        self.name = name
        self.belts = tuple(belts)
        self.supply = supply
        self._seed = seed
        self.restart()

    def restart(self) -> None:
        """Begin again: the same packages as before, after the same intervals."""
        self.taken = 0
        """Packages taken since the start."""
        spread_s = self.supply.max_interval_s - self.supply.min_interval_s
        self.due_s = self._chance("first") * spread_s
        """Time until the next package, s; 0 when it waits to be taken."""

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
        """Let time go by; a package that waits for room does not pile up others behind it."""
        self.due_s = max(0.0, self.due_s - elapsed_s)

    def take(self) -> str:
        """Return the next package's kind; the one after it is due an interval from now.

        Raises:
            ValueError: there is nothing more to feed.
        """
        if self.is_done:
            raise ValueError("there is nothing more to feed")
        supply = self.supply
        if supply.probabilities:
            kinds = list(supply.probabilities)
            weights = list(supply.probabilities.values())
            kind = random.Random(self._key("kind")).choices(kinds, weights)[0]  # noqa: S311 - packages, no secrets
        else:
            kind = supply.sequence[self.taken % len(supply.sequence)]
        spread_s = supply.max_interval_s - supply.min_interval_s
        self.due_s = supply.min_interval_s + (self._chance("interval") * spread_s if spread_s else 0.0)
        self.taken += 1
        return kind

    def _key(self, purpose: str) -> str:
        return f"{self._seed}/{self.name}/{self.taken}/{purpose}"

    def _chance(self, purpose: str) -> float:
        return random.Random(self._key(purpose)).random()  # noqa: S311 - packages, no secrets


def configured(config: ConveyorSimConfig, entries: Sequence[str], seed: int) -> list[Feeder]:
    """Return the feeders of `config` but for those of a schedule; `entries` are the belts fed in turn."""
    if config.schedule:
        return []
    if config.feeders:
        return [
            Feeder(
                name,
                (feeder.belt,),
                FeedSpec(
                    sequence=feeder.sequence,
                    probabilities=feeder.probabilities,
                    min_interval_s=feeder.min_interval_s,
                    max_interval_s=feeder.max_interval_s,
                    length_m=feeder.length_m,
                    count=feeder.count,
                ),
                seed=seed,
            )
            for name, feeder in config.feeders.items()
        ]
    feeder = config.feeder
    supply = FeedSpec(
        sequence=feeder.sequence,
        min_interval_s=feeder.interval_s,
        max_interval_s=feeder.interval_s,
        length_m=feeder.length_m,
        count=feeder.count,
    )
    return [Feeder("feeder", entries, supply, seed=seed)]
