"""Tables of an exported recording: a CSV file each, and the dictionary of their columns."""

import csv
from collections.abc import Collection, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, Self

from pointit.conversion.columns import Cell, Column
from pointit.runtime.errors import ConfigError

PART = ".part"
"""Suffix of files that are being written. They get their names when all are complete."""

DICTIONARY = "columns.csv"
"""Table that describes the columns of all others."""


class Tables:
    """A folder of CSV files, opened with their first row, complete or absent.

    As a context manager it completes them; after an exception it removes what it has written.
    """

    def __init__(self, folder: Path, names: Collection[str], *, overwrite: bool) -> None:
        """Create `folder` if it does not exist.

        Args:
            folder: gets the tables.
            names: all files that there may be. Those of an earlier export are removed in the end.
            overwrite: whether there may be any.

        Raises:
            ConfigError: If it cannot be created, or has such files and they may not be overwritten.
        """
        self._folder = folder
        self._names = {DICTIONARY, *names}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            found = sorted(name for name in self._names if (folder / name).exists())
        except OSError as error:
            raise ConfigError(f"{folder}: cannot be used as a folder ({error.strerror or error})") from error
        if found and not overwrite:
            more = f" and {len(found) - 1} more" if len(found) > 1 else ""
            raise ConfigError(
                f"{folder}: has {found[0]}{more}; give another folder, or --overwrite to replace tables"
            )
        self._open = ExitStack()
        self._files: dict[str, IO[str]] = {}
        self._writers: dict[str, Any] = {}
        self.rows: dict[str, int] = {}
        """Number of rows by name of the file."""
        self._add(DICTIONARY, ("file", "column", "unit", "description"))

    def create(self, name: str, columns: Sequence[Column]) -> None:
        """Begin the table `name` and describe its `columns`."""
        self._add(name, [column.name for column in columns])
        for column in columns:
            self.write(DICTIONARY, (name, column.name, column.unit, column.about))

    def write(self, name: str, cells: Sequence[Cell]) -> None:
        """Add a row to a table that was begun."""
        self._writers[name].writerow(cells)
        self.rows[name] += 1

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close all files; give them their names, or remove them after an exception."""
        parts = {name: self._folder / f"{name}{PART}" for name in self._files}
        try:
            self._open.close()  # which writes the rest, and may find the disk full
            if kind is None:
                for name, part in parts.items():
                    part.replace(self._folder / name)
                for name in self._names - set(self._files):
                    (self._folder / name).unlink(missing_ok=True)
        finally:
            for part in parts.values():
                part.unlink(missing_ok=True)

    def _add(self, name: str, titles: Sequence[str]) -> None:
        file = (self._folder / f"{name}{PART}").open("w", encoding="utf-8", newline="")
        self._files[name] = self._open.enter_context(file)
        self._writers[name] = csv.writer(file, lineterminator="\n")
        self._writers[name].writerow(titles)
        self.rows[name] = 0
