"""Tables of recordings: CSV files read by column; errors name the line."""

import contextlib
import csv
import math
import stat
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pointit.geometry.array_types import Array
from pointit.runtime.errors import ConfigError
from pointit.schemas.printable import is_printable
from pointit.schemas.text import system_reason

MAX_BYTES = 64_000_000
"""Limit of a file, which bounds the memory of an evaluation."""

FARTHEST = 1e9
"""Limit of absolute values in a recording, in SI units."""

MAX_COLUMNS = 1000
"""Limit of columns in a header."""

MAX_CHARACTERS = 255
"""Limit of a name or another text."""

RESERVED = "all"
"""Reserved subject of result rows over all subjects."""


@dataclass(frozen=True, kw_only=True)
class RecordingTable:
    """The requested columns of a file."""

    path: Path
    lines: list[int]
    """n: line in the file of each row."""
    numbers: dict[str, Array]
    """n each; NaN for an empty cell where allowed."""
    texts: dict[str, list[str]]
    """n each."""

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.lines)

    def vectors(self, *names: str) -> Array:
        """Return the columns `names` side by side, n x k."""
        columns = [self.numbers[name] for name in names]
        return np.stack(columns, axis=1)

    def only(self, rows: Sequence[int]) -> "RecordingTable":
        """Return the table of these `rows`."""
        lines = [self.lines[row] for row in rows]
        numbers: dict[str, Array] = {}
        for name, values in self.numbers.items():
            numbers[name] = values[rows]
        texts: dict[str, list[str]] = {}
        for name, values in self.texts.items():
            texts[name] = [values[row] for row in rows]
        return RecordingTable(path=self.path, lines=lines, numbers=numbers, texts=texts)

    def rows_by(self, *names: str) -> dict[tuple[str, ...], list[int]]:
        """Return the rows that have the same texts in the columns `names`, in the order of the file."""
        groups = defaultdict[tuple[str, ...], list[int]](list)
        columns = [self.texts[name] for name in names]
        for row, key in enumerate(zip(*columns, strict=True)):
            groups[key].append(row)
        return dict(groups)

    def refuse(self, row: int, quantity: str) -> ConfigError:
        """Return the error for `row`; `quantity` names column, value and remedy."""
        line = self.lines[row]
        return ConfigError(f"{self.path}, line {line}, {quantity}")


def is_file(path: Path) -> bool:
    """Return True if there is a file at `path`.

    Raises:
        ConfigError: If it cannot be accessed, or is something else, such as a folder or a pipe.
    """
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError) as error:
        reason = system_reason(error)
        raise ConfigError(
            f"{shown_path(path)}: cannot be accessed ({reason}); give it another name"
        ) from error
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "a device or a pipe"
        raise ConfigError(f"{path}: a file was expected, and this is {kind}; put the recording there")
    return True


def check_file(path: Path, max_bytes: int = MAX_BYTES) -> None:
    """Check that the file can be read as a whole.

    Raises:
        ConfigError: If there is no file at `path`, or it is too long.
    """
    if not is_file(path):
        raise ConfigError(f"{path}: cannot be read (there is no such file)")
    size = path.stat().st_size
    if size > max_bytes:
        size_mb = size / 1e6
        max_mb = max_bytes / 1e6
        raise ConfigError(f"{path}: has {size_mb:.0f} MB, limit {max_mb:.0f} MB; cut it into pieces")


def shown_path(path: Path) -> str:
    """Return `path` for a message, shortened if too long."""
    text = str(path)
    if len(text) <= 2 * MAX_CHARACTERS:
        return text
    return f"{text[:MAX_CHARACTERS]}..."


def truncate(value: object) -> str:
    """Return `value` for a message, limited to about sixty characters."""
    try:
        text = repr(value)
    except ValueError:  # Python does not format thousands of digits
        return "a number of thousands of digits"
    if len(text) <= 60:
        return text
    return f"{text[:57]}... ({len(text)} characters)"


def check_text(where: str, name: str) -> str:
    """Return `name` after checking that it is a printable, valid name.

    Args:
        where: file, and line or key, for the message; if it ends in 'subject', `name` is a subject's.
        name: text to check.

    Raises:
        ConfigError: If it is empty, too long, not printable, or a subject with the reserved name.
    """
    is_short = 0 < len(name) <= MAX_CHARACTERS
    if not is_short or not is_printable(name):
        expected = f"a text of 1 to {MAX_CHARACTERS} printable characters"
        raise ConfigError(f"{where}: {expected} was expected, got {truncate(name)}")
    if name == RESERVED and where.endswith("'subject'"):
        raise ConfigError(f"{where}: {name!r} is reserved for all subjects; choose another name")
    return name


def read_table(
    path: Path, *, numbers: Sequence[str], texts: Sequence[str] = (), gaps: Sequence[str] = ()
) -> RecordingTable:
    """Return the columns `numbers` and `texts` of the CSV file at `path`; other columns are ignored.

    Args:
        path: CSV file with a header.
        numbers: columns of finite numbers.
        texts: columns of printable texts.
        gaps: columns of `numbers` whose cells may be empty.

    Raises:
        ConfigError: If it cannot be read, is too long, has no rows, a column is missing, a row does not match
            the header, or a cell is not a number within bounds or a text; names file, line, column and value.
    """
    check_file(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            header = [name.strip() for name in next(reader, ())]
            columns = _columns(path, header, (*numbers, *texts))
            # a cell may span lines: the reader's own number is that of its last one
            numbered_rows = ((reader.line_num, row) for row in reader)
            lines, cells = _rows(path, header, columns, numbered_rows)
    except OSError as error:
        reason = system_reason(error)
        raise ConfigError(f"{path}: cannot be read ({reason})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is not a CSV text file ({error})") from error
    if not lines:
        last_line = max(1, reader.line_num)
        raise ConfigError(f"{path}, line {last_line}: there is a header but no rows")

    # the table names the line of a cell that is no number
    text_cells = {name: cells[name] for name in texts}
    table = RecordingTable(path=path, lines=lines, numbers={}, texts=text_cells)
    for name in numbers:
        may_be_empty = name in gaps
        table.numbers[name] = _numbers(table, name, cells[name], may_be_empty=may_be_empty)

    # each text is checked once, at its first line: most are repeated thousands of times
    for name, values in table.texts.items():
        first_lines: dict[str, int] = {}
        for line, text in zip(lines, values, strict=True):
            first_lines.setdefault(text, line)
        for text, line in first_lines.items():
            check_text(f"{path}, line {line}, column {name!r}", text)
    return table


def _columns(path: Path, header: Sequence[str], names: Sequence[str]) -> dict[str, int]:
    """Return the indices of the columns `names`."""
    if len(header) > MAX_COLUMNS:
        problem = f"has {len(header)} columns, and at most {MAX_COLUMNS} were expected"
        raise ConfigError(f"{path}, line 1: {problem}; is it a table with a header?")
    for name in names:
        if header.count(name) != 1:
            names_shown = [truncate(column) for column in header[:40]]
            present = ", ".join(names_shown) or "nothing"
            raise ConfigError(f"{path}, line 1: one column {name!r} was expected, found {present}")
    return {name: header.index(name) for name in names}


def _rows(
    path: Path, header: Sequence[str], columns: dict[str, int], rows: Iterator[tuple[int, list[str]]]
) -> tuple[list[int], dict[str, list[str]]]:
    """Return line numbers and cells of the `columns`, given with their indices, without empty lines."""
    lines: list[int] = []
    cells: dict[str, list[str]] = {name: [] for name in columns}
    width = len(header)
    for line, row in rows:
        if not row:
            continue
        # spreadsheets append empty cells
        surplus = row[width:]
        is_cut_off = len(row) < width
        if is_cut_off or any(map(str.strip, surplus)):
            problem = f"{width} cells were expected, as in the header, got {len(row)}"
            raise ConfigError(
                f"{path}, line {line}: {problem}; is the line cut off, or are there decimal commas?"
            )
        lines.append(line)
        for name, index in columns.items():
            cells[name].append(row[index].strip())
    return lines, cells


def _numbers(table: RecordingTable, name: str, cells: Sequence[str], *, may_be_empty: bool) -> Array:
    values = np.empty(len(cells))
    for row, text in enumerate(cells):
        if may_be_empty and not text:
            values[row] = math.nan
            continue
        values[row] = math.inf
        if "_" not in text:  # reject Python's 1_5
            with contextlib.suppress(ValueError):
                values[row] = float(text)
        # "not": NaN is no number either
        if not abs(values[row]) <= FARTHEST:
            expected = f"a number was expected, within {FARTHEST:g} either way"
            raise table.refuse(row, f"column {name!r}: {expected}, got {truncate(text)}")
    return values
