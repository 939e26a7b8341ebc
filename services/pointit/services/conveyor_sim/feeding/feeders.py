"""All feeders of a conveyor, from its configuration or from a schedule's steps; they can be paused."""

from collections.abc import Mapping, Sequence
from typing import Any

from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.feeding.feed import Feeder, configured
from pointit.services.conveyor_sim.feeding.schedule import scheduled


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
