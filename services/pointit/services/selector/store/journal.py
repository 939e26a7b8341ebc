"""Journal of events on disk: the audit, and what is selected, for the next start of the selector.

An event is committed before it is published. While the disk cannot be written, selecting continues in memory.
"""

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ConfigDict, TypeAdapter

from pointit.runtime.host.store import Store
from pointit.schemas import NS_PER_S
from pointit.schemas.base import Count, Ns
from pointit.services.selector.outputs import Owned, Record
from pointit.services.selector.store import journal_table as table

NS_PER_DAY = 86_400 * NS_PER_S
MAX_PENDING = 4096
"""Limit of records kept while the disk cannot be written. Beyond it the oldest are lost to the audit."""
MAX_EVENTS = 2**62
"""Limit of a plausible event number, which leaves room to continue."""
MAX_DECIDED = 1000
"""Number of claims that are recognized after a restart."""
PRUNED_AT_ONCE = 300
ALIVE_EVERY_NS = 20 * NS_PER_S

_LIFE = TypeAdapter(tuple[Count, Ns], config=ConfigDict(strict=True))


@dataclass(frozen=True, kw_only=True)
class JournalContents:
    """Contents of a journal at the start."""

    entries: dict[str, Owned] = field(default_factory=dict[str, Owned])
    """Selected objects by id."""
    events: int = 0
    """Number of the last event that was published or was to be published."""
    unpublished: Sequence[Record] = ()
    """Events that may not have been published, the oldest first."""
    decided: Sequence[tuple[str, int]] = ()
    """Persons and stamps of the last claims, the oldest first. They may come again."""


class Journal:
    """The journal file of one site's selector, which writes it alone. It keeps nothing before `begin`."""

    def __init__(
        self, folder: Path, *, keep_days: float = 30.0, restore_within_s: float = 600.0, max_mb: float = 200.0
    ) -> None:
        """Create without opening any file.

        Args:
            folder: folder of the files. It is created if missing.
            keep_days: events older than this are deleted.
            restore_within_s: selections are dropped if the last sign of life is older.
            max_mb: the oldest refusals, then other old events are deleted beyond this size of the file.
        """
        self._store = Store(folder / table.FILE, table.LAYOUT)
        self._keep_ns = int(keep_days * NS_PER_DAY)
        self._within_ns = int(restore_within_s * NS_PER_S)
        self._max_bytes = int(max_mb * 1e6)
        self._pending: list[Record] = []
        self._published = self._published_on_disk = 0
        self._alive_ns: int | None = None
        self._pruned = 0
        """Row up to which old events were pruned last."""

    @property
    def path(self) -> Path:
        """Return the path of the file."""
        return self._store.path

    @property
    def problem(self) -> str:
        """Return the problem and its remedy in one sentence, or `""`."""
        return self._store.problem

    def begin(self, now_ns: int) -> JournalContents:
        """Open the file and return its contents. If that fails they are empty and `problem` is set."""
        return self._store.open(now_ns, lambda db: self._read(db, now_ns)) or JournalContents()

    def add(self, record: Record) -> None:
        """Add a record. It is stored by the next `commit`."""
        if self._store.is_open:
            self._pending.append(record)

    def commit(self, now_ns: int) -> None:
        """Write all added records or none. If the disk fails, try again later."""
        if self._pending:
            self._write(now_ns)

    def mark_published(self, seq: int) -> None:
        """Record that the event `seq` was published."""
        self._published = max(self._published, seq)

    def maintain(self, now_ns: int, *, is_selected: bool) -> None:
        """Store what was published and a sign of life, and delete old events. Called periodically."""
        lives = is_selected and self._is_sign_due(now_ns)
        if self._pending or lives or self._published != self._published_on_disk:
            self._write(now_ns)

    def close(self) -> None:
        """Close the file and release the lock."""
        self._store.close()

    def _is_sign_due(self, now_ns: int) -> bool:
        return self._alive_ns is None or abs(now_ns - self._alive_ns) >= ALIVE_EVERY_NS

    def _read(self, db: sqlite3.Connection, now_ns: int) -> JournalContents:
        told, alive_ns = _LIFE.validate_python(db.execute("SELECT told, alive_ns FROM life").fetchone())
        events = int(db.execute("SELECT COALESCE(MAX(seq), 0) FROM events").fetchone()[0])
        if not 0 <= events <= MAX_EVENTS:
            raise ValueError("the number of events is damaged")
        opened = [table.record_of(row) for row in db.execute(table.OPEN)]
        self._published = self._published_on_disk = told
        if abs(now_ns - alive_ns) > self._within_ns:
            self._published = events  # too old to be news
            self._pending = [_closed(record, now_ns) for record in opened]
            self._write(now_ns)
            return JournalContents(events=events)
        entries = {
            record.object_id: Owned(record.owner, record.kind, record.since_ns, record.confidence)
            for record in opened
        }
        unpublished = [table.record_of(row) for row in db.execute(table.UNPUBLISHED, (told,))]
        last = db.execute(table.DECIDED, (MAX_DECIDED,)).fetchall()[::-1]
        decided = [(user.decode(errors="replace"), stamp_ns) for user, stamp_ns in last]
        return JournalContents(entries=entries, events=events, unpublished=unpublished, decided=decided)

    def _write(self, now_ns: int) -> None:
        def write(db: sqlite3.Connection) -> None:
            db.executemany(table.INSERT, self._pending)
            if self._pending and db.execute(table.BYTES).fetchone()[0] > self._max_bytes:
                rows = PRUNED_AT_ONCE + 2 * len(self._pending)
                for shrink in table.SHRINK:
                    rows -= db.execute(shrink, (rows,)).rowcount
            db.execute("UPDATE life SET told = ?, alive_ns = ?", (self._published, now_ns))
            if self._is_sign_due(now_ns):
                self._prune(db, now_ns)

        if self._store.write(now_ns, write):
            self._pending.clear()
            self._published_on_disk, self._alive_ns = self._published, now_ns
        else:
            del self._pending[:-MAX_PENDING]

    def _prune(self, db: sqlite3.Connection, now_ns: int) -> None:
        """Delete old events among the next few rows: all at once would take too long."""
        end = db.execute(table.PRUNE_TO, (self._pruned, PRUNED_AT_ONCE)).fetchone()[0]
        if end is None:
            self._pruned = 0  # restart at the first row
            return
        db.execute(table.PRUNE, (self._pruned, end, now_ns - self._keep_ns))
        self._pruned = end


def _closed(record: Record, now_ns: int) -> Record:
    reason = "nobody saw it while no selector ran"
    return record._replace(stamp_ns=now_ns, event="left", cause="", reason=reason, seq=None)
