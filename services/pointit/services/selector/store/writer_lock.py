"""A lock that one process holds until it ends in any way, and that does not block readers."""

import sqlite3
from pathlib import Path


class WriterLock:
    """A separate SQLite file in an exclusive transaction, which the system ends with the process.

    A lock on the journal itself would block its readers.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._db: sqlite3.Connection | None = None

    @property
    def is_held(self) -> bool:
        """Return True if we hold the lock."""
        return self._db is not None

    def acquire(self) -> bool:
        """Acquire the lock. Return True on success, False if another process holds it.

        Raises:
            sqlite3.Error: If the file cannot be opened or locked at all.
        """
        db = sqlite3.connect(self.path, timeout=0.0, isolation_level=None)
        try:
            db.execute("BEGIN EXCLUSIVE")
        except sqlite3.Error as error:
            db.close()
            if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
                return False
            raise
        self._db = db
        return True

    def release(self) -> None:
        """Release the lock."""
        if self._db is not None:
            self._db.close()
            self._db = None
