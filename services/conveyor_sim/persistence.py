"""Saving of a conveyor's state, and its restoration after a restart."""

import contextlib
import hashlib
import json
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pointit.runtime.host.extras import pointit_version
from pointit.runtime.host.state_file import expand_home
from pointit.runtime.host.store import Store, StoreLayout
from pointit.schemas import NS_PER_S, Environment, SelectionEvent
from pointit.schemas.base import Count, Ns, SchemaModel
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.plant import Plant

FILE = "plant.sqlite"
LAYOUT = StoreLayout(
    tables="""
        CREATE TABLE IF NOT EXISTS plant (
            id INTEGER PRIMARY KEY CHECK (id = 1),
            stamp_ns INTEGER, seq INTEGER, fingerprint TEXT, snapshot TEXT
        );
        CREATE TABLE IF NOT EXISTS outbox (seq INTEGER PRIMARY KEY, event TEXT);
    """,
    writer="conveyor",
    loss="the conveyor continues, but would not survive a restart",
    is_synced=False,
)
PERIOD_NS = NS_PER_S // 2
"""Longest time between saves."""
RESUME_WITHIN_S = 60.0
"""Longest pause after which a restart restores the packages, s."""
BACK_S = 5.0
"""Clock steps back beyond this mean that the stored state is from another run."""


class Saved(SchemaModel):
    """Contents of the file."""

    stamp_ns: Ns
    seq: Count
    """Number of the last event."""
    fingerprint: str
    snapshot: dict[str, Any]
    events: tuple[SelectionEvent, ...]
    """Events that may be unpublished, in order."""


class PlantPersistence:
    """Saves a plant on disk before its events are published. Disk errors only set `problem`."""

    def __init__(self, config: ConveyorSimConfig, folder: Path) -> None:
        """Store in `folder`, which need not exist; opens nothing yet."""
        self._config = config
        self._store = Store(folder / FILE, LAYOUT)
        self._saved_ns = 0
        self._changes = -1
        self._plant: Plant | None = None
        self._seq = 0
        """Number of the last event."""

    @property
    def problem(self) -> str:
        """Return the current problem with saving, for users, or `""`."""
        return self._store.problem

    def resume(
        self, plant: Plant, mark: str, now_ns: int, *, speed: float = 1.0
    ) -> tuple[SelectionEvent, ...]:
        """Open the file and restore `plant` from it if it fits. Return events that may be unpublished.

        `speed`: seconds of the clock per second of wall time.
        """
        saved = self._store.open(now_ns, read)
        if saved is None or saved.fingerprint != mark:
            return ()
        age_s = (now_ns - saved.stamp_ns) / NS_PER_S / speed
        if not -BACK_S <= age_s <= RESUME_WITHIN_S:
            return ()
        try:
            plant.restore(saved.snapshot)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):  # it is damaged
            plant.reset()
            return ()
        self._seq = saved.seq
        return saved.events

    def save(
        self, plant: Plant, mark: str, now_ns: int, events: Sequence[SelectionEvent] = ()
    ) -> list[SelectionEvent]:
        """Number `events`, and save them with `plant` if due. Return the events to publish now."""
        numbered: list[SelectionEvent] = []
        for event in events:
            self._seq += 1
            numbered.append(event.model_copy(update={"seq": self._seq}))
        if not self._store.is_open:
            return numbered

        # Events must be stored before they are published. Everything else can wait
        if not events:
            is_changed = plant is not self._plant or plant.changes != self._changes
            is_old = abs(now_ns - self._saved_ns) >= PERIOD_NS
            if not is_changed and not is_old:
                return numbered
            if self._store.should_rest(now_ns):
                return numbered
        self._store.write(now_ns, lambda db: self._replace(db, plant, mark, now_ns, numbered))
        self._plant = plant
        self._changes = plant.changes
        self._saved_ns = now_ns
        return numbered

    def mark_published(self, now_ns: int) -> None:
        """Mark the events that `save` returned as published."""
        self._store.write(now_ns, lambda db: db.execute("DELETE FROM outbox"))

    def close(self) -> None:
        """Close the file."""
        self._store.close()

    def _replace(
        self, db: sqlite3.Connection, plant: Plant, mark: str, now_ns: int, events: Sequence[SelectionEvent]
    ) -> None:
        snapshot = json.dumps(plant.snapshot(), separators=(",", ":"))
        unpublished: list[tuple[int, str]] = []
        for event in events:
            unpublished.append((event.seq, event.model_dump_json(exclude_defaults=True)))
        db.execute("DELETE FROM outbox")
        db.execute("INSERT OR REPLACE INTO plant VALUES (1, ?, ?, ?, ?)", (now_ns, self._seq, mark, snapshot))
        db.executemany("INSERT INTO outbox VALUES (?, ?)", unpublished)


def read(db: sqlite3.Connection) -> Saved | None:
    """Return the saved state, or None if the file is empty.

    Raises:
        ValueError: If it is damaged.
    """
    row = db.execute("SELECT stamp_ns, seq, fingerprint, snapshot FROM plant").fetchone()
    if row is None:
        return None
    stamp_ns, seq, mark, text = row
    events = db.execute("SELECT event FROM outbox ORDER BY seq").fetchall()
    snapshot = json.loads(str(text))
    return Saved(
        stamp_ns=stamp_ns,
        seq=seq,
        fingerprint=mark,
        snapshot=snapshot,
        events=tuple(SelectionEvent.model_validate_json(event) for (event,) in events),
    )


def discard(folder: Path, now_ns: int) -> None:
    """Delete what is saved in `folder`, unless another process uses it."""

    def delete(db: sqlite3.Connection) -> None:
        for table in ("outbox", "plant"):
            db.execute(f"DELETE FROM {table}")  # noqa: S608 - constants

    store = Store(folder / FILE, LAYOUT)
    if store.path.exists():
        store.open(now_ns, read)
        store.write(now_ns, delete)
        store.close()


def fingerprint(environment: Environment, config: ConveyorSimConfig) -> str:
    """Return a hash of all that determines the packages' motion: version, parts of the map, configuration."""
    parts = environment.model_dump(include={"belts", "strips", "links", "bays"}, mode="json")
    settings = config.model_dump(exclude={"rate_hz", "tracking"}, mode="json")
    text = json.dumps([pointit_version(), parts, settings], sort_keys=True)
    if config.schedule:
        path = expand_home(config.schedule)
        with contextlib.suppress(OSError):
            text += path.read_text(encoding="utf-8", errors="replace")
    return hashlib.sha256(text.encode()).hexdigest()
