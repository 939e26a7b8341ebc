"""The journal's table of events: its statements, its rows as records, and reading it beside its writer."""

from pathlib import Path

from pydantic import ConfigDict, TypeAdapter

from pointit.runtime.host.store import StoreLayout, read_rows
from pointit.schemas.base import MAX_ID
from pointit.services.selector.outputs import Record

FILE = "journal.sqlite"

LAYOUT = StoreLayout(
    tables=f"""
        CREATE TABLE IF NOT EXISTS events (
            id INTEGER PRIMARY KEY,
            stamp_ns INTEGER NOT NULL, event TEXT NOT NULL, object_id TEXT NOT NULL, kind TEXT NOT NULL,
            user TEXT NOT NULL, owner TEXT NOT NULL, since_ns INTEGER NOT NULL, cause TEXT NOT NULL,
            method TEXT NOT NULL, confidence REAL, reason TEXT NOT NULL, seq INTEGER
        );
        CREATE INDEX IF NOT EXISTS events_of_object ON events (object_id, id);
        CREATE INDEX IF NOT EXISTS events_told ON events (seq);
        CREATE INDEX IF NOT EXISTS events_refused ON events (id) WHERE event = 'refused';
        DELETE FROM events WHERE length(object_id) > {MAX_ID} OR length(kind) > {MAX_ID};
        CREATE TABLE IF NOT EXISTS life (told INTEGER NOT NULL, alive_ns INTEGER NOT NULL);
        INSERT INTO life SELECT 0, 0 WHERE NOT EXISTS (SELECT 1 FROM life);
    """,  # noqa: S608 - a constant
    writer="selector",
    loss="selections are kept in memory only",
)

COLUMNS = ", ".join(Record._fields)
# All parts of these statements are constants of this file; what varies are their parameters.
INSERT = f"INSERT INTO events ({COLUMNS}) VALUES ({', '.join('?' * len(Record._fields))})"  # noqa: S608
UNPUBLISHED = f"SELECT {COLUMNS} FROM events WHERE seq > ? ORDER BY id"  # noqa: S608 - see above
DECIDED = """
SELECT CAST(COALESCE(user, '') AS BLOB), CAST(stamp_ns AS INTEGER) FROM events
WHERE cause IN ('dwell', 'button') ORDER BY id DESC LIMIT ?
"""  # it can be read of any row: a damaged one is that of no claim
OPEN_IDS = (
    "SELECT id FROM events WHERE event = 'selected' AND id IN "
    "(SELECT MAX(id) FROM events WHERE event <> 'refused' GROUP BY object_id)"
)
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
    "ORDER BY id DESC LIMIT ?"
)

record_of = TypeAdapter(Record, config=ConfigDict(strict=True)).validate_python
"""Return a row of `COLUMNS` as a record. Raises ValueError for an invalid one, e.g. by a bit error, since
SQLite has no checksums."""


def recent(path: Path, last: int, *, since_ns: int = 0) -> list[Record]:
    """Return the last `last` records that were published, not before `since_ns`, the oldest first.

    Raises:
        sqlite3.Error: If the file cannot be read.
    """
    return list(read_rows(path, RECENT, (since_ns, last), record_of))[::-1]
