"""Saving of a conveyor's state, and its restoration after a restart."""

from collections.abc import Sequence
from pathlib import Path

from pointit.schemas import NS_PER_S, SelectionEvent
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.plant import Plant
from pointit.services.conveyor_sim.store.snapshot_store import SnapshotError, SnapshotStore

PERIOD_NS = NS_PER_S // 2
"""Longest time between saves."""
BACK_S = 5.0
"""Clock steps back beyond this mean that the stored state is from another run."""


class PlantPersistence:
    """Saves a plant on disk before its events are published. Disk errors only set `problem`."""

    def __init__(self, config: ConveyorSimConfig, folder: Path) -> None:
        """Store in `folder`, which need not exist; opens nothing yet."""
        self.problem = ""
        """Current problem with saving, for users, or `""`."""
        self._config = config
        self._folder = folder
        self._file: SnapshotStore | None = None
        self._saved_ns = 0
        self._changes = -1
        self._plant: Plant | None = None
        self._seq = 0
        """Number of the last event."""

    def resume(
        self, plant: Plant, mark: str, now_ns: int, *, speed: float = 1.0
    ) -> tuple[SelectionEvent, ...]:
        """Open the file and restore `plant` from it if it fits. Return events that may be unpublished.

        `speed`: seconds of the clock per second of wall time.
        """
        config = self._config
        if not config.resume_within_s:
            return ()
        try:
            self._file = SnapshotStore(self._folder)
        except SnapshotError as error:
            self.problem = str(error)
            return ()
        stored = self._file.read()
        if stored is None or stored.fingerprint != mark:
            return ()
        age_s = (now_ns - stored.stamp_ns) / NS_PER_S / speed
        if not -BACK_S <= age_s <= config.resume_within_s:
            return ()
        try:
            plant.restore(stored.snapshot)
        except (LookupError, TypeError, ValueError):  # written by another version
            plant.reset()
            return ()
        self._seq = stored.seq
        return stored.events

    def save(
        self, plant: Plant, mark: str, now_ns: int, events: Sequence[SelectionEvent] = ()
    ) -> list[SelectionEvent]:
        """Number `events`, and save them with `plant` if due. Return the events to publish now."""
        numbered: list[SelectionEvent] = []
        for event in events:
            self._seq += 1
            numbered.append(event.model_copy(update={"seq": self._seq}))
        is_news = bool(events) or plant is not self._plant or plant.changes != self._changes
        if self._file is None or not (is_news or abs(now_ns - self._saved_ns) >= PERIOD_NS):
            return numbered
        try:
            self._file.commit(now_ns, mark, plant.snapshot(), self._seq, numbered)
        except SnapshotError as error:
            self.problem = str(error)
        else:
            self.problem = ""
        self._plant, self._changes, self._saved_ns = plant, plant.changes, now_ns
        return numbered

    def mark_published(self) -> None:
        """Mark the events that `save` returned as published."""
        if self._file is not None:
            try:
                self._file.mark_published()
            except SnapshotError as error:
                self.problem = str(error)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None
