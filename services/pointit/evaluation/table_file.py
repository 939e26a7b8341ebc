"""Tables of recordings: CSV files, column by column, refused with the line where they are wrong."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointit.runtime.errors import ConfigError

Array = NDArray[np.float64]

MAX_BYTES = 64_000_000
"""More does not fit the memory that an evaluation should take."""

FARTHEST = 1e9
"""No value of a recording is beyond, in SI units."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """The columns that were asked for."""

    path: Path
    numbers: dict[str, Array]
    """n each; NaN where the cell is empty and may be."""
    texts: dict[str, list[str]]
    """n each."""

    def __len__(self) -> int:
        """Return the number of rows."""
        numbers, texts = map(len, self.numbers.values()), map(len, self.texts.values())
        return max((*numbers, *texts), default=0)

    def vectors(self, *names: str) -> Array:
        """Return the columns `names` side by side, n x k."""
        return np.stack([self.numbers[name] for name in names], axis=1)


def read_table(
    path: Path, *, numbers: Sequence[str], texts: Sequence[str] = (), gaps: Sequence[str] = ()
) -> Table:
    """Return the columns `numbers` and `texts` of the CSV file at `path`; other columns are ignored.

    Args:
        path: has a header.
        numbers: columns of finite numbers.
        texts: columns taken as they are.
        gaps: those of `numbers` whose cells may be empty.

    Raises:
        ConfigError: names file, line, column and value: it cannot be read, is too long, has no rows, a column
            is missing, a cell is no number within bounds.
    """
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ConfigError(
                f"{path}: has {size / 1e6:.0f} MB and at most {MAX_BYTES / 1e6:.0f} MB are read; "
                "cut it into pieces"
            )
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.reader(file))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is not a CSV text file ({error})") from error
    header = [name.strip() for name in rows[0]] if rows else []
    for name in (*numbers, *texts):
        if header.count(name) != 1:
            found = ", ".join(header) or "nothing"
            raise ConfigError(f"{path}, line 1: one column {name!r} was expected, found {found}")
    body = [(line, row) for line, row in enumerate(rows[1:], start=2) if row]
    if not body:
        raise ConfigError(f"{path}, line {max(1, len(rows))}: there is a header but no rows")
    return Table(
        path=path,
        numbers={
            name: _numbers(path, name, header.index(name), body, may_be_empty=name in gaps)
            for name in numbers
        },
        texts={
            name: [row[index].strip() if index < len(row) else "" for _, row in body]
            for name, index in ((name, header.index(name)) for name in texts)
        },
    )


def _numbers(
    path: Path, name: str, index: int, body: Sequence[tuple[int, list[str]]], *, may_be_empty: bool
) -> Array:
    values = np.empty(len(body))
    for i, (line, row) in enumerate(body):
        text = row[index].strip() if index < len(row) else ""
        if may_be_empty and not text:
            values[i] = math.nan
            continue
        try:
            values[i] = float(text)
        except ValueError:
            values[i] = math.inf
        if not abs(values[i]) <= FARTHEST:
            raise ConfigError(f"{path}, line {line}, column {name!r}: a number was expected, got {text!r}")
    return values
