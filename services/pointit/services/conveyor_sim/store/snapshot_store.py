"""What a conveyor keeps on disk, so that it survives being killed: one SQLite file a site."""

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
    """Nothing can be kept now; its text is one sentence for a person."""


@dataclass(frozen=True)
class StoredSnapshot:
    """What a conveyor left behind."""

    stamp_ns: int
    seq: int
    """Of the last event."""
    fingerprint: str
    snapshot: Mapping[str, Any]
    events: tuple[SelectionEvent, ...]
    """Those that were perhaps never told, in order."""


FILE = "plant.sqlite"


def erase(folder: Path) -> bool:
    """Let the next conveyor that keeps in `folder` begin anew. Return True if there was something to forget.

    What another conveyor has in use, or the disk does not give, stays as it is: who opens it next says so.
    """
    if not (folder / FILE).exists():
        return False
    try:
        keeping = SnapshotStore(folder)
    except SnapshotError:
        return False
    try:
        return keeping.clear()
    finally:
        keeping.close()


def fingerprint(environment: Environment, config: ConveyorSimConfig) -> str:
    """Return what tells maps and configurations apart on which other packages would move."""
    parts = environment.model_dump(include={"belts", "strips", "links", "bays"}, mode="json")
    settings = config.model_dump(exclude={"rate_hz", "tracking", "resume_within_s"}, mode="json")
    text = json.dumps([parts, settings], sort_keys=True)
    if config.schedule:
        with contextlib.suppress(OSError):
            text += Path(config.schedule).expanduser().read_text(encoding="utf-8", errors="replace")
    return hashlib.sha256(text.encode()).hexdigest()


class SnapshotStore:
    """The file while a conveyor has it; nobody else gets it meanwhile, and a killed one has it no longer.

    Written through to the operating system, not to the platter: it survives the death of the process, and is
    begun anew if the machine's own death left it unreadable.
    """

    def __init__(self, folder: Path) -> None:
        """Open the file in `folder`, which is made when missing.

        Raises:
            NotKeptError: another conveyor has it, or the disk fails; names the file.
        """
        self.path = folder / FILE
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._file = self._opened()
        except sqlite3.OperationalError as error:
            if "locked" in str(error):
                raise SnapshotError(
                    f"{self.path}: another conveyor of this site runs on this machine and keeps its packages "
                    "there; this one keeps nothing: stop one of the two"
                ) from error
            raise self._failure(error) from error
        except (sqlite3.Error, OSError) as error:
            raise self._failure(error) from error

    def read(self) -> StoredSnapshot | None:
        """Return what was kept last; none if there is nothing, or nothing that makes sense."""
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
        """Keep `snapshot`, and `events` that are about to be told, in place of what was kept; all or nothing.

        Raises:
            NotKeptError: the disk fails; names the file.
        """
        row = (stamp_ns, seq, mark, json.dumps(snapshot, separators=(",", ":")))
        untold = [(event.seq, event.model_dump_json(exclude_defaults=True)) for event in events]
        try:
            self._write(row, untold)
        except sqlite3.Error as error:
            raise self._failure(error) from error

    def mark_published(self) -> None:
        """Take note that the events of the last commit have been told.

        Raises:
            NotKeptError: the disk fails; names the file.
        """
        try:
            with self._file:
                self._file.execute("DELETE FROM outbox")
        except sqlite3.Error as error:
            raise self._failure(error) from error

    def clear(self) -> bool:
        """Forget everything. Return True if there was something."""
        with contextlib.suppress(sqlite3.Error), self._file:
            self._file.execute("DELETE FROM outbox")
            return self._file.execute("DELETE FROM plant").rowcount > 0
        return False

    def close(self) -> None:
        """Let go of the file."""
        with contextlib.suppress(sqlite3.Error):
            self._file.close()

    def _write(self, row: tuple[int, int, str, str], untold: Sequence[tuple[int, str]]) -> None:
        with self._file:
            self._file.execute("DELETE FROM outbox")
            self._file.execute("INSERT OR REPLACE INTO plant VALUES (1, ?, ?, ?, ?)", row)
            self._file.executemany("INSERT INTO outbox VALUES (?, ?)", untold)

    def _opened(self) -> sqlite3.Connection:
        try:
            return self._connected()
        except sqlite3.OperationalError:
            raise
        except sqlite3.DatabaseError:  # not SQLite's, or torn: at most a minute of packages is lost
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
            f"{self.path}: cannot be written ({error}); the conveyor goes on, but would not survive "
            "a restart: see to the disk"
        )
