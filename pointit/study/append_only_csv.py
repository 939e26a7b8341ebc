"""Tables to which rows are added: each row survives kill -9, and a spreadsheet that saves the same file."""

import contextlib
import itertools
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pointit.conversion.export_csv import neutralize_formula
from pointit.errors import ConfigError, PointItError
from pointit.runtime.host.state_file import write_atomically
from pointit.study.table_file import COUNTS, NUMBERS, Row, TrialTable, parse_table, table_line

PLAIN = frozenset((*COUNTS, *NUMBERS, "item", "value"))
"""Columns of numbers. Their minus sign starts no formula of a spreadsheet."""


class AppendOnlyCsv:
    """A table of which each row is on the disk when `append` returns, or not there at all.

    Rows are added only to a file that has exactly the bytes that are written here. Beside one that another
    program has rewritten, also meanwhile, they go on in a further file: `trials_2.csv` beside `trials.csv`.
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
            path: the first file.
            columns: columns of the study.
            key: columns whose values name a row; all columns if empty.
            on_note: called with a sentence on changes by a crash or another program.

        Raises: ConfigError: If it cannot be read or written, or another process writes it.
        """
        self.path = path
        self._columns = columns
        self._key = key or columns
        self._on_note = on_note
        self._replayed = frozenset[tuple[str, ...]]()
        self._written: tuple[int, ...] | None = None
        """State of the file after the last row, None while there is no file to which rows can be added."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = self._open_file = path.open("a+b", buffering=0)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be used ({error.strerror or error})") from error
        with contextlib.ExitStack() as unless_used:
            unless_used.callback(self._lock.close)
            _lock(self._lock, path)
            files = table_files(path)
            tables = [parse_table(file, columns) for file in files]
            self.rows = joined_rows(tables)
            self._open(files[-1], tables[-1])
            unless_used.pop_all()

    def append(self, *rows: Mapping[str, object]) -> None:
        """Add rows and wait until they are on the disk.

        Raises: PointItError: If they cannot be written. Nothing of them is there then.
        """
        self._restore_removed_rows()
        texts = [{name: _text(row.get(name)) for name in self._columns} for row in rows]
        self._write([row for row in texts if self._key_of(row) not in self._replayed])
        self.rows += texts

    def replay(self) -> None:
        """Start again without rows. Rows that are already in the file are not written again."""
        self._replayed = frozenset(map(self._key_of, self.rows))
        self.rows = []

    def close(self) -> None:
        """Close the file. Raises: PointItError: If rows that were removed cannot be written again."""
        try:
            self._restore_removed_rows()
        finally:
            self._open_file.close()
            self._lock.close()

    def _open(self, file: Path, table: TrialTable) -> None:
        """Open `file` to append rows. If another program has written it, the next row opens a further one."""
        if changes := column_changes(table, self._columns):
            self._file, self._written = free_path(self.path), None
            self._on_note(f"{rewritten_sentence(file, changes)} New rows go to {self._file.name}.")
            return
        try:
            with contextlib.ExitStack() as unless_used:
                opened = self._open_file = unless_used.enter_context(file.open("a+b", buffering=0))
                if table.tail:
                    aside = free_path(file.with_name(f"incomplete_{file.name}"))
                    write_atomically(aside, table.tail, mode=0o644, durable=True)
                    self._on_note(f"{file}: the last row was cut off and is moved to {aside.name}.")
                    opened.truncate(file.stat().st_size - len(table.tail))
                self._file, self._written = file, _state(opened.fileno())
                if not file.stat().st_size:
                    self._write_lines(table_line(self._columns))
                unless_used.pop_all()
        except OSError as error:
            raise ConfigError(f"{file}: cannot be used ({error.strerror or error})") from error

    def _restore_removed_rows(self) -> None:
        """Write rows again that another program has removed: a spreadsheet, say, that was open meanwhile."""
        with contextlib.suppress(FileNotFoundError):
            if self._written is None or _state(self._file) == self._written:
                return
        self._open_file.close()
        files = table_files(self.path)
        tables = [self._parse_whatever_is_there(file) for file in files]
        self._open(files[-1], tables[-1])
        there = {self._key_of(row) for table in tables for row in table.rows}
        if removed := [row for row in self.rows if self._key_of(row) not in there]:
            self._on_note(
                f"{self.path}: another program has removed {len(removed)} rows; they are written again."
            )
            self._write(removed)

    def _parse_whatever_is_there(self, file: Path) -> TrialTable:
        if not file.exists():
            return TrialTable([], (), b"")
        try:
            return parse_table(file, self._columns)
        except ConfigError as error:
            self._on_note(str(error))
            return TrialTable([], ("it cannot be read",), b"")

    def _key_of(self, row: Row) -> tuple[str, ...]:
        return tuple(row[name] for name in self._key)

    def _write(self, rows: Iterable[Row]) -> None:
        if lines := b"".join(table_line(spreadsheet_row(row).values()) for row in rows):
            if self._written is None:
                self._open(self._file, TrialTable([], (), b""))
            self._write_lines(lines)

    def _write_lines(self, lines: bytes) -> None:
        file = self._open_file
        size = os.fstat(file.fileno()).st_size
        try:
            written = file.write(lines)
            os.fsync(file.fileno())
        except OSError as error:
            written, reason = 0, error.strerror
        else:
            reason = "no space left"
        if is_missing := written != len(lines):
            file.truncate(size)
        self._written = _state(file.fileno())
        if is_missing:
            raise PointItError(
                f"{self._file}: a row cannot be written ({reason}); all earlier ones are there: make "
                "room, then give the same command to go on"
            )


def table_files(path: Path) -> list[Path]:
    """Return the files of a table, in the order in which they were begun: `path`, and those beside it."""
    further = {
        int(found[1]): file
        for file in path.parent.glob(f"{path.stem}_*{path.suffix}")
        if (found := re.fullmatch(r"_([2-9]|[1-9]\d{1,5})", file.stem.removeprefix(path.stem)))
    }
    return [path, *(further[number] for number in sorted(further))]


def joined_rows(tables: Iterable[TrialTable]) -> list[Row]:
    """Return the rows of all files of a table, each once, in the order in which they were measured.

    The rows of files that another program has written, which may have sorted them, are sorted.
    """
    tables = list(tables)
    rows = [row for table in tables for row in table.rows]
    if len(tables) > 1:
        rows = [*{tuple(sorted(row.items())): row for row in rows}.values()]
    if any(table.changes for table in tables):
        rows.sort(key=lambda row: [int(row[name]) for name in ("trial", "attempt") if name in row])
    return rows


def column_changes(table: TrialTable, columns: Sequence[str]) -> tuple[str, ...]:
    """Return the changes of another program in a file of a table, also those of its `columns`."""
    if not table.columns or table.columns == tuple(columns):
        return table.changes
    added = [name for name in table.columns if name not in columns]
    missing = [name for name in columns if name not in table.columns]
    change = f"added column {added[0]}" if added else "columns in another order"
    return (*table.changes, f"no column {missing[0]}, as in earlier versions" if missing else change)


def rewritten_sentence(file: Path, changes: Sequence[str]) -> str:
    """Return a sentence on a file that another program has written."""
    return f"{file}: another program has rewritten it ({', '.join(changes)}); it is read, and left as it is."


def spreadsheet_row(row: Row) -> Row:
    """Return a row with texts that no spreadsheet takes for a formula."""
    return {name: text if name in PLAIN else neutralize_formula(text) for name, text in row.items()}


def free_path(path: Path) -> Path:
    """Return `path`, or the first of those with `_2`, `_3` and so on, where no file is."""
    further = (path.with_stem(f"{path.stem}_{number}") for number in itertools.count(2))
    return next(each for each in itertools.chain([path], further) if not each.exists())


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
