"""When the conveyor writes down what it has, and what it makes of what it finds."""

from collections.abc import Sequence
from pathlib import Path

from pointit.schemas import NS_PER_S, SelectionEvent
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.plant import Plant
from pointit.services.conveyor_sim.store.snapshot_store import SnapshotError, SnapshotStore

PERIOD_NS = NS_PER_S // 2
"""Places are kept so often, whatever happens or does not."""
BACK_S = 5.0
"""A clock that was set back by more is another run's."""


class PlantPersistence:
    """Keeps a plant on disk, before its events are told; a disk that fails is a problem, nothing more."""

    def __init__(self, config: ConveyorSimConfig, folder: Path) -> None:
        """Touch nothing yet; keep in `folder`, which need not exist."""
        self.problem = ""
        """What is wrong with keeping now, a sentence for a person; empty: nothing."""
        self._config = config
        self._folder = folder
        self._file: SnapshotStore | None = None
        self._kept_ns = 0
        self._changes = -1
        self._plant: Plant | None = None
        self._seq = 0
        """Of the last event."""

    def resume(
        self, plant: Plant, mark: str, now_ns: int, *, speed: float = 1.0
    ) -> tuple[SelectionEvent, ...]:
        """Open the file; have `plant` be as it was kept if that fits; return events that may be untold.

        `speed`: how many seconds of the clock pass in one of the wall.
        """
        config = self._config
        if not config.resume_within_s:
            return ()
        try:
            self._file = SnapshotStore(self._folder)
        except SnapshotError as error:
            self.problem = str(error)
            return ()
        kept = self._file.read()
        if kept is None or kept.fingerprint != mark:
            return ()
        age_s = (now_ns - kept.stamp_ns) / NS_PER_S / speed
        if not -BACK_S <= age_s <= config.resume_within_s:
            return ()
        try:
            plant.restore(kept.snapshot)
        except (LookupError, TypeError, ValueError):  # of another version of this program
            plant.reset()
            return ()
        self._seq = kept.seq
        return kept.events

    def save(
        self, plant: Plant, mark: str, now_ns: int, events: Sequence[SelectionEvent] = ()
    ) -> list[SelectionEvent]:
        """Number `events`, and keep them and `plant` where that is due; return them, to be told now."""
        numbered: list[SelectionEvent] = []
        for event in events:
            self._seq += 1
            numbered.append(event.model_copy(update={"seq": self._seq}))
        is_news = bool(events) or plant is not self._plant or plant.changes != self._changes
        if self._file is None or not (is_news or abs(now_ns - self._kept_ns) >= PERIOD_NS):
            return numbered
        try:
            self._file.commit(now_ns, mark, plant.snapshot(), self._seq, numbered)
        except SnapshotError as error:
            self.problem = str(error)
        else:
            self.problem = ""
        self._plant, self._changes, self._kept_ns = plant, plant.changes, now_ns
        return numbered

    def mark_published(self) -> None:
        """Take note that what `save` returned has been told."""
        if self._file is not None:
            try:
                self._file.mark_published()
            except SnapshotError as error:
                self.problem = str(error)

    def close(self) -> None:
        """Let go of the file."""
        if self._file is not None:
            self._file.close()
            self._file = None
