"""Columns of a recorded motion in a CSV file of any dialect, in SI units, with gaps where values are missing.

Byte order marks, UTF-16 and code page 1252, any line ends, commas, semicolons, tabs, bars or blanks, quotes,
and lines of text or comments before the header are read.
"""

import codecs
import csv
import datetime as dt
import functools
import io
import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointit.maps.column_units import LENGTHS_M, TIMES_S, split_unit, unit_name
from pointit.runtime.errors import ConfigError
from pointit.schemas import FARTHEST
from pointit.schemas.text import round_beyond
from pointit.sim.track_faults import find_track_faults, period_problem

_MISSING = frozenset(
    (
        *("nan", "-nan", "+nan", "nan(ind)", "-nan(ind)", "nat", "na", "n/a", "<na>", "null", "(null)"),
        *("<null>", "\\n", "none", "nil", "missing", "undefined", "lost", "invalid"),
        *("-", "--", "---", ".", "..", "?", "*"),
    )
)
"""Cells of lost values, in lower case, besides empty ones."""
_ERROR = re.compile(r"#[^\W\d][\w/]*[!?]|#n/?[av]|#{2,}|[+-]?\d\.#\w+|err:\d+")
"""Errors of spreadsheets in any language (`#DIV/0!`, `#WERT!`, `Err:502`) and of C libraries (`1.#QNAN`)."""
_NO_COORDINATE = re.compile(r"-?9{4,}|-?214748364[78]")
"""Coordinate of a lost marker in some programs."""
MAX_NUMBER = 1e20
"""Limit of numbers. Those beyond are marks of lost values, as `-3.697314E+028` of NDI's trackers is."""


def is_lost_cell(text: str) -> bool:
    """Return True if programs write `text` for a value that is not known."""
    word = text.strip().lower()
    return not word or word in _MISSING or bool(_ERROR.fullmatch(word)) or is_lost_coordinate(text)


def is_lost_coordinate(text: str) -> bool:
    """Return True if programs write the number `text` for a coordinate that is not known."""
    try:
        number = float(text.replace(",", "."))
    except ValueError:
        return False
    is_beyond = MAX_NUMBER < abs(number) < math.inf
    return is_beyond or _NO_COORDINATE.fullmatch(text.partition(".")[0].partition(",")[0]) is not None


def clock_time_s(text: str) -> float:
    """Return a time of day or a date with time (ISO 8601; UTC if it states no zone), s; NaN if it is none."""
    try:
        if re.fullmatch(r"\d{1,2}:\d\d:\d\d([.,]\d+)?", text):
            hours, minutes, seconds = text.replace(",", ".").split(":")
            return int(hours) * 3600.0 + int(minutes) * 60.0 + float(seconds)
        time = dt.datetime.fromisoformat(text.replace(",", "."))
    except ValueError:
        return math.nan
    return (time if time.tzinfo else time.replace(tzinfo=dt.UTC)).timestamp()


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


TIME = "t"
ORIENTATION = ("qx", "qy", "qz", "qw")
ROBOT = ("robot_x", "robot_y", "robot_z")
HEAD = ("head_x", "head_y", "head_z")
FLOOR = ("px", "py")

_ALIASES: dict[str, tuple[str, ...]] = {
    TIME: ("t", "time", "timestamp", "ts", "stamp", "elapsed", "elapsedtime", "datetime", "epoch"),
    **{
        name: (name, *(word + name[1:] for word in ("quat", "quaternion", "orientation")))
        for name in ORIENTATION
    },
    **{
        name: (body + axis, f"{body}pos{axis}", f"{body}position{axis}")
        for name in (*ROBOT, *HEAD)
        for body, axis in [name.split("_")]
    },
    **{name: (name,) for name in FLOOR},
}
"""Names without blanks and underscores, by name in the documentation. The first that a file has is used."""

_WITHOUT_UNIT = {"": 1.0, "1": 1.0, "unitless": 1.0}
_TIMES_S = {"": 1.0, **TIMES_S}
_LENGTHS_M = {"": 1.0, **LENGTHS_M}
_CAMEL = re.compile(r"(?<=[a-z\d])(?=[A-Z])")

SUGGESTED_UNITS = {TIME: ("s", "ms", "us", "ns", "min", "hours", "days"), "": ("m", "cm", "mm", "in", "ft")}
"""Units named in messages, by column; `""`: positions."""


class MotionColumn(NamedTuple):
    """A column of a recorded motion: its index, name and unit in the file."""

    position: int
    """Index in the rows."""
    title: str
    """Its name in the file."""
    unit: str
    """`""` if the file does not state it."""
    factor: float = 1.0
    """Size of the unit in SI units."""


def units_of(name: str) -> Mapping[str, float]:
    """Return the known units of a column, and what they are in SI units."""
    if name in ORIENTATION:
        return _WITHOUT_UNIT
    return _TIMES_S if name == TIME else _LENGTHS_M


def find_columns(header: Sequence[str]) -> dict[str, list[MotionColumn]]:
    """Return the columns for each name of the documentation that the file has."""
    by_title: dict[str, list[MotionColumn]] = {}
    for index, cell in enumerate(header):
        title, unit = split_unit(cell if re.search(r"[\[({<]", cell) else _CAMEL.sub("_", cell))
        by_title.setdefault(title.replace("_", ""), []).append(MotionColumn(index, cell, unit))
    found: dict[str, list[MotionColumn]] = {}
    for name, aliases in _ALIASES.items():
        exact = [MotionColumn(index, cell, "") for index, cell in enumerate(header) if cell == name]
        alias = next((each for each in aliases if each in by_title), None)
        if exact or alias is not None:
            found[name] = exact or by_title[str(alias)]
    return found


def count_known(cells: Sequence[str]) -> int:
    """Return the number of names of the documentation for which `cells` have a column."""
    return len(find_columns(cells))


Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_TIME_S = 1e12
"""Maximum absolute time, s."""


class MotionTable:
    """The columns of a file that are used, in SI units."""

    def __init__(self, path: Path, required: Sequence[str], optional: Sequence[Sequence[str]]) -> None:
        """Read the columns `required`, and those of each group of `optional` of which the file has one.

        Raises:
            ConfigError: If it cannot be read, is too long, a column is missing, twice or has an unknown unit,
                a cell is no number within bounds, or there are no rows. Names file, line, column and value.
        """
        self._path = path
        self._decimal_mark = ""
        """`"."` or `","` once a number with one was read: a file has only one of them."""
        self.notes: list[str] = []
        """Sentences about what is missing or left out."""
        source = read_csv(path, count_known)
        names = find_columns(source.header)
        present = [name for group in optional if names.keys() & set(group) for name in group]
        self._header_line = source.header_line
        self._columns = {name: self._column(name, names, source.header) for name in (*required, *present)}
        self._cells = itemgetter(*(column.position for column in self._columns.values()))
        lines: list[int] = []
        values: list[list[float]] = []
        try:
            for line, row in self._whole_rows(source):
                if values or not self._read_units(row):
                    lines.append(line)
                    values.append(
                        self._plain_numbers(row)
                        or [self._value(line, *each, row) for each in self._columns.items()]
                    )
        except csv.Error as error:
            raise ConfigError(f"{path}: is not a CSV text file ({error})") from error
        if not values:
            raise ConfigError(f"{path}, line {self._header_line}: there is a header but no samples")
        self.lines = np.array(lines, dtype=np.int64)
        """n: line in the file of each row."""
        self._values = np.array(values, dtype=np.float64) * [each.factor for each in self._columns.values()]

    @property
    def names(self) -> Sequence[str]:
        """Return the columns that were read, by the names of the documentation."""
        return tuple(self._columns)

    def title(self, name: str) -> str:
        """Return the name of a column in the file."""
        return self._columns[name].title

    def states_units(self, names: Sequence[str]) -> bool:
        """Return True if the file states the units of all `names`."""
        return all(self._columns[name].unit for name in names)

    def times(self) -> Array:
        """Return the times, n, s.

        Raises:
            ConfigError: If they do not rise, or are likely not in the unit that the file states, or seconds.
        """
        times_s = self._values[:, self.names.index(TIME)]
        falls = np.flatnonzero(np.diff(times_s) <= 0.0)
        if len(falls):
            row = int(falls[0]) + 1
            what = "time stands still" if times_s[row] == times_s[row - 1] else "time goes backwards"
            raise ConfigError(
                f"{self._path}, line {self.lines[row]}, column {self.title(TIME)!r}: {what}, "
                f"{times_s[row]:.12g} after {times_s[row - 1]:.12g} s; each row needs a later time than the "
                "one before: write more digits, or remove it"
            )
        if problem := period_problem(times_s):
            if not self._columns[TIME].unit:
                raise ConfigError(f"{self._path}, column {self.title(TIME)!r}: {problem}")
            self.notes.append(
                f"{self.title(TIME)!r}: {problem.partition(';')[0]}; check the unit that it states"
            )
        if len(late := np.flatnonzero(np.abs(times_s) > MAX_TIME_S)):
            raise ConfigError(
                f"{self._path}, line {self.lines[late[0]]}, column {self.title(TIME)!r}: a number within "
                f"{MAX_TIME_S:g} was expected, got {times_s[late[0]]:.12g} s; write seconds, or ISO 8601"
            )
        return times_s

    def vectors(self, body: str, names: Sequence[str]) -> Array:
        """Return columns side by side, n x k, SI. Rows in which the body is lost are NaN, and noted.

        It is lost where a value is missing, where all are exactly 0, or all are the same 9999…, or a constant
        far from the rows around it, and where it jumps away for one row.
        """
        vectors = self._values[:, [self.names.index(name) for name in names]]
        is_same = (vectors == vectors[:, :1]).all(axis=1)
        is_marked = np.zeros(len(vectors), dtype=bool)
        for row in np.flatnonzero(is_same & (vectors[:, 0] != 0.0)).tolist():
            value = vectors[row, 0] / self._columns[names[0]].factor
            is_marked[row] = is_lost_coordinate(f"{value:.0f}") or (names == ORIENTATION and value < 0.0)
        is_missing = ~np.isfinite(vectors).all(axis=1) | (vectors == 0.0).all(axis=1) | is_marked
        columns = f"{body} ({self.title(names[0])!r} to {self.title(names[-1])!r})"
        if is_missing.any():
            self.notes.append(f"{columns}: missing in {self._rows_text(is_missing)}; left out")
        known = np.where(is_missing[:, None], np.nan, vectors)
        is_lost = self._note_faults(columns, known, is_turn=names == ORIENTATION, has_course=names != FLOOR)
        return np.where(is_lost[:, None], np.nan, known)

    def _note_faults(self, columns: str, vectors: Array, *, is_turn: bool, has_course: bool) -> Mask:
        """Return True for rows of `vectors` that are lost, n, and note these and jumps."""
        times_s = self._values[:, self.names.index(TIME)]
        faults = find_track_faults(times_s, vectors, is_turn=is_turn, has_course=has_course)
        for is_row, problem, remedy in faults.sentences(vectors):
            self.notes.append(f"{columns}: {problem} in {self._rows_text(is_row)}; {remedy}")
        return faults.constant | faults.one_row

    def _rows_text(self, is_row: Mask) -> str:
        """Return the number of rows, gaps and the first line of the rows `is_row`."""
        times_s = self._values[:, self.names.index(TIME)]
        ends = np.flatnonzero(np.diff(is_row.astype(int), prepend=0, append=0)).reshape(-1, 2)
        longest_s = max(
            times_s[min(end, len(times_s) - 1)] - times_s[max(begin - 1, 0)] for begin, end in ends
        )
        gaps = f"{len(ends)} gap{'' if len(ends) == 1 else 's'} of up to {longest_s:.2f} s"
        first = self.lines[int(ends[0][0])]
        return f"{is_row.sum()} of {len(is_row)} rows, {gaps}, the first in line {first}"

    def _column(
        self, name: str, names: Mapping[str, Sequence[MotionColumn]], header: Sequence[str]
    ) -> MotionColumn:
        at, columns = f"{self._path}, line {self._header_line}", names.get(name, ())
        known = [column for column in columns if column.unit in units_of(name)] or columns
        if not known:
            angles = {"yaw", "pitch", "roll"} & {split_unit(cell)[0] for cell in header}
            hint = (
                "; angles state no order of rotation, write quaternions"
                if angles and name in ORIENTATION
                else ""
            )
            found = ", ".join(header) or "nothing"
            raise ConfigError(f"{at}: column {name!r} is missing, found {found}{hint}")
        if len(known) > 1:
            titles = " and ".join(repr(column.title) for column in known)
            raise ConfigError(f"{at}: column {name!r} is there more than once: {titles}; rename all but one")
        if known[0].unit not in units_of(name):
            units = ", ".join(SUGGESTED_UNITS.get(name, SUGGESTED_UNITS[""]))
            raise ConfigError(
                f"{at}, column {known[0].title!r}: the unit {known[0].unit!r} is unknown; "
                f"{'write none' if name in ORIENTATION else f'write one of {units}'}"
            )
        return _with_unit(name, known[0], known[0].unit)

    def _read_units(self, row: Sequence[str]) -> bool:
        """Return True if `row` has units, as some programs write below the names, and use them."""
        cells = {
            name: row[each.position] if each.position < len(row) else ""
            for name, each in self._columns.items()
        }
        units = {name: unit_name(cell.strip("[](){}")) for name, cell in cells.items()}
        if not any(units.values()) or any(unit not in units_of(name) for name, unit in units.items()):
            return False
        self._columns = {
            name: each if each.unit else _with_unit(name, each, units[name])
            for name, each in self._columns.items()
        }
        return True

    def _whole_rows(self, source: CsvRows) -> Iterator[tuple[int, list[str]]]:
        """Yield the rows. A last one that was not written to its end is left out, and noted."""
        length = len(source.header)
        end: tuple[int, list[str]] = (0, [])
        for (line, row), (next_line, _) in itertools.pairwise(itertools.chain(source.rows, [end])):
            is_short = len(row) < length
            if is_short and source.is_cut and not next_line:
                self.notes.append(f"line {line}: is cut off, left out")
                continue
            if any(row[length:]) or (is_short and source.delimiter == " "):
                remedy = (
                    "write NaN for a lost value, or separate the cells by commas"
                    if is_short
                    else "name each column; if numbers have decimal commas, separate the cells by semicolons"
                )
                raise ConfigError(
                    f"{self._path}, line {line}: has {len(row)} cells, and the header {length}; {remedy}"
                )
            yield line, row

    @functools.cached_property
    def _plain_limit(self) -> float:
        """Return the number up to which all columns are within `FARTHEST`, once their units are known."""
        return FARTHEST / max(each.factor for each in self._columns.values())

    def _plain_numbers(self, row: Sequence[str]) -> list[float]:
        """Return the numbers in `row` in the file's units, or `[]` if one is missing or needs `_value`.

        Most rows have only plain numbers, and this is faster.
        """
        try:
            cells = self._cells(row)
            text = "".join(cells)
            if "," in text or "_" in text or self._decimal_mark == ",":
                return []
            time, *numbers = map(float, cells)
        except (IndexError, ValueError):
            return []
        limit = self._plain_limit
        if not (math.isfinite(time) and min(numbers) >= -limit and max(numbers) <= limit):
            return []
        self._decimal_mark = "." if "." in text else self._decimal_mark
        return [time, *numbers]

    def _value(self, line: int, name: str, column: MotionColumn, row: Sequence[str]) -> float:
        """Return a cell in the unit of its column, NaN if it is missing."""
        text = row[column.position] if column.position < len(row) else ""
        value, limit = self._number(text), MAX_TIME_S if name == TIME else FARTHEST
        if abs(value * column.factor) <= limit:
            return value
        remedy = "write seconds, or ISO 8601" if name == TIME else "correct it, or leave a lost value empty"
        if set(text) & ({",", "."} - {self._decimal_mark}) and self._decimal_mark:
            remedy = f"numbers before it have the decimal mark {self._decimal_mark!r}: {remedy}"
        error = (
            f"{self._path}, line {line}, column {column.title!r}: a number within {limit:g} was expected, "
            f"got {text[:40]!r}; {remedy}"
        )
        if name == TIME:
            if math.isnan(value):
                value = clock_time_s(text) / column.factor
                self._columns[TIME] = column._replace(unit=column.unit or "s")
            if not math.isfinite(value):
                raise ConfigError(error)
            return value  # the time between samples may tell its unit, if it is too large
        if is_lost_cell(text):
            return math.nan
        raise ConfigError(error)

    def _number(self, text: str) -> float:
        """Return the number in `text`, NaN if there is none or it has another decimal mark than the file."""
        try:
            number = float(text.strip("'").replace("_", "?").replace(",", "."))
        except ValueError:
            return math.nan
        mark = next((each for each in ",." if each in text), self._decimal_mark)
        self._decimal_mark = self._decimal_mark or mark
        return number if mark == self._decimal_mark else math.nan


def _with_unit(name: str, column: MotionColumn, unit: str) -> MotionColumn:
    return column._replace(unit=unit, factor=units_of(name)[unit])


def column_names(path: Path) -> set[str]:
    """Return the names of the documentation for which the CSV file at `path` has a column.

    Raises:
        ConfigError: If it cannot be read.
    """
    return set(find_columns(read_csv(path, count_known).header))


def rows_of(vectors: Array) -> Iterator[tuple[int, list[float]]]:
    """Yield number and values of the rows of `vectors` without NaN."""
    for row in np.flatnonzero(np.isfinite(vectors).all(axis=1)).tolist():
        yield row, vectors[row].tolist()
