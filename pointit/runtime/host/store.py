"""Store: an SQLite file with one writer, for events and state that must outlive the process.

One process writes a file, and others may read it meanwhile (WAL mode). Errors of the disk do not raise: they
are reported in `Store.problem`, and the writer continues in memory.
"""

import contextlib
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pointit.runtime.machine import this_machine
from pointit.schemas import NS_PER_S
from pointit.schemas.text import system_reason

T = TypeVar("T")
LOCK = "writer.lock"
"""Name of the lock beside the file. A lock on the file itself would block its readers."""
BUSY_S = 0.05
"""Timeout of a writer for another process's lock, s."""
READ_BUSY_S = 2.0
"""Timeout of a reader, and of a writer at the start, s."""
RETRY_EVERY_NS = 5 * NS_PER_S
"""Time without another attempt after a failed write, ns."""
MAX_REST_NS = 60 * NS_PER_S
"""Maximum rest after a slow write, ns."""
SLOW_S = 0.25
"""Time of a write above which the disk is slow, s: the caller's event loop stands still meanwhile."""
REST_FACTOR = 20
"""Rest after a slow write, relative to its time. Writes that can wait take 5 % of the time at most."""
REPORTED_SLOW_WRITES = 3
"""Number of slow writes in a row after which they are reported. A busy machine has one at times."""
SHOWN_NS = 86_400 * NS_PER_S
"""Time for which a set-aside file is reported, ns. Another process may have set it aside, such as `pointit
run` before it starts services."""


@dataclass(frozen=True, kw_only=True)
class StoreLayout:
    """Tables of a file, and words for messages about it."""

    tables: str
    """SQL script that creates what is missing."""
    version: int = 1
    """Version of the tables. A file with a higher number was written by a newer version."""
    writer: str
    """Kind of process that writes it: "selector"."""
    loss: str
    """Consequence when nothing is stored: "selections are kept in memory only"."""
    is_synced: bool = True
    """False: the writer never waits for the disk. A crash of the machine may damage the file."""


class Store:
    """The file at `path`, alone in its folder with its lock and files that were set aside."""

    def __init__(self, path: Path, layout: StoreLayout) -> None:
        """Create without opening any file."""
        self.path = path
        self._layout = layout
        self._lock: sqlite3.Connection | None = None
        self._db: sqlite3.Connection | None = None
        self._notice = ""
        """Problem found at the start. It stays until the end."""
        self._failure = ""
        """Problem of the last write."""
        self._retry_ns = 0
        self._slow_writes = 0
        """Number of slow writes in a row."""
        self._rest_until_ns = 0
        """Time until which writes that can wait should wait, ns."""

    @property
    def is_open(self) -> bool:
        """Return True if the file can be written unless the disk fails."""
        return self._db is not None

    @property
    def problem(self) -> str:
        """Return the problem and its remedy in one sentence, or `""`."""
        problem = self._failure or self._notice
        if problem or self._slow_writes < REPORTED_SLOW_WRITES:
            return problem
        return (
            f"{self.path} is on a slow disk (writes take more than {SLOW_S:g} s, and everything waits for "
            "them): set POINTIT_STATE to a folder on a faster one"
        )

    def should_rest(self, now_ns: int) -> bool:
        """Return True if a write that can wait, such as of a snapshot, should wait for a slow disk."""
        return 0 < self._rest_until_ns - now_ns <= MAX_REST_NS

    def open(self, now_ns: int, read: Callable[[sqlite3.Connection], T]) -> T | None:
        """Open or create the file, and return the result of `read`. A damaged file is set aside.

        Args:
            now_ns: time, Unix ns.
            read: reads what is stored. A `ValueError` or a `sqlite3.DatabaseError` means damage, and it is
                called again on an empty file.

        Returns:
            The result of `read`, or None if the file cannot be used, which `problem` then reports.
        """
        loss = self._layout.loss
        try:
            # The lock comes before the first look at the file: its writer may be about to replace it
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._lock = acquire_lock(self.path.with_name(LOCK))
            if self._lock is None:
                rival = f"another {self._layout.writer} of this site writes {self.path}"
                self._notice = (
                    f"{rival}; {loss}: end one of the two and restart this one, or start it as another site "
                    "by --site NAME"
                )
                return None
            stored = self._open_or_replace(now_ns, read)
            self._note_set_aside(now_ns)
        except (OSError, sqlite3.Error) as error:
            path = self.path.with_name(LOCK) if self._lock is None else self.path
            self._notice = (
                f"{path} cannot be used ({system_reason(error)}); {loss}: make room there, or make it "
                "writable, then restart this one"
            )
            self.close()
            return None
        return stored

    def write(self, now_ns: int, write: Callable[[sqlite3.Connection], object]) -> bool:
        """Run `write` in a transaction. Return True if it is committed.

        After an error it is not tried again for a while, since waiting for the disk blocks the caller.
        """
        if self._db is None:
            return False
        is_waiting = 0 <= self._retry_ns - now_ns <= RETRY_EVERY_NS
        if self._failure and is_waiting:
            return False
        began_s = this_machine().elapsed_s()
        try:
            with self._db:
                self._db.execute("BEGIN IMMEDIATE")
                write(self._db)
        except sqlite3.Error as error:
            self._retry_ns = now_ns + RETRY_EVERY_NS
            loss = self._layout.loss
            self._failure = (
                f"{self.path} cannot be written ({error}); {loss}: make room there, or make it writable"
            )
            return False
        self._failure = ""
        self._note_duration(this_machine().elapsed_s() - began_s, now_ns)
        return True

    def _note_duration(self, duration_s: float, now_ns: int) -> None:
        if duration_s <= SLOW_S:
            self._slow_writes = 0
            return
        self._slow_writes += 1
        rest_ns = round(REST_FACTOR * duration_s * NS_PER_S)
        self._rest_until_ns = now_ns + min(rest_ns, MAX_REST_NS)

    def close(self) -> None:
        """Close the file and release the lock."""
        for connection in (self._db, self._lock):
            if connection is not None:
                connection.close()
        self._db = self._lock = None

    def _open_or_replace(self, now_ns: int, read: Callable[[sqlite3.Connection], T]) -> T | None:
        try:
            return self._open(read)
        except (sqlite3.DatabaseError, ValueError) as error:
            if _is_disk_error(error):
                raise
            if self._db is not None:
                self._db.close()
        for suffix in ("", "-wal", "-shm"):
            part = self.path.with_name(self.path.name + suffix)
            if part.exists():
                aside = f"{self._aside}{now_ns}{self.path.suffix}{suffix}"
                part.replace(self.path.with_name(aside))
        return self._open(read)

    def _open(self, read: Callable[[sqlite3.Connection], T]) -> T | None:
        # a short wait suffices for later writes only: what is not read now is not restored
        db = self._db = sqlite3.connect(self.path, timeout=READ_BUSY_S, isolation_level=None)
        version = int(db.execute("PRAGMA user_version").fetchone()[0])
        if version > self._layout.version:
            db.close()
            self._db = None
            self._notice = (
                f"{self.path} was written by a newer version; {self._layout.loss}: update, or move the file "
                "away"
            )
            return None
        if db.execute("PRAGMA quick_check(1)").fetchone()[0] != "ok":
            raise sqlite3.DatabaseError("damaged")
        db.execute("PRAGMA journal_mode = WAL")
        db.execute(f"PRAGMA synchronous = {'NORMAL' if self._layout.is_synced else 'OFF'}")
        db.executescript(self._layout.tables)
        if version != self._layout.version:
            db.execute(f"PRAGMA user_version = {self._layout.version}")
        stored = read(db)
        db.execute(f"PRAGMA busy_timeout = {round(BUSY_S * 1000)}")
        return stored

    @property
    def _aside(self) -> str:
        return f"{self.path.stem}.corrupt-"

    def _note_set_aside(self, now_ns: int) -> None:
        """Report a damaged file that was set aside lately, by this process or an earlier one."""
        paths = self.path.parent.glob(f"{self._aside}*{self.path.suffix}")
        for path in sorted(paths):
            set_aside_ns = path.stem.removeprefix(self._aside)
            if not set_aside_ns.isdecimal():
                continue
            is_recent = 0 <= now_ns - int(set_aside_ns) <= SHOWN_NS
            if is_recent and not self._notice:
                self._notice = (
                    f"{self.path} was damaged and is now {path.name}, and a new file was started: check the "
                    "disk"
                )


def acquire_lock(path: Path, timeout_s: float = 0.0) -> sqlite3.Connection | None:
    """Return the lock at `path`, held until it is closed or the process ends in any way.

    It is an SQLite file in an exclusive transaction.

    Returns:
        The lock, or None if another connection still holds it after `timeout_s`.

    Raises:
        sqlite3.Error: If the file cannot be opened or locked at all.
    """
    lock = sqlite3.connect(path, timeout=timeout_s, isolation_level=None)
    try:
        lock.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:
        lock.close()
        if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
            return None
        raise
    return lock


def read_rows(
    path: Path, statement: str, parameters: Sequence[object], parse: Callable[[Sequence[Any]], T]
) -> Iterator[T]:
    """Yield the result of `parse` for each row of `statement`, also while another process writes the file.

    Raises:
        sqlite3.Error: If the file cannot be read, or `parse` raises a `ValueError`.
    """
    uri = f"{path.absolute().as_uri()}?mode=ro"
    with contextlib.closing(sqlite3.connect(uri, uri=True, timeout=READ_BUSY_S)) as db:
        try:
            for row in db.execute(statement, parameters):
                yield parse(row)
        except ValueError as error:
            raise sqlite3.DatabaseError(f"a row is damaged, {error}") from error


def _is_disk_error(error: Exception) -> bool:
    """Return True if `error` is due to the disk or a lock, not to the file's content."""
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
    return isinstance(error, sqlite3.OperationalError) and code & 0xFF != sqlite3.SQLITE_ERROR
