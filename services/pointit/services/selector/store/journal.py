"""What happened to objects, on disk: the audit, and what is selected, for whoever starts after us.

One table of events in an SQLite file in WAL mode, which others read while we write. An event is committed
before it is published. Whatever goes wrong with the disk is said in `problem`, and selecting goes on in
memory.
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
    UNTOLD,
    is_count,
    record_of,
    row_of,
)
from pointit.services.selector.store.writer_lock import WriterLock

NS_PER_DAY = 86_400 * NS_PER_S
ASIDE = "journal.corrupt-"
"""First characters of the name of a damaged file that was set aside; when it was follows, Unix ns."""
SHOWN_NS = NS_PER_DAY
"""For how long it is said that a file was set aside; it may have been set aside by another process, as by
`pointit run` before its services begin."""
MOST_PENDING = 4096
"""Records kept while the disk takes none; of more the oldest are lost to the audit."""
MOST_EVENTS = 2**62
"""Nobody has counted so far, and there is room to go on."""
PRUNED_AT_ONCE = 300
ALIVE_EVERY_NS = 20 * NS_PER_S
RETRY_EVERY_NS = 5 * NS_PER_S


@dataclass(frozen=True, kw_only=True)
class JournalContents:
    """What a journal holds at the start."""

    entries: dict[str, Owned] = field(default_factory=dict[str, Owned])
    """What was selected, by object."""
    events: int = 0
    """Number of the last event that was told or was to be told."""
    unpublished: Sequence[Record] = ()
    """Events of which it is not sure that they were told, the oldest first."""


class Journal:
    """The file of one site's selector; only one selector writes it."""

    def __init__(self, folder: Path, *, keep_days: float = 30.0, restore_within_s: float = 600.0) -> None:
        """Touch nothing yet.

        Args:
            folder: where the files are; made when missing.
            keep_days: older events are dropped.
            restore_within_s: what was selected is dropped when the last sign of life is older.
        """
        self.path = folder / FILE
        self._trouble = ""
        self._notice = ""
        """What happened at the start; it stays to be seen."""
        self._keep_ns = int(keep_days * NS_PER_DAY)
        self._within_ns = int(restore_within_s * NS_PER_S)
        self._sole = WriterLock(folder / "writer.lock")
        self._db: sqlite3.Connection | None = None
        self._pending: list[Record] = []
        self._told = self._told_there = 0
        self._alive_ns: int | None = None
        self._retry_ns = 0
        self._pruned = 0
        """Row up to which it was last looked for what is too old."""

    @property
    def problem(self) -> str:
        """Return what is wrong and what to do, one sentence; empty: nothing."""
        return self._trouble or self._notice

    def begin(self, now_ns: int) -> JournalContents:
        """Open the file and return what it holds; nothing, with a problem, when that fails."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            if not self._sole.acquire():
                self._notice = (
                    f"another selector writes {self.path}; selections are kept in memory only: "
                    "end one of the two, then restart this one"
                )
                return JournalContents()
            kept = self._open_or_replace(now_ns)
            self._note_set_aside(now_ns)
        except (OSError, sqlite3.Error) as error:
            path = self.path if self._sole.is_held else self._sole.path
            self._notice = (
                f"{path} cannot be used ({error}); selections are kept in memory only: make room there, or "
                "make it writable, then restart this one"
            )
            self.close()
            return JournalContents()
        return kept

    def add(self, record: Record) -> None:
        """Take a record; it is kept from the next `commit` on."""
        if self._db is not None:
            self._pending.append(record)

    def commit(self, now_ns: int) -> None:
        """Write what was added, all of it or nothing; tried again later when the disk takes nothing."""
        if self._pending and self._may_write(now_ns):
            self._write(now_ns, self._pending)
        del self._pending[:-MOST_PENDING]

    def mark_published(self, seq: int) -> None:
        """Take note that the event `seq` was published."""
        self._told = max(self._told, seq)

    def maintain(self, now_ns: int, *, is_selected: bool) -> None:
        """Write down what was published, that we live, and drop what is old; called now and then."""
        lives = is_selected and (self._alive_ns is None or abs(now_ns - self._alive_ns) >= ALIVE_EVERY_NS)
        if (self._pending or lives or self._told != self._told_there) and self._may_write(now_ns):
            self._write(now_ns, self._pending)

    def close(self) -> None:
        """Let go of the file."""
        if self._db is not None:
            self._db.close()
            self._db = None
        self._sole.release()

    def _may_write(self, now_ns: int) -> bool:
        """Return whether it is worth trying: not too soon after it failed."""
        return not self._trouble or not 0 <= self._retry_ns - now_ns <= RETRY_EVERY_NS

    def _open_or_replace(self, now_ns: int) -> JournalContents:
        try:
            return self._open(now_ns)
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            if _is_of_the_disk(error):
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
        """Say which damaged file was set aside lately, by this process or an earlier one."""
        for path in sorted(self.path.parent.glob(f"{ASIDE}*.sqlite")):
            when = path.stem.removeprefix(ASIDE)
            if when.isdecimal() and 0 <= now_ns - int(when) <= SHOWN_NS and not self._notice:
                self._notice = (
                    f"{self.path} was damaged and is kept as {path.name}; the audit begins anew: look at "
                    "the disk"
                )

    def _open(self, now_ns: int) -> JournalContents:
        # nobody waits for us yet, and what is not read now is not taken up
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
        if not all(is_count(count) for count in (told, alive_ns, events)) or events > MOST_EVENTS:
            raise sqlite3.DatabaseError("a count is damaged")
        self._told = self._told_there = told
        opened = [record_of(row) for row in db.execute(OPEN)]
        if abs(now_ns - alive_ns) > self._within_ns:
            self._told = events  # too old to be news
            self._write(now_ns, [_closed(record, now_ns) for record in opened])
            return JournalContents(events=events)
        untold = [record_of(row) for row in db.execute(UNTOLD, (told,))]
        entries = {
            record.object_id: Owned(record.owner, record.kind, record.since_ns, record.confidence)
            for record in opened
        }
        return JournalContents(entries=entries, events=events, unpublished=untold)

    def _write(self, now_ns: int, records: list[Record]) -> None:
        """Write `records`, what was told and when this was, and empty the list."""
        db = self._db
        if db is None:
            return
        try:
            db.execute("BEGIN IMMEDIATE")
            try:
                db.executemany(INSERT, [row_of(record) for record in records])
                db.execute("UPDATE life SET told = ?, alive_ns = ?", (self._told, now_ns))
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
        self._told_there, self._alive_ns = self._told, now_ns
        self._trouble = ""

    def _prune(self, db: sqlite3.Connection, now_ns: int) -> None:
        """Drop what is too old of the next few rows, once per sign of life: all at once takes too long."""
        if self._alive_ns is not None and abs(now_ns - self._alive_ns) < ALIVE_EVERY_NS:
            return
        end = db.execute(PRUNE_TO, (self._pruned, PRUNED_AT_ONCE)).fetchone()[0]
        if end is None:
            self._pruned = 0  # from the beginning again
            return
        db.execute(PRUNE, (self._pruned, end, now_ns - self._keep_ns))
        self._pruned = end

    def _fail(self, error: Exception) -> None:
        self._trouble = (
            f"{self.path} cannot be written ({error}); selections are kept in memory only: make room there, "
            "or make it writable"
        )


def _is_of_the_disk(error: Exception) -> bool:
    """Return whether it is not the file's content that is wrong, but what it is on, or who holds it."""
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
