"""A lock that one process holds as long as it lives, however it ends, and that readers do not mind."""

import sqlite3
from pathlib import Path


class WriterLock:
    """An SQLite file of its own, held in an exclusive transaction: the system frees it with the process.

    The journal itself cannot be held so: then nobody could read it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._db: sqlite3.Connection | None = None

    @property
    def is_held(self) -> bool:
        """Return whether we hold it."""
        return self._db is not None

    def acquire(self) -> bool:
        """Take it; return whether that was possible, as nobody else has it.

        Raises:
            sqlite3.Error: the file cannot be opened or locked at all.
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
        """Let others have it."""
        if self._db is not None:
            self._db.close()
            self._db = None
