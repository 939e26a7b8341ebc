"""Snapshot of a conveyor on disk, so that it survives being killed: one SQLite file per site."""

import contextlib
import hashlib
import json
import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pointit.schemas import Environment, SelectionEvent
from pointit.services.conveyor_sim.config import ConveyorSimConfig

_TABLES = """
CREATE TABLE IF NOT EXISTS plant (
    id INTEGER PRIMARY KEY CHECK (id = 1), stamp_ns INTEGER, seq INTEGER, fingerprint TEXT, snapshot TEXT
);
CREATE TABLE IF NOT EXISTS outbox (seq INTEGER PRIMARY KEY, event TEXT);
"""
_SIDES = ("", "-wal", "-shm", "-journal")


class SnapshotError(Exception):
    """Nothing can be saved now; the message is for users."""


@dataclass(frozen=True)
class StoredSnapshot:
    """Snapshot of a previous conveyor."""

    stamp_ns: int
    seq: int
    """Number of the last event."""
    fingerprint: str
    snapshot: Mapping[str, Any]
    events: tuple[SelectionEvent, ...]
    """Events that may be unpublished, in order."""


FILE = "plant.sqlite"


def erase(folder: Path) -> bool:
    """Delete the snapshot in `folder`. Return True if there was one.

    A file that is in use or not accessible stays as it is; the next user of it reports the error.
    """
    if not (folder / FILE).exists():
        return False
    try:
        store = SnapshotStore(folder)
    except SnapshotError:
        return False
    try:
        return store.clear()
    finally:
        store.close()


def fingerprint(environment: Environment, config: ConveyorSimConfig) -> str:
    """Return a hash of what determines the packages' motion in map and configuration."""
    parts = environment.model_dump(include={"belts", "strips", "links", "bays"}, mode="json")
    settings = config.model_dump(exclude={"rate_hz", "tracking", "resume_within_s"}, mode="json")
    text = json.dumps([parts, settings], sort_keys=True)
    if config.schedule:
        with contextlib.suppress(OSError):
            text += Path(config.schedule).expanduser().read_text(encoding="utf-8", errors="replace")
    return hashlib.sha256(text.encode()).hexdigest()


class SnapshotStore:
    """The file, locked while a conveyor has it open; the lock ends with the process.

    Written to the operating system without sync: it survives the death of the process, and is recreated if a
    crash of the machine left it unreadable.
    """

    def __init__(self, folder: Path) -> None:
        """Open the file in `folder`, which is created if missing.

        Raises:
            SnapshotError: If another conveyor has it open, or the disk fails; names the file.
        """
        self.path = folder / FILE
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._file = self._opened()
        except sqlite3.OperationalError as error:
            if "locked" in str(error):
                raise SnapshotError(
                    f"{self.path}: another conveyor of this site runs on this machine and saves its packages "
                    "there; this one saves nothing: stop one of the two"
                ) from error
            raise self._failure(error) from error
        except (sqlite3.Error, OSError) as error:
            raise self._failure(error) from error

    def read(self) -> StoredSnapshot | None:
        """Return the last snapshot, or None if there is none or it is unusable."""
        try:
            row = self._file.execute("SELECT stamp_ns, seq, fingerprint, snapshot FROM plant").fetchone()
            events = self._file.execute("SELECT event FROM outbox ORDER BY seq").fetchall()
            if row is None:
                return None
            return StoredSnapshot(
                row[0],
                row[1],
                row[2],
                json.loads(row[3]),
                tuple(SelectionEvent.model_validate_json(event) for (event,) in events),
            )
        except (sqlite3.Error, ValueError):
            return None

    def commit(
        self,
        stamp_ns: int,
        mark: str,
        snapshot: Mapping[str, Any],
        seq: int,
        events: Sequence[SelectionEvent] = (),
    ) -> None:
        """Replace the stored snapshot by `snapshot` and the unpublished `events`, atomically.

        Raises:
            SnapshotError: If the disk fails; names the file.
        """
        row = (stamp_ns, seq, mark, json.dumps(snapshot, separators=(",", ":")))
        unpublished = [(event.seq, event.model_dump_json(exclude_defaults=True)) for event in events]
        try:
            self._write(row, unpublished)
        except sqlite3.Error as error:
            raise self._failure(error) from error

    def mark_published(self) -> None:
        """Mark the events of the last commit as published.

        Raises:
            SnapshotError: If the disk fails; names the file.
        """
        try:
            with self._file:
                self._file.execute("DELETE FROM outbox")
        except sqlite3.Error as error:
            raise self._failure(error) from error

    def clear(self) -> bool:
        """Delete everything. Return True if there was a snapshot."""
        with contextlib.suppress(sqlite3.Error), self._file:
            self._file.execute("DELETE FROM outbox")
            return self._file.execute("DELETE FROM plant").rowcount > 0
        return False

    def close(self) -> None:
        """Close the file."""
        with contextlib.suppress(sqlite3.Error):
            self._file.close()

    def _write(self, row: tuple[int, int, str, str], unpublished: Sequence[tuple[int, str]]) -> None:
        with self._file:
            self._file.execute("DELETE FROM outbox")
            self._file.execute("INSERT OR REPLACE INTO plant VALUES (1, ?, ?, ?, ?)", row)
            self._file.executemany("INSERT INTO outbox VALUES (?, ?)", unpublished)

    def _opened(self) -> sqlite3.Connection:
        try:
            return self._connected()
        except sqlite3.OperationalError:
            raise
        except sqlite3.DatabaseError:  # corrupt: at most a minute of packages is lost
            for side in _SIDES:
                self.path.with_name(self.path.name + side).unlink(missing_ok=True)
            return self._connected()

    def _connected(self) -> sqlite3.Connection:
        file = sqlite3.connect(self.path, timeout=0.0)
        try:
            file.execute("PRAGMA locking_mode = EXCLUSIVE")
            file.execute("PRAGMA journal_mode = WAL")
            file.execute("PRAGMA synchronous = OFF")
            file.executescript(f"BEGIN IMMEDIATE; {_TABLES} COMMIT;")
            file.execute("SELECT 1 FROM plant").fetchone()
        except BaseException:
            file.close()
            raise
        return file

    def _failure(self, error: Exception) -> SnapshotError:
        return SnapshotError(
            f"{self.path}: cannot be written ({error}); the conveyor continues, but would not survive "
            "a restart: check the disk"
        )
