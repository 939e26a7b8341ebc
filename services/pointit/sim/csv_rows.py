"""Rows of a CSV file in the dialects of spreadsheets and programs.

Byte order marks, UTF-16 and code page 1252, any line ends, commas, semicolons, tabs, bars or blanks, quotes,
and lines of text or comments before the header are read.
"""

import codecs
import csv
import io
import itertools
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from pointit.runtime.errors import ConfigError
from pointit.schemas.text import round_beyond
from pointit.sim.motion_cells import is_lost_cell

MAX_BYTES = 64_000_000
"""Limit of a file: an hour at 1000 Hz. More would use too much memory of a service."""

MAX_HEADER_LINES = 50
"""Number of lines in which the header is looked for."""

COMMENTS = ("#", "//", "%")
"""Beginnings of rows that are ignored."""

_DELIMITERS = "\t;,|"
_QUOTED = re.compile(r'"[^"]*"')
_COMMENT_MARK = re.compile(r"^\s*(#|//|%)+\s*")


class CsvRows(NamedTuple):
    """Header and rows of a file."""

    header_line: int
    header: list[str]
    """Cells of the header, without blanks around them."""
    rows: Iterator[tuple[int, list[str]]]
    """Line and cells of each row that has any. Reading it raises `csv.Error`."""
    delimiter: str
    is_cut: bool
    """True if the last line has no end, as in a file whose writer was ended."""


def read_csv(path: Path, count_known: Callable[[Sequence[str]], int]) -> CsvRows:
    """Return the header and rows of the file at `path`.

    Args:
        path: CSV file.
        count_known: returns the number of known names in a line's cells. The line with most is the header.

    Raises:
        ConfigError: If it cannot be read, is too long, or is no text.
    """
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ConfigError(
                f"{path}: has {round_beyond(size / 1e6, MAX_BYTES / 1e6)} MB and at most "
                f"{MAX_BYTES / 1e6:.0f} MB are read; "
                "cut it into pieces"
            )
        text = _decode(path, path.read_bytes())
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    lines = io.StringIO(text, newline=None)
    first = list(itertools.islice(lines, MAX_HEADER_LINES))
    scores = [(count_known(_cells(line, _delimiter(line))), bool(line.strip())) for line in first]
    index = scores.index(max(scores)) if scores else 0
    line = first[index] if first else ""
    delimiter = _delimiter(line)
    rows = _rows(itertools.chain(first[index + 1 :], lines), delimiter, index + 1)
    is_cut = not text.endswith(("\n", "\r"))
    return CsvRows(index + 1, _cells(line, delimiter), rows, delimiter, is_cut)


def _decode(path: Path, data: bytes) -> str:
    is_utf_16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        try:
            text = data.decode("utf-16" if is_utf_16 else "utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252")  # a spreadsheet's µ or °
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not a CSV text file ({error})") from error
    if "\0" in text:
        raise ConfigError(f"{path}: is not a CSV text file (it has zero bytes); write it as UTF-8 text")
    if not (text.isascii() or re.search("[A-Za-z]", text)):
        raise ConfigError(f"{path}: is not a CSV text file (it has no names of columns)")
    return text


def _delimiter(line: str) -> str:
    unquoted = _QUOTED.sub("", line.strip(" "))
    return next((each for each in _DELIMITERS if each in unquoted.rstrip("\n")), " ")


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a header, which some programs write as a comment."""
    line = _COMMENT_MARK.sub("", line, count=1) if line.lstrip().startswith(COMMENTS) else line
    rows = list(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return [cell.strip() for cell in rows[0]] if rows else []


def _rows(lines: Iterator[str], delimiter: str, before: int) -> Iterator[tuple[int, list[str]]]:
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    for row in reader:
        cells = [cell.strip() for cell in row]
        if any(cells) and (is_lost_cell(cells[0]) or not cells[0].startswith(COMMENTS)):
            yield before + reader.line_num, cells
