"""Journal of events on disk: what is selected for the next start, and past events for late subscribers.

An event is committed before it is published. While the disk cannot be written, selecting continues in memory.

No core: it writes a file.
"""

import asyncio
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ConfigDict, TypeAdapter

from pointit.runtime.config.parameters import set_option
from pointit.runtime.errors import RefusedError
from pointit.runtime.host.advised_commands import advised_commands
from pointit.runtime.host.store import Store, StoreLayout, read_rows
from pointit.schemas import NS_PER_S, ActOutcome, ReadHistory, ReadHistoryReply, SelectionEvent, encode
from pointit.schemas.base import Count, Id, KeyName, Ns
from pointit.schemas.selection import NOT_DONE
from pointit.services.selector.selection_publisher import Owned, Record, event_of

FILE = "journal.sqlite"

LAYOUT = StoreLayout(
    tables="""
        CREATE TABLE IF NOT EXISTS events (
            id INTEGER PRIMARY KEY,
            stamp_ns INTEGER NOT NULL, event TEXT NOT NULL, object_id TEXT NOT NULL, kind TEXT NOT NULL,
            user TEXT NOT NULL, owner TEXT NOT NULL, since_ns INTEGER NOT NULL, cause TEXT NOT NULL,
            method TEXT NOT NULL, confidence REAL, reason TEXT NOT NULL, seq INTEGER
        );
        CREATE INDEX IF NOT EXISTS events_of_object ON events (object_id, id);
        CREATE INDEX IF NOT EXISTS events_told ON events (seq);
        CREATE INDEX IF NOT EXISTS events_refused ON events (id) WHERE event = 'refused';
        CREATE TABLE IF NOT EXISTS life (told INTEGER NOT NULL, alive_ns INTEGER NOT NULL);
        INSERT INTO life SELECT 0, 0 WHERE NOT EXISTS (SELECT 1 FROM life);
        CREATE TABLE IF NOT EXISTS acts (id INTEGER PRIMARY KEY, carriers TEXT NOT NULL);
        CREATE TABLE IF NOT EXISTS outcomes (id INTEGER PRIMARY KEY, outcome TEXT NOT NULL);
        CREATE TABLE IF NOT EXISTS carriers (thing TEXT NOT NULL, carrier TEXT NOT NULL);
    """,
    writer="selector",
    loss="selections are kept in memory only",
)

FIELDS = Record._fields[:-1]
"""Fields of a record that are columns. Carriers are in another table until they have reported the result."""
COLUMNS = ", ".join(FIELDS)
# All parts of these statements are constants of this file; what varies are their parameters.
INSERT = f"INSERT INTO events ({COLUMNS}) VALUES ({', '.join('?' * len(FIELDS))})"  # noqa: S608
INSERT_ACT = "INSERT OR REPLACE INTO acts VALUES (last_insert_rowid(), ?)"
"""Note the carriers of the previous event. The row is deleted when they have reported the result."""
IS_ACT = "id IN (SELECT id FROM acts JOIN events USING (id) WHERE object_id = ? AND stamp_ns = ?)"
TELL_RESULT = f"UPDATE events SET reason = ? WHERE {IS_ACT}"  # noqa: S608 - see above
KEEP_OUTCOME = f"INSERT OR REPLACE INTO outcomes SELECT id, ? FROM acts WHERE {IS_ACT}"  # noqa: S608 - see above
"""Note the outcome of an act. The row is deleted when the outcome was published."""
END_ACT = f"DELETE FROM acts WHERE {IS_ACT}"  # noqa: S608 - see above
FORGET_OUTCOME = """
DELETE FROM outcomes WHERE id IN (SELECT id FROM events WHERE object_id = ? AND stamp_ns = ?)
"""
UNTOLD = "SELECT CAST(outcome AS TEXT) FROM outcomes ORDER BY id"
NOT_FOLLOWED = f"UPDATE events SET reason = '{NOT_DONE}no selector ran' WHERE id IN (SELECT id FROM acts)"  # noqa: S608
UNPUBLISHED = (
    f"SELECT {COLUMNS}, COALESCE(carriers, '') FROM events LEFT JOIN acts USING (id) "  # noqa: S608 - see above
    "WHERE seq > ? ORDER BY id"
)
DECIDED = """
SELECT CAST(COALESCE(user, '') AS BLOB), CAST(stamp_ns AS INTEGER) FROM events
WHERE cause IN ('dwell', 'button') ORDER BY id DESC LIMIT ?
"""  # it can be read of any row: a damaged one is that of no claim
NEWEST_IDS = "(SELECT MAX(id) FROM events WHERE event <> 'refused' GROUP BY object_id)"
OPEN_IDS = f"SELECT id FROM events WHERE event = 'selected' AND id IN {NEWEST_IDS}"  # noqa: S608 - see above
PENDING = f"SELECT {COLUMNS}, carriers, id IN {NEWEST_IDS} FROM events JOIN acts USING (id) ORDER BY id"  # noqa: S608 - see above
OPEN = f"SELECT {COLUMNS} FROM events WHERE id IN ({OPEN_IDS}) ORDER BY id"  # noqa: S608 - see above
PRUNE_TO = "SELECT MAX(id) FROM (SELECT id FROM events WHERE id > ? ORDER BY id LIMIT ?)"
CLOSED = """(event <> 'selected' OR EXISTS (
    SELECT 1 FROM events AS later
    WHERE later.object_id = events.object_id AND later.id > events.id AND later.event <> 'refused'
))"""
PRUNE = f"DELETE FROM events WHERE id > ? AND id <= ? AND stamp_ns < ? AND {CLOSED}"  # noqa: S608 - see above
BYTES = """
SELECT (page_count - freelist_count) * page_size
FROM pragma_page_count, pragma_freelist_count, pragma_page_size
"""
SHRINK = [
    f"DELETE FROM events WHERE id IN (SELECT id FROM events WHERE {rows} ORDER BY id LIMIT ?)"  # noqa: S608 - see above
    for rows in ("event = 'refused'", CLOSED)
]
"""Delete the oldest refusals, which anybody can cause, or the oldest events of what is not selected now."""
RECENT = (
    f"SELECT {COLUMNS} FROM events WHERE stamp_ns >= ? AND seq IS NOT NULL AND event <> 'left' "  # noqa: S608 - see above
    f"AND reason NOT LIKE '{NOT_DONE}%' AND id NOT IN (SELECT id FROM acts) ORDER BY id DESC LIMIT ?"
)

record_of = TypeAdapter(Record, config=ConfigDict(strict=True)).validate_python
"""Return a row of `COLUMNS` as a record. Raises ValueError for an invalid one, e.g. by a bit error, since
SQLite has no checksums."""

NS_PER_DAY = 86_400 * NS_PER_S
MAX_PENDING = 4096
"""Limit of records kept while the disk cannot be written. Beyond it the oldest are lost to the audit."""
MAX_EVENTS = 2**62
"""Limit of a plausible event number, which leaves room to continue."""
MAX_DECIDED = 1000
"""Number of claims that are recognized after a restart."""
PRUNED_AT_ONCE = 300
ALIVE_EVERY_NS = 20 * NS_PER_S

_CARRIED = TypeAdapter(tuple[Id, KeyName], config=ConfigDict(strict=True))
_LIFE = TypeAdapter(tuple[Count, Ns], config=ConfigDict(strict=True))

PAUSE_S = 0.05
"""Pause after each reading, so that repeated queries do not block selecting, s."""

ENVELOPE_BYTES = 1024
"""Upper limit of the size of a reply without its events."""


def recent(path: Path, last: int, *, since_ns: int = 0) -> list[Record]:
    """Return the last `last` records that were published, not before `since_ns`, the oldest first.

    Acts are among them when their carriers have reported that they are done.

    Raises:
        sqlite3.Error: If the file cannot be read.
    """
    newest_first = list(read_rows(path, RECENT, (since_ns, last), record_of))
    return newest_first[::-1]


@dataclass(frozen=True, kw_only=True)
class JournalContents:
    """Contents of a journal at the start."""

    entries: dict[str, Owned] = field(default_factory=dict[str, Owned])
    """Selected objects by id."""
    events: int = 0
    """Number of the last event that was published or was to be published."""
    unpublished: Sequence[Record] = ()
    """Events that may not have been published, the oldest first."""
    pending: Sequence[tuple[Record, bool]] = ()
    """Events whose result was not reported, and whether each is the last one of its object."""
    untold: Sequence[ActOutcome] = ()
    """Outcomes that may not have been published, in the order of their acts."""
    carried: Sequence[tuple[str, str]] = ()
    """Things and their carriers."""
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
        self._store = Store(folder / FILE, LAYOUT)
        self._keep_ns = int(keep_days * NS_PER_DAY)
        self._within_ns = int(restore_within_s * NS_PER_S)
        self._max_bytes = int(max_mb * 1e6)
        self._pending: list[Record | ActOutcome] = []
        self._published = 0
        self._published_on_disk = 0
        self._told: list[tuple[str, int]] = []
        """Object and stamp of the acts whose outcomes were published, until this is on disk."""
        self._carried: frozenset[tuple[str, str]] = frozenset()
        self._carried_on_disk: frozenset[tuple[str, str]] = frozenset()
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

    def add(self, entry: Record | ActOutcome) -> None:
        """Add a record, or the final outcome of one. It is stored by the next `commit`."""
        if self._store.is_open:
            self._pending.append(entry)

    def keep_carried(self, carried: frozenset[tuple[str, str]]) -> None:
        """Keep things and their carriers, for which the next selector waits. Stored by the next `commit`."""
        self._carried = carried

    def commit(self, now_ns: int) -> None:
        """Write all that was added, or nothing. If the disk fails, try again later."""
        if self._pending or self._carried != self._carried_on_disk:
            self._write(now_ns)

    def mark_published(self, seq: int) -> None:
        """Record that the event `seq` was published."""
        self._published = max(self._published, seq)

    def mark_told(self, outcome: ActOutcome) -> None:
        """Record that the outcome of an act was published."""
        if self._store.is_open:
            self._told.append((outcome.object_id, outcome.event_ns))

    def maintain(self, now_ns: int, *, is_selected: bool) -> None:
        """Store what was published and a sign of life, and delete old events. Called periodically."""
        is_sign_due = is_selected and self._is_sign_due(now_ns)
        has_published = self._published != self._published_on_disk
        if self._pending or self._told or is_sign_due or has_published:
            self._write(now_ns)

    def close(self) -> None:
        """Close the file and release the lock."""
        self._store.close()

    def _is_sign_due(self, now_ns: int) -> bool:
        """Return True if it is time for a sign of life."""
        return self._alive_ns is None or abs(now_ns - self._alive_ns) >= ALIVE_EVERY_NS

    def _read(self, db: sqlite3.Connection, now_ns: int) -> JournalContents:
        """Return the contents of the file. Selections are closed if its last sign of life is too old.

        Raises:
            ValueError: If a value is damaged.
        """
        # Every row is validated, since SQLite has no checksums
        published, alive_ns = _LIFE.validate_python(db.execute("SELECT told, alive_ns FROM life").fetchone())
        events = _single_number(db, "SELECT COALESCE(MAX(seq), 0) FROM events")
        if not 0 <= events <= MAX_EVENTS:
            raise ValueError("the number of events is damaged")
        opened = [record_of(row) for row in db.execute(OPEN)]
        self._published = published
        self._published_on_disk = published

        # Too old: close open selections. Their events are not published, and nobody waits for results
        if abs(now_ns - alive_ns) > self._within_ns:
            self._published = events
            self._pending = [_closed(record, now_ns) for record in opened]
            db.execute(NOT_FOLLOWED)
            db.execute("DELETE FROM acts")
            db.execute("DELETE FROM outcomes")
            db.execute("DELETE FROM carriers")
            self._write(now_ns)
            return JournalContents(events=events)

        # Recent: restore the selections, and what is to be published or has no result yet
        entries: dict[str, Owned] = {}
        for record in opened:
            entry = Owned(record.owner, record.kind, record.since_ns, record.confidence)
            entries[record.object_id] = entry
        unpublished = [record_of(row) for row in db.execute(UNPUBLISHED, (published,))]
        decided: list[tuple[str, int]] = []
        for user, stamp_ns in reversed(db.execute(DECIDED, (MAX_DECIDED,)).fetchall()):
            decided.append((user.decode(errors="replace"), stamp_ns))
        pending: list[tuple[Record, bool]] = []
        for *fields, is_newest in db.execute(PENDING):
            pending.append((record_of(tuple(fields)), bool(is_newest)))
        untold = [ActOutcome.model_validate_json(text) for (text,) in db.execute(UNTOLD)]
        carried = [_CARRIED.validate_python(row) for row in db.execute("SELECT thing, carrier FROM carriers")]
        self._carried = self._carried_on_disk = frozenset(carried)
        return JournalContents(
            entries=entries,
            events=events,
            unpublished=unpublished,
            untold=untold,
            carried=carried,
            decided=decided,
            pending=pending,
        )

    def _write(self, now_ns: int) -> None:
        """Write what is pending, what was published and a sign of life in one transaction."""

        def write(db: sqlite3.Connection) -> None:
            for entry in self._pending:
                _insert(db, entry)
            db.executemany(FORGET_OUTCOME, self._told)
            if self._carried != self._carried_on_disk:
                db.execute("DELETE FROM carriers")
                db.executemany("INSERT INTO carriers VALUES (?, ?)", sorted(self._carried))
            # if the file is too large, delete more than was added: first of refusals, then of other events
            if self._pending and _single_number(db, BYTES) > self._max_bytes:
                rows = PRUNED_AT_ONCE + 2 * len(self._pending)
                for shrink in SHRINK:
                    rows -= db.execute(shrink, (rows,)).rowcount
            db.execute("UPDATE life SET told = ?, alive_ns = ?", (self._published, now_ns))
            if self._is_sign_due(now_ns):
                self._prune(db, now_ns)

        if self._store.write(now_ns, write):
            self._pending.clear()
            self._told.clear()
            self._carried_on_disk = self._carried
            self._published_on_disk = self._published
            self._alive_ns = now_ns
        else:
            del self._pending[:-MAX_PENDING]
            del self._told[:-MAX_PENDING]

    def _prune(self, db: sqlite3.Connection, now_ns: int) -> None:
        """Delete old events among the next few rows: all at once would take too long."""
        (end,) = db.execute(PRUNE_TO, (self._pruned, PRUNED_AT_ONCE)).fetchone()
        if end is None:
            self._pruned = 0  # restart at the first row
            return
        oldest_ns = now_ns - self._keep_ns
        db.execute(PRUNE, (self._pruned, end, oldest_ns))
        self._pruned = end


def _single_number(db: sqlite3.Connection, query: str) -> int:
    """Return the result of a query for one number."""
    (number,) = db.execute(query).fetchone()
    return int(number)


def _insert(db: sqlite3.Connection, entry: Record | ActOutcome) -> None:
    """Insert a record, or give one the final outcome of its act."""
    if isinstance(entry, ActOutcome):
        reason = f"{NOT_DONE}{entry.text}" if entry.result == "failed" else ""
        key = entry.object_id, entry.event_ns
        db.execute(TELL_RESULT, (reason, *key))
        db.execute(KEEP_OUTCOME, (entry.model_dump_json(), *key))
        db.execute(END_ACT, key)
        return
    db.execute(INSERT, entry[:-1])
    if entry.carriers:
        db.execute(INSERT_ACT, (entry.carriers,))


def _closed(record: Record, now_ns: int) -> Record:
    """Return the event that closes a selection that was not restored."""
    reason = "nobody saw it while no selector ran"
    return record._replace(stamp_ns=now_ns, event="left", cause="", reason=reason, seq=None)


class History:
    """Answers queries for past events, one at a time, each in a thread."""

    def __init__(self, path: Path | None) -> None:
        """Create for the journal at `path`. None: there is no journal."""
        self._path = path
        self._turn = asyncio.Lock()

    async def answer(self, query: ReadHistory, _name: str) -> ReadHistoryReply:
        """Return the last events.

        Raises:
            RefusedError: If there is no journal, or it cannot be read.
        """
        if self._path is None:
            option = set_option("selector", "journal.enabled", "true")
            raise RefusedError(f"this selector keeps no journal: start it with {option}")
        async with self._turn:
            try:
                events = await asyncio.to_thread(_read, self._path, query)
            except sqlite3.Error as error:
                doctor = advised_commands().command("pointit doctor")
                raise RefusedError(f"the journal cannot be read ({error}): see {doctor}") from error
            finally:
                await asyncio.sleep(PAUSE_S)
        return ReadHistoryReply(message=f"the last {len(events)} events", events=events)


def _read(path: Path, query: ReadHistory) -> tuple[SelectionEvent, ...]:
    events: list[SelectionEvent] = []
    for record in recent(path, query.last, since_ns=query.since_ns):
        event = event_of(record, record.seq or 0)
        if event is not None:
            events.append(event)
    return fitting(events)


def fitting(
    events: list[SelectionEvent], max_bytes: int = ReadHistoryReply.max_bytes - ENVELOPE_BYTES
) -> tuple[SelectionEvent, ...]:
    """Return the newest of `events`, which are in order, that fit into `max_bytes` together."""
    remaining_bytes = max_bytes
    for index in reversed(range(len(events))):
        remaining_bytes -= len(encode(events[index]))
        if remaining_bytes < 0:
            return tuple(events[index + 1 :])
    return tuple(events)
