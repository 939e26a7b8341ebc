"""The audit: events of the journal, read beside its writer."""

from collections.abc import Iterator
from pathlib import Path

from pointit.runtime.host.store import read_rows
from pointit.services.selector.journal import COLUMNS, record_of
from pointit.services.selector.selection_publisher import Record

MAX_COUNT = 2**63 - 1
"""Upper limit of times and numbers, in messages and in SQLite."""

AUDIT = (
    f"SELECT {COLUMNS} FROM events WHERE stamp_ns >= ? AND (? = '' OR user = ? OR owner = ?) "  # noqa: S608 - a constant
    "AND (? = '' OR object_id = ?) ORDER BY id"
)


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
    parameters = (min(since_ns, MAX_COUNT), user, user, user, object_id, object_id)
    return read_rows(path, AUDIT, parameters, record_of)
