"""A lock that one process holds as long as it lives, however it ends, and that readers do not mind."""

import sqlite3
from pathlib import Path


class SoleWriter:
    """An SQLite file of its own, held in an exclusive transaction: the system frees it with the process.

    The journal itself cannot be held so: then nobody could read it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._db: sqlite3.Connection | None = None

    @property
    def is_taken(self) -> bool:
        """Return whether we hold it."""
        return self._db is not None

    def take(self) -> bool:
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

    def give_up(self) -> None:
        """Let others have it."""
        if self._db is not None:
            self._db.close()
            self._db = None
