"""Text tables of other programs: the line that names their columns, and columns that the user declares.

A line names the columns, in upper or lower case, perhaps behind `#`, `//` or `%`. Lines above it are passed
over. If all columns are declared by number, the rows begin at the first line with numbers in them.
Tabs, semicolons, commas or blanks part the cells. Where it is not the comma, numbers may have decimal commas.
"""

import csv
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from pointit.maps.units import size_of_unit
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError

Wanted = Mapping[str, str | int]
"""Names of columns of a file, or their numbers from 1, by our names."""

MAX_HEADER_LINES = 1000
"""Number of lines in which the line that names the columns is looked for."""
MAX_LINE = 100_000
"""Limit of the characters of a line."""
MAX_SHOWN = 12
"""Number of cells that a message shows."""
LOST = frozenset(("", "nan", "-nan", "n/a"))
"""Cells of lost values, in lower case."""
COMMENTS = ("#", "//", "%")
"""Beginnings of lines that are no rows."""
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}(,[0-9]{3})+")
"""Numbers with a comma that may part thousands or begin decimals."""
_COMMENT_START = re.compile(r"\A *(?:#|//|%)*")
"""Optional prefix of the line of column names. One slash begins a name, such as `/imu/orientation/w`."""
_COUNTER = re.compile(r"(.+)/([1-9][0-9]?)bit")
"""Column and unit, and the number of bits of a counter."""
_QUOTED = re.compile(r'"[^"]*"')


def check_lengths(lines: Iterable[str], where: str = "") -> Iterator[str]:
    """Yield `lines`.

    Raises:
        ConfigError: If one is too long for a table. The sentence begins with `where`.
    """
    for number, line in enumerate(lines, start=1):
        if len(line) > MAX_LINE:
            raise ConfigError(
                f"{where}line {number}: has {len(line)} characters, limit {MAX_LINE}; remove or cut it"
            )
        yield line


class DeclaredColumn(NamedTuple):
    """Column of a file for one of our columns, as the user declares it."""

    source: str | int
    """Its name, or number from 1."""
    unit: str = ""
    """Name of its unit, or size in SI units; `""`: metres or seconds."""
    counter_bits: int = 0
    """Number of bits of a counter that starts again at 0 after its largest number, or 0."""


def header_names(sample: Iterable[str]) -> frozenset[str]:
    """Return the cells of the lines `sample`, in lower case: the names of columns are among them."""
    names: set[str] = set()
    for line in sample:
        if "/" not in line:  # other names cannot be mistaken for a name and a unit
            continue
        cells = split_cells(_COMMENT_START.sub("", line), delimiter_of(line))
        names |= {cell.casefold() for cell in cells}
    return frozenset(names)


def parse_columns(
    text: str,
    known: Mapping[str, Mapping[str, float]],
    names: Collection[str] = frozenset(),
    counters: Collection[str] = (),
) -> dict[str, DeclaredColumn]:
    """Return the columns that `t=time/ms,x=3,y=cm` declares.

    Args:
        text: `OURS=COLUMN/UNIT` each, `COLUMN` a name or number from 1; either part may be left out.
        known: our names, each with its units.
        names: names of the file's columns in lower case, those with a slash at least. They need no unit.
        counters: those of our names that may have `/32bit` behind the unit, or another number of bits.

    Raises:
        ConfigError: If it is not such.
    """
    columns: dict[str, DeclaredColumn] = {}
    for untrimmed in text.split(","):
        part = untrimmed.strip()
        if not part:
            continue
        name, value = _name_and_value(part)
        if not value or name not in known or name in columns:
            raise ConfigError(
                f"columns: {format_value(part)} declares no column; write {join_names(known)} each once, "
                "such as t=time/ms or x=3"
            )
        counter_bits = 0
        if name in counters:
            value, counter_bits = _without_bits(value)
        source, unit = _column_and_unit(value, known[name], names)
        try:
            if unit:
                size_of_unit(unit, {**known[name]})
        except ValueError:
            units = join_names(known[name]) or "none"
            raise ConfigError(
                f"columns: {format_value(part)} has no known unit; write {units}, or its size in SI units; "
                f"if {format_value(value)} is a column of the file, write its number, such as {name}=1"
            ) from None

        # Without a column, it is that of our name
        column = int(source) if source.isdecimal() else source or name
        columns[name] = DeclaredColumn(column, unit, counter_bits)
    return columns


def _name_and_value(part: str) -> tuple[str, str]:
    """Return the texts before and behind the first `=`, `""` if there is none, without blanks."""
    name, _, value = part.partition("=")
    return name.strip(), value.strip()


def _column_and_unit(value: str, units: Collection[str], names: Collection[str]) -> tuple[str, str]:
    """Return column and unit of `COLUMN/UNIT`, of which either may be left out.

    A name with a slash that the file has, but not its part before, is a column. A lone word is a unit if
    there is one of that name.
    """
    source, slash, unit = value.rpartition("/")
    if not slash:
        return ("", value) if value in units else (value, "")
    if value.casefold() in names and source.casefold() not in names:
        return value, ""
    return source, unit


def _without_bits(value: str) -> tuple[str, int]:
    """Return `COLUMN/UNIT` of `COLUMN/UNIT/32bit`, and 32; `value` and 0 if it has no such end."""
    counter = _COUNTER.fullmatch(value)
    return (value, 0) if counter is None else (counter[1], int(counter[2]))


class TextLayout(NamedTuple):
    """Structure of a table."""

    skip: int
    """Number of lines before its rows."""
    delimiter: str
    width: int
    """Number of cells of a row."""
    indices: dict[str, int]
    """Indices of cells by our names."""
    names: Sequence[str]
    """Names of all columns, empty if they are declared by number."""
    remedy: str

    def check_row(self, line: int, cells: Sequence[str]) -> None:
        """Check that the row in `line`, from 1, has as many cells as there are columns.

        Raises:
            ConfigError: If it has not.
        """
        if len(cells) != self.width:
            raise ConfigError(
                f"line {line}: has {len(cells)} cells ({shown_cells(cells)}), and there are {self.width} "
                f"columns; correct it, or {self.remedy}"
            )


def find_layout(
    sample: Sequence[str],
    wanted: Wanted,
    *,
    optional: Sequence[str] = (),
    anchors: Sequence[str],
    texts: Collection[str] = (),
    remedy: str,
) -> TextLayout:
    """Return the structure of a table that begins with the lines `sample`.

    Args:
        sample: first lines of the text.
        wanted: columns that it must have.
        optional: our names of columns that are read if a line names them.
        anchors: those of `wanted` that are never lost in the first row.
        texts: those that are no numbers.
        remedy: declaration of columns by number, the end of a sentence.

    Raises:
        ConfigError: If it has no such columns. Does not name the file.
    """
    if all(isinstance(source, int) for source in wanted.values()):
        return _numbered_layout(sample, wanted, anchors, texts, remedy)

    # The line that names most of them is shown if none names all: number of columns, minus number of the line
    nearest: tuple[int, int, Sequence[str]] = (-1, 0, ())
    for number, line in enumerate(sample, start=1):
        delimiter = delimiter_of(line)
        names = split_cells(_COMMENT_START.sub("", line), delimiter)
        while names and not names[-1]:
            names.pop()
        indices = column_indices(wanted, names)
        if indices is None:
            if names:
                score = _count_columns(wanted, names)
                nearest = max(nearest, (score, -number, names))
            continue

        # The line of names: its rows must be as it says
        optional_indices: dict[str, int] = {}
        for name in optional:
            optional_indices |= column_indices({name: name}, names) or {}
        layout = TextLayout(number, delimiter, len(names), optional_indices | indices, names, remedy)
        _check_first_rows(sample, layout, anchors)
        return layout
    _, minus_number, cells = nearest
    if not cells:
        raise ConfigError(f"no line names the columns {_names_of(wanted)}; {remedy}")
    raise ConfigError(
        f"no line names the columns {_names_of(wanted)} once each, line {-minus_number} is "
        f"{shown_cells(cells)}; {remedy}"
    )


def _count_columns(wanted: Wanted, names: Sequence[str]) -> int:
    """Return the number of columns of `wanted` that are in `names`."""
    return sum(column_indices({name: source}, names) is not None for name, source in wanted.items())


def _numbered_layout(
    sample: Sequence[str], wanted: Wanted, anchors: Sequence[str], texts: Collection[str], remedy: str
) -> TextLayout:
    """Return the structure of a table whose columns are declared by number: see `find_layout`."""
    indices = {name: int(source) - 1 for name, source in wanted.items()}
    number_indices = {name: index for name, index in indices.items() if name not in texts}

    # Lines before the first row, without cells if they have no numbers
    above: list[tuple[int, Sequence[str]]] = []
    for number, line in enumerate(sample, start=1):
        delimiter = delimiter_of(line)
        cells: list[str] = []
        if not line.lstrip().startswith(COMMENTS):
            cells = split_cells(line, delimiter)
        found_numbers: set[str] = set()
        for name, index in number_indices.items():
            if 0 <= index < len(cells) and is_number(cells[index], delimiter):
                found_numbers.add(name)
        if not _is_first_row(cells, number_indices, found_numbers, anchors):
            above.append((number, cells if found_numbers else ()))
            continue

        # A line above with numbers and as many cells is a row that is not understood
        for number_above, cells_above in above:
            if len(cells_above) == len(cells):
                raise ConfigError(
                    f"line {number_above}: {shown_cells(cells_above)} is no row; correct or remove it"
                )
        if len(cells) > 2 and cells == [str(column) for column in range(len(cells))]:
            raise ConfigError(f"line {number}: {shown_cells(cells)} numbers the columns; remove it")
        layout = TextLayout(number - 1, delimiter, len(cells), indices, (), remedy)
        _check_first_rows(sample, layout, anchors)
        return layout
    raise ConfigError(
        f"no line has numbers in the columns {_names_of(wanted)}, the first line is "
        f"{shown_cells(_first_cells(sample))}; {remedy}"
    )


def _is_first_row(
    cells: Sequence[str], indices: Mapping[str, int], found_numbers: set[str], anchors: Sequence[str]
) -> bool:
    """Return True if each column has a number, or a lost value unless it is an anchor."""
    for name, index in indices.items():
        if name in found_numbers:
            continue
        if name in anchors or index >= len(cells):
            return False
        if not is_lost(cells[index]):
            return False
    return True


def _first_cells(sample: Sequence[str]) -> Sequence[str]:
    """Return the cells of the first line that has any."""
    for line in sample:
        cells = split_cells(line, delimiter_of(line))
        if cells:
            return cells
    return ()


def _check_first_rows(sample: Sequence[str], layout: TextLayout, anchors: Sequence[str]) -> None:
    """Check the rows of `sample`: their cells, the numbers of the first one, the meaning of commas.

    Raises:
        ConfigError: If they are not as the layout says. Does not name the file.
    """
    is_first = True
    numbers_with_commas: list[tuple[int, str]] = []
    for number, line in enumerate(sample[layout.skip :], start=layout.skip + 1):
        if not line.strip() or line.lstrip().startswith(COMMENTS):
            continue
        cells = split_cells(line.partition("#")[0], layout.delimiter, layout.width)
        layout.check_row(number, cells)
        if is_first:
            anchor_cells = [cells[layout.indices[name]] for name in anchors]
            if not any(is_number(cell, layout.delimiter) for cell in anchor_cells):
                names = join_names(anchors)
                raise ConfigError(
                    f"line {number}: {shown_cells(cells)} has no number for {names}; {layout.remedy}"
                )
        is_first = False
        for index in layout.indices.values():
            cell = cells[index]
            if "," in cell and is_number(cell, layout.delimiter):
                numbers_with_commas.append((number, cell))

    # One number that is not in groups of three shows that the comma is a decimal one
    if numbers_with_commas and all(_THOUSANDS.fullmatch(cell) for _, cell in numbers_with_commas):
        number, cell = numbers_with_commas[0]
        raise ConfigError(
            f"line {number}: {cell} may have decimals or thousands behind its comma, as all numbers with "
            "one; write a decimal point"
        )


def column_indices(wanted: Wanted, names: Sequence[str]) -> dict[str, int] | None:
    """Return the index of each column in `names`, or None if one is not there exactly once."""
    lower_names = [name.casefold() for name in names]
    indices: dict[str, int] = {}
    for ours, source in wanted.items():
        if isinstance(source, int):
            if not 0 < source <= len(names):
                return None
            indices[ours] = source - 1
            continue
        name = source.strip().casefold()
        if lower_names.count(name) != 1:
            return None
        indices[ours] = lower_names.index(name)
    return indices


def delimiter_of(line: str) -> str:
    """Return the character that parts the cells of `line`."""
    unquoted = _QUOTED.sub("", line.strip(" \r\n"))
    for delimiter in "\t;,":
        if delimiter in unquoted:
            return delimiter
    return " "


def split_cells(line: str, delimiter: str, count: int = 0) -> list[str]:
    """Return the cells of `line` without blanks and quotes around them, and empty ones beyond `count`."""
    text = line.strip(" \r\n")
    if not text:
        return []
    if delimiter != " " and '"' not in text:  # most rows: faster
        padded_cells = text.split(delimiter)
    else:
        try:
            rows = csv.reader([text], delimiter=delimiter, skipinitialspace=True)
            padded_cells = next(rows, [])
        except csv.Error:
            return []
    cells = [cell.strip().strip("'") for cell in padded_cells]
    while 0 < count < len(cells) and not cells[-1]:
        cells.pop()
    return cells


def parse_number(text: str, delimiter: str) -> float:
    """Return the number in `text`, NaN if there is none."""
    if "_" in text:  # Python's own form of numbers
        return math.nan
    if delimiter != ",":
        text = text.replace(",", ".")
    try:
        return float(text)
    except ValueError:
        return math.nan


def is_number(text: str, delimiter: str) -> bool:
    """Return True if `text` is a finite number."""
    return math.isfinite(parse_number(text, delimiter))


def is_lost(text: str) -> bool:
    """Return True if `text` stands for a lost value: empty, `NaN` or `n/a`."""
    return text.lower() in LOST


def shown_cells(cells: Sequence[str]) -> str:
    """Return the numbers and texts of `cells` for a message: `1 'X (m)', 2 'Y (m)'`."""
    numbered = [f"{number} {format_value(cell)}" for number, cell in enumerate(cells[:MAX_SHOWN], start=1)]
    shown = ", ".join(numbered)
    if len(cells) > MAX_SHOWN:
        return f"{shown} …"
    return shown or "empty"


def _names_of(wanted: Wanted) -> str:
    return join_names(map(str, wanted.values()))
