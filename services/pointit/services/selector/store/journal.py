"""Journal of events on disk: the audit, and what is selected, for the next start of the selector.

One table of events in an SQLite file in WAL mode, which others can read during writes. An event is
committed before it is published. Disk errors are reported in `problem`, and selecting continues in memory.
"""

import contextlib
import dataclasses
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pointit.schemas import NS_PER_S
from pointit.services.selector.outputs import Owned, Record
from pointit.services.selector.store.journal_table import (
    BUSY_S,
    FILE,
    INSERT,
    LAYOUT,
    OPEN,
    PRUNE,
    PRUNE_TO,
    READ_BUSY_S,
    TABLES,
    UNPUBLISHED,
    is_count,
    record_of,
    row_of,
)
from pointit.services.selector.store.writer_lock import WriterLock

NS_PER_DAY = 86_400 * NS_PER_S
ASIDE = "journal.corrupt-"
"""First characters of the name of a damaged file that was set aside, followed by the Unix time, ns."""
SHOWN_NS = NS_PER_DAY
"""Time for which a set-aside file is reported, ns. Another process may have set it aside, such as `pointit
run` before it starts services."""
MAX_PENDING = 4096
"""Limit of records kept while the disk cannot be written. Beyond it the oldest are lost to the audit."""
MAX_EVENTS = 2**62
"""Limit of a plausible event number, which leaves room to continue."""
PRUNED_AT_ONCE = 300
ALIVE_EVERY_NS = 20 * NS_PER_S
RETRY_EVERY_NS = 5 * NS_PER_S


@dataclass(frozen=True, kw_only=True)
class JournalContents:
    """Contents of a journal at the start."""

    entries: dict[str, Owned] = field(default_factory=dict[str, Owned])
    """Selected objects by id."""
    events: int = 0
    """Number of the last event that was published or was to be published."""
    unpublished: Sequence[Record] = ()
    """Events that may not have been published, the oldest first."""


class Journal:
    """The journal file of one site's selector. Only one selector writes it."""

    def __init__(self, folder: Path, *, keep_days: float = 30.0, restore_within_s: float = 600.0) -> None:
        """Create without opening any file.

        Args:
            folder: folder of the files. It is created if missing.
            keep_days: events older than this are deleted.
            restore_within_s: selections are dropped if the last sign of life is older.
        """
        self.path = folder / FILE
        self._problem = ""
        self._notice = ""
        """Problem found at the start. It stays until the end."""
        self._keep_ns = int(keep_days * NS_PER_DAY)
        self._within_ns = int(restore_within_s * NS_PER_S)
        self._lock = WriterLock(folder / "writer.lock")
        self._db: sqlite3.Connection | None = None
        self._pending: list[Record] = []
        self._published = self._published_on_disk = 0
        self._alive_ns: int | None = None
        self._retry_ns = 0
        self._pruned = 0
        """Row up to which old events were pruned last."""

    @property
    def problem(self) -> str:
        """Return the problem and its remedy in one sentence, or `""`."""
        return self._problem or self._notice

    def begin(self, now_ns: int) -> JournalContents:
        """Open the file and return its contents. If that fails they are empty and `problem` is set."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            if not self._lock.acquire():
                self._notice = (
                    f"another selector writes {self.path}; selections are kept in memory only: "
                    "end one of the two, then restart this one"
                )
                return JournalContents()
            kept = self._open_or_replace(now_ns)
            self._note_set_aside(now_ns)
        except (OSError, sqlite3.Error) as error:
            path = self.path if self._lock.is_held else self._lock.path
            self._notice = (
                f"{path} cannot be used ({error}); selections are kept in memory only: make room there, or "
                "make it writable, then restart this one"
            )
            self.close()
            return JournalContents()
        return kept

    def add(self, record: Record) -> None:
        """Add a record. It is stored by the next `commit`."""
        if self._db is not None:
            self._pending.append(record)

    def commit(self, now_ns: int) -> None:
        """Write all added records or none. If the disk fails, try again later."""
        if self._pending and self._may_write(now_ns):
            self._write(now_ns, self._pending)
        del self._pending[:-MAX_PENDING]

    def mark_published(self, seq: int) -> None:
        """Record that the event `seq` was published."""
        self._published = max(self._published, seq)

    def maintain(self, now_ns: int, *, is_selected: bool) -> None:
        """Store what was published and a sign of life, and delete old events. Called periodically."""
        lives = is_selected and (self._alive_ns is None or abs(now_ns - self._alive_ns) >= ALIVE_EVERY_NS)
        if (self._pending or lives or self._published != self._published_on_disk) and self._may_write(now_ns):
            self._write(now_ns, self._pending)

    def close(self) -> None:
        """Close the file and release the lock."""
        if self._db is not None:
            self._db.close()
            self._db = None
        self._lock.release()

    def _may_write(self, now_ns: int) -> bool:
        """Return True unless a write failed a short time ago."""
        return not self._problem or not 0 <= self._retry_ns - now_ns <= RETRY_EVERY_NS

    def _open_or_replace(self, now_ns: int) -> JournalContents:
        try:
            return self._open(now_ns)
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            if _is_disk_error(error):
                raise
            if self._db is not None:
                self._db.close()
        aside = self.path.with_name(f"{ASIDE}{now_ns}.sqlite")
        for suffix in ("", "-wal", "-shm"):
            part = self.path.with_name(self.path.name + suffix)
            if part.exists():
                part.replace(aside.with_name(aside.name + suffix))
        return self._open(now_ns)

    def _note_set_aside(self, now_ns: int) -> None:
        """Report a damaged file that was set aside lately, by this process or an earlier one."""
        for path in sorted(self.path.parent.glob(f"{ASIDE}*.sqlite")):
            when = path.stem.removeprefix(ASIDE)
            if when.isdecimal() and 0 <= now_ns - int(when) <= SHOWN_NS and not self._notice:
                self._notice = (
                    f"{self.path} was damaged and is now {path.name}, and a new audit was started: check "
                    "the disk"
                )

    def _open(self, now_ns: int) -> JournalContents:
        # a short wait suffices for later writes only: what is not read now is not restored
        db = self._db = sqlite3.connect(self.path, timeout=READ_BUSY_S, isolation_level=None)
        layout = int(db.execute("PRAGMA user_version").fetchone()[0])
        if layout > LAYOUT:
            db.close()
            self._db = None
            self._notice = (
                f"{self.path} was written by a newer version; selections are kept in memory only: "
                "update, or move the file away"
            )
            return JournalContents()
        if db.execute("PRAGMA quick_check(1)").fetchone()[0] != "ok":
            raise sqlite3.DatabaseError("damaged")
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = NORMAL")
        db.executescript(TABLES)
        if layout != LAYOUT:
            db.execute(f"PRAGMA user_version = {LAYOUT}")
        kept = self._read(db, now_ns)
        db.execute(f"PRAGMA busy_timeout = {round(BUSY_S * 1000)}")
        return kept

    def _read(self, db: sqlite3.Connection, now_ns: int) -> JournalContents:
        life = db.execute("SELECT told, alive_ns FROM life").fetchone()
        told, alive_ns = (0, now_ns) if life is None else life
        if life is None:
            db.execute("INSERT INTO life VALUES (0, ?)", (now_ns,))
        events = db.execute("SELECT COALESCE(MAX(seq), 0) FROM events").fetchone()[0]
        if not all(is_count(count) for count in (told, alive_ns, events)) or events > MAX_EVENTS:
            raise sqlite3.DatabaseError("a count is damaged")
        self._published = self._published_on_disk = told
        opened = [record_of(row) for row in db.execute(OPEN)]
        if abs(now_ns - alive_ns) > self._within_ns:
            self._published = events  # too old to be news
            self._write(now_ns, [_closed(record, now_ns) for record in opened])
            return JournalContents(events=events)
        unpublished = [record_of(row) for row in db.execute(UNPUBLISHED, (told,))]
        entries = {
            record.object_id: Owned(record.owner, record.kind, record.since_ns, record.confidence)
            for record in opened
        }
        return JournalContents(entries=entries, events=events, unpublished=unpublished)

    def _write(self, now_ns: int, records: list[Record]) -> None:
        """Write `records`, the last published number and the time, and empty the list."""
        db = self._db
        if db is None:
            return
        try:
            db.execute("BEGIN IMMEDIATE")
            try:
                db.executemany(INSERT, [row_of(record) for record in records])
                db.execute("UPDATE life SET told = ?, alive_ns = ?", (self._published, now_ns))
                self._prune(db, now_ns)
                db.execute("COMMIT")
            except BaseException:
                with contextlib.suppress(sqlite3.Error):  # a full disk has rolled it back already
                    db.execute("ROLLBACK")
                raise
        except sqlite3.Error as error:
            self._retry_ns = now_ns + RETRY_EVERY_NS
            self._fail(error)
            return
        records.clear()
        self._published_on_disk, self._alive_ns = self._published, now_ns
        self._problem = ""

    def _prune(self, db: sqlite3.Connection, now_ns: int) -> None:
        """Delete old events among the next few rows, once per sign of life.

        All at once would take too long.
        """
        if self._alive_ns is not None and abs(now_ns - self._alive_ns) < ALIVE_EVERY_NS:
            return
        end = db.execute(PRUNE_TO, (self._pruned, PRUNED_AT_ONCE)).fetchone()[0]
        if end is None:
            self._pruned = 0  # restart at the first row
            return
        db.execute(PRUNE, (self._pruned, end, now_ns - self._keep_ns))
        self._pruned = end

    def _fail(self, error: Exception) -> None:
        self._problem = (
            f"{self.path} cannot be written ({error}); selections are kept in memory only: make room there, "
            "or make it writable"
        )


def _is_disk_error(error: Exception) -> bool:
    """Return True if `error` is due to the disk or a lock, not to the file's content."""
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
    return isinstance(error, sqlite3.OperationalError) and code & 0xFF != sqlite3.SQLITE_ERROR


def _closed(record: Record, now_ns: int) -> Record:
    return dataclasses.replace(
        record,
        stamp_ns=now_ns,
        event="left",
        cause="",
        reason="nobody saw it while no selector ran",
        seq=None,
    )
