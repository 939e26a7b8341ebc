"""Columns of a recorded motion in a CSV file, in SI units, with gaps where values are missing."""

import csv
import functools
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointit.maps.column_units import split_unit, unit_name
from pointit.runtime.errors import ConfigError
from pointit.schemas import FARTHEST
from pointit.sim.csv_rows import CsvRows, read_csv
from pointit.sim.motion_cells import clock_time_s, is_lost_cell, is_lost_coordinate
from pointit.sim.motion_columns import (
    FLOOR,
    ORIENTATION,
    SUGGESTED_UNITS,
    TIME,
    MotionColumn,
    count_known,
    find_columns,
    units_of,
)
from pointit.sim.plausibility import period_problem
from pointit.sim.track_faults import find_track_faults

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
