"""The journal's table of events: its statements, its rows as records, and reading it beside its writer."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from pointit.runtime.config.validation_message import format_value
from pointit.services.selector.outputs import Cause, Record

FILE = "journal.sqlite"

LAYOUT = 1
"""Version of the tables. A file with a higher number was written by a newer version."""

BUSY_S = 0.05
"""Timeout of a writer for another process's lock, s."""
READ_BUSY_S = 2.0
"""Timeout of a reader, s."""

EVENTS = ("selected", "deselected", "refused", "left")
CAUSES = get_args(Cause)

MAX_COUNT = 2**63 - 1
"""Upper limit of times and numbers, in messages and in SQLite."""

TABLES = """
CREATE TABLE IF NOT EXISTS events (
    id INTEGER PRIMARY KEY,
    stamp_ns INTEGER NOT NULL, event TEXT NOT NULL, object_id TEXT NOT NULL, kind TEXT NOT NULL,
    user TEXT NOT NULL, owner TEXT NOT NULL, since_ns INTEGER NOT NULL, cause TEXT NOT NULL,
    method TEXT NOT NULL, confidence REAL, reason TEXT NOT NULL, seq INTEGER
);
CREATE INDEX IF NOT EXISTS events_of_object ON events (object_id, id);
CREATE INDEX IF NOT EXISTS events_told ON events (seq);
CREATE TABLE IF NOT EXISTS life (told INTEGER NOT NULL, alive_ns INTEGER NOT NULL);
"""

COLUMNS = "stamp_ns, event, object_id, kind, user, owner, since_ns, cause, method, confidence, reason, seq"
# All parts of these statements are constants of this file; what varies are their parameters.
INSERT = f"INSERT INTO events ({COLUMNS}) VALUES ({', '.join('?' * 12)})"  # noqa: S608 - see above
UNPUBLISHED = f"SELECT {COLUMNS} FROM events WHERE seq > ? ORDER BY id"  # noqa: S608 - see above
OPEN_IDS = (
    "SELECT id FROM events WHERE event = 'selected' AND id IN "
    "(SELECT MAX(id) FROM events WHERE event <> 'refused' GROUP BY object_id)"
)
OPEN = f"SELECT {COLUMNS} FROM events WHERE id IN ({OPEN_IDS}) ORDER BY id"  # noqa: S608 - see above
PRUNE_TO = "SELECT MAX(id) FROM (SELECT id FROM events WHERE id > ? ORDER BY id LIMIT ?)"
PRUNE = """
DELETE FROM events WHERE id > ? AND id <= ? AND stamp_ns < ? AND (event <> 'selected' OR EXISTS (
    SELECT 1 FROM events AS later
    WHERE later.object_id = events.object_id AND later.id > events.id AND later.event <> 'refused'
))
"""
AUDIT = (
    f"SELECT {COLUMNS} FROM events WHERE stamp_ns >= ? AND (? = '' OR user = ? OR owner = ?) "  # noqa: S608 - see above
    "AND (? = '' OR object_id = ?) ORDER BY id"
)

RECENT = (
    f"SELECT {COLUMNS} FROM events WHERE stamp_ns >= ? AND seq IS NOT NULL AND event <> 'left' "  # noqa: S608 - see above
    "ORDER BY id DESC LIMIT ?"
)


def row_of(record: Record) -> tuple[object, ...]:
    """Return `record` as a row of `COLUMNS`."""
    return (
        record.stamp_ns,
        record.event,
        record.object_id,
        record.kind,
        record.user,
        record.owner,
        record.since_ns,
        record.cause,
        record.method,
        record.confidence,
        record.reason,
        record.seq,
    )


def record_of(row: tuple[Any, ...]) -> Record:
    """Return a row of `COLUMNS` as a record.

    Raises:
        sqlite3.DatabaseError: If it is not valid, e.g. by a bit error, since SQLite has no checksums.
    """
    stamp_ns, event, object_id, kind, user, owner, since_ns, cause, method, confidence, reason, seq = row
    if (
        event not in EVENTS
        or cause not in CAUSES
        or not all(isinstance(text, str) for text in (object_id, kind, user, owner, method, reason))
        or not all(is_count(count) for count in (stamp_ns, since_ns, 0 if seq is None else seq))
        or not (confidence is None or (isinstance(confidence, float) and 0.0 <= confidence <= 1.0))
    ):
        raise sqlite3.DatabaseError(f"a row is damaged, {format_value(row)}")
    return Record(**dict(zip(COLUMNS.split(", "), row, strict=True)))


def is_count(value: object) -> bool:
    """Return True if `value` is valid as a time or number of a message."""
    return isinstance(value, int) and 0 <= value <= MAX_COUNT


def audit(path: Path, *, user: str = "", since_ns: int = 0, object_id: str = "") -> Iterator[Record]:
    """Return the events, the oldest first, while a selector may be writing.

    Args:
        path: path of the journal.
        user: events caused by this person or about their objects. `""`: all.
        since_ns: earliest time, ns.
        object_id: events of this object. `""`: all.

    Raises:
        sqlite3.Error: If the file cannot be read.
    """
    return _read(path, AUDIT, (min(since_ns, MAX_COUNT), user, user, user, object_id, object_id))


def recent(path: Path, last: int, *, since_ns: int = 0) -> list[Record]:
    """Return the last `last` records that were published, not before `since_ns`, the oldest first.

    Raises:
        sqlite3.Error: If the file cannot be read.
    """
    return list(_read(path, RECENT, (since_ns, last)))[::-1]


def _read(path: Path, statement: str, parameters: tuple[object, ...]) -> Iterator[Record]:
    db = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=READ_BUSY_S)
    try:
        for row in db.execute(statement, parameters):
            yield record_of(row)
    except UnicodeDecodeError as error:  # text in the file that is not UTF-8
        raise sqlite3.DatabaseError(str(error)) from error
    finally:
        db.close()
