"""All feeders of a conveyor, from its configuration or of a schedule's steps: they give packages, or rest."""

from collections.abc import Mapping, Sequence
from typing import Any

from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.feeding.feed import Feeder, configured
from pointit.services.conveyor_sim.feeding.schedule import scheduled


class Feeders:
    """Those of the configuration, or else of the schedule's step that goes on.

    While they rest their time stands still, so nothing piles up. The schedule goes on either way, with its
    speeds: a package comes when they are on and the step has a feeder.
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
        """Feed `entries` in turn unless `config` says which of `belts`; `is_on`: do not rest.

        Raises:
            ConfigError: the schedule cannot be used.
        """
        self.is_on = is_on
        """Otherwise they rest."""
        self.schedule = scheduled(config, belts, seed)
        self._configured = configured(config, entries, seed)

    @property
    def all(self) -> Sequence[Feeder]:
        """Return those there are now, whether they rest or not."""
        return self._configured if self.schedule is None else self.schedule.feeders

    @property
    def active(self) -> Sequence[Feeder]:
        """Return those that do not rest."""
        return self.all if self.is_on else ()

    def restart(self) -> None:
        """Begin again, with the schedule; those that rest, rest on."""
        for feeder in self._configured:
            feeder.restart()
        if self.schedule is not None:
            self.schedule.restart()

    def to_state(self) -> dict[str, Any]:
        """Return where they are, as what JSON can hold."""
        schedule = self.schedule
        return {
            "feeding": self.is_on,
            "feeders": [[feeder.taken, feeder.due_s] for feeder in self.all],
            "step": None if schedule is None or schedule.is_over else [schedule.index, schedule.left_s],
        }

    def resume(self, kept: Mapping[str, Any]) -> None:
        """Go on from where those were that `kept` was made of."""
        if self.schedule is not None:
            index, left_s = kept["step"] or (self.schedule.count, 0.0)
            self.schedule.resume(index, left_s)
        for feeder, (taken, due_s) in zip(self.all, kept["feeders"], strict=True):
            feeder.taken, feeder.due_s = taken, due_s
        self.is_on = kept.get("feeding", True)  # what an older program has kept never rested
