"""Tables to which rows are only added: each row survives kill -9, and another program that saves the file."""

import contextlib
import itertools
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pointit.errors import ConfigError, PointItError
from pointit.runtime.host.state_file import write_atomically
from pointit.schemas.text import system_reason
from pointit.study.table_file import REMEDY, Row, parse_table, spreadsheet_row, table_line


class AppendOnlyCsv:
    """A table of which each row is on the disk when `append` returns, or not there at all.

    Rows are added only to a file that has exactly the bytes that are written here.
    """

    def __init__(
        self,
        path: Path,
        columns: Sequence[str],
        key: Sequence[str] = (),
        on_note: Callable[[str], object] = lambda _: None,
    ) -> None:
        """Open or create the table. A row that was cut off by a crash is moved to a file of its own.

        Args:
            path: the file.
            columns: columns of the study.
            key: columns whose values name a row; all columns if empty.
            on_note: called with a sentence on a row that was cut off.

        Raises: ConfigError: If it cannot be read or written, another program has rewritten it, or another
            process writes it.
        """
        self.path = path
        self._columns = columns
        self._key = key or columns
        self._replayed = frozenset[tuple[str, ...]]()
        self._is_usable = True
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a+b", buffering=0)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be used ({system_reason(error)})") from error
        with contextlib.ExitStack() as unless_used:
            unless_used.callback(self._file.close)
            _lock(self._file, path)
            table = parse_table(path, columns)
            if table.tail:
                self._move_aside(table.tail, on_note)
            self.rows = table.rows
            self._stored = [*table.rows]
            """Rows on the disk, also those that are replayed."""
            if not path.stat().st_size:
                self._write_lines(table_line(columns))
            self._written = _state(self._file.fileno())
            unless_used.pop_all()

    def append(self, *rows: Mapping[str, object]) -> None:
        """Add rows and wait until they are on the disk.

        Raises: PointItError: If they cannot be written, or another program has changed the file. All rows are
            in a file beside it then.
        """
        texts: list[Row] = []
        fresh: list[Row] = []
        for row in rows:
            text_row = {name: _text(row.get(name)) for name in self._columns}
            texts.append(text_row)
            if self._key_of(text_row) not in self._replayed:
                fresh.append(text_row)
        self._check_unchanged(fresh)
        if fresh:
            self._write_lines(_lines(fresh))
        self._stored += fresh
        self.rows += texts

    def replay(self) -> None:
        """Start again without rows. Rows that are already in the file are not written again."""
        self._replayed = frozenset(map(self._key_of, self.rows))
        self.rows = []

    def close(self) -> None:
        """Close the file. Raises: PointItError: If another program has changed it."""
        try:
            self._check_unchanged([])
        finally:
            self._file.close()

    def _move_aside(self, tail: bytes, on_note: Callable[[str], object]) -> None:
        aside = free_path(self.path.with_name(f"incomplete_{self.path.name}"))
        try:
            write_atomically(aside, tail, mode=0o644, durable=True)
            self._file.truncate(self.path.stat().st_size - len(tail))
        except OSError as error:
            raise ConfigError(f"{aside}: cannot be written ({system_reason(error)})") from error
        on_note(f"{self.path}: the last row was cut off and is moved to {aside.name}.")

    def _check_unchanged(self, fresh: Sequence[Row]) -> None:
        """Check that the file has the bytes that were written; else store them, and `fresh`, beside it."""
        if not self._is_usable:
            return
        if self.path.exists() and _state(self.path) == self._written:
            return

        # The time of change may differ with the same content: backups and editors touch files.
        content = table_line(self._columns) + _lines(self._stored)
        if self.path.exists() and self._is_same(content):
            self._written = _state(self.path)
            return

        self._is_usable = False
        aside = free_path(self.path.with_name(f"measured_{self.path.name}"))
        write_atomically(aside, content + _lines(fresh), mode=0o644, durable=True)
        raise PointItError(
            f"{self.path}: another program has changed it while rows were added; all "
            f"{len(self._stored) + len(fresh)} rows are in {aside.name}: move that to {self.path.name} to go "
            f"on, or {REMEDY}"
        )

    def _is_same(self, content: bytes) -> bool:
        """Return True if the open file and the file at its path are one, and have `content`."""
        with self.path.open("rb") as file:
            is_same_file = os.path.sameopenfile(file.fileno(), self._file.fileno())
            return is_same_file and file.read() == content

    def _key_of(self, row: Row) -> tuple[str, ...]:
        return tuple(row[name] for name in self._key)

    def _write_lines(self, lines: bytes) -> None:
        file = self._file
        size = os.fstat(file.fileno()).st_size
        try:
            written = file.write(lines)
            os.fsync(file.fileno())
        except OSError as error:
            written = 0
            reason = system_reason(error)
        else:
            reason = "no space left"

        # Half a row does not stay.
        is_incomplete = written != len(lines)
        if is_incomplete:
            file.truncate(size)
        self._written = _state(file.fileno())
        if is_incomplete:
            raise PointItError(
                f"{self.path}: a row cannot be written ({reason}); all earlier ones are there: make "
                "room, then give the same command to go on"
            )


def _lines(rows: Iterable[Row]) -> bytes:
    return b"".join(table_line(spreadsheet_row(row).values()) for row in rows)


def free_path(path: Path) -> Path:
    """Return `path`, or the first of those with `_2`, `_3` and so on, where no file is."""
    free = path
    for number in itertools.count(2):
        if not free.exists():
            break
        free = path.with_stem(f"{path.stem}_{number}")
    return free


def _state(file: int | Path) -> tuple[int, ...]:
    """Return device, inode, size and time of a file: they differ after another program has saved it."""
    stat = os.stat(file)  # noqa: PTH116 - of a descriptor, too
    return stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _lock(file: Any, path: Path) -> None:
    try:
        import fcntl  # noqa: PLC0415 - not on Windows
    except ImportError:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise ConfigError(f"{path}: another process runs this participant") from error
