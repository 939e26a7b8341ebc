"""Reader of a study's tables and their columns, also after other programs have rewritten them.

Spreadsheets and statistics programs change encoding, line ends, separators, decimal marks, quotes, and the
order of rows and columns. All of these variants are read if they are unambiguous. `Table.changes` lists the
differences from what `AppendOnlyCsv` writes. Only a table without any may be appended to.
"""

import codecs
import csv
import datetime as dt
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from pointit.conversion.export_csv import restore_formula
from pointit.errors import ConfigError

Outcome = Literal["hit", "wrong", "timeout", "skipped"]
OUTCOMES = get_args(Outcome)

_TEXT = (resources.files("pointit.study") / "texts" / "columns.csv").read_text(encoding="utf-8")
COLUMNS = tuple((name, unit, meaning) for name, unit, meaning in csv.reader(io.StringIO(_TEXT)))[1:]
"""Name, unit, meaning. A column of each factor, its level, stands after `practice`."""

FIXED = frozenset(name for name, _, _ in COLUMNS)
COUNTS = ("block", "trial", "attempt", "practice")
"""Columns of whole numbers, which are never empty."""
ADDED = ("announced", "stepped", "confirmed")
"""Columns that tables of earlier versions lack, in which they are not known."""
NUMBERS = ("corrections", *ADDED, *(name for name, unit, _ in COLUMNS if unit))
"""Columns of numbers that may be empty, which means not known."""
MAY_BE_EMPTY = ("target", "reason", "began_utc", "condition")
"""Columns of texts that may be empty."""
NOT_KNOWN = frozenset(("", "na", "n/a", "#n/a", "nan", "<na>", "<missing>", "null", "none", "."))
"""Values that are not known, in lower case, as the study and programs for statistics write them."""
MAX_ERROR_APART_M = 0.01
"""Maximum difference between the column `error_m` and the distance of its two points, m."""
FACTORS_AFTER = "practice"
REPEATED = "repeated"
"""First word of the reason of an attempt that does not count."""


def columns_of(factors: list[str]) -> list[tuple[str, str, str]]:
    """Return all columns of a study with these factors, in their order."""
    at = [name for name, _, _ in COLUMNS].index(FACTORS_AFTER) + 1
    levels = [(name, "", "level of this factor") for name in factors]
    return [*COLUMNS[:at], *levels, *COLUMNS[at:]]


def utc(stamp_ns: int) -> str:
    """Return a time as ISO 8601, UTC, to the microsecond."""
    return dt.datetime.fromtimestamp(stamp_ns / 1e9, dt.UTC).isoformat(timespec="microseconds")


def counts(row: Mapping[str, str]) -> bool:
    """Return True if an attempt counts, so that its trial is done."""
    return not row["reason"].startswith(REPEATED)


def done_trials(rows: Iterable[Mapping[str, str]]) -> set[int]:
    """Return the numbers of the trials that are done."""
    return {int(row["trial"]) for row in rows if counts(row)}


def parse_time(text: str) -> str:
    """Return the time in `text` with a zone. Raises ValueError if it is none."""
    try:
        time = dt.datetime.fromisoformat(text)
    except ValueError:
        time = None
    if time is None or ":" not in text:
        raise ValueError(f"began_utc is {text!r}, not a time such as 2026-01-31T10:00:00.5+00:00")
    return text if time.tzinfo else f"{text}+00:00"


def check_error(row: Mapping[str, str]) -> None:
    """Check the columns that state the same length twice: spreadsheets take 1.333 for 1333 or a date.

    Raises: ValueError: If they differ.
    """
    points = [row.get(f"{point}_{axis}_m", "") for point in ("target", "selected") for axis in "xyz"]
    if not row.get("error_m") or not all(points):
        return
    x, y, z, *selected = map(float, points)
    error_m, apart_m = float(row["error_m"]), math.dist((x, y, z), selected)
    if abs(error_m - apart_m) > max(MAX_ERROR_APART_M, 1e-3 * apart_m):
        raise ValueError(f"error_m is {error_m:g}, but target and selected point are {apart_m:g} m apart")


Row = dict[str, str]
NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)
COUNT = re.compile(r"(\d{1,9})(\.0*)?")
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
"""Number whose commas may separate thousands."""
SEPARATORS = {",": "", ";": "semicolons", "\t": "tabs", "|": "vertical bars"}
"""Name by separator of values; `""` for the one that is written."""
LINE_ENDS = {"\n": "", "\r\n": "CRLF line ends", "\r": "CR line ends"}
ENCODINGS = (
    (codecs.BOM_UTF8, "utf-8", "a byte order mark"),
    (codecs.BOM_UTF32_LE, "utf-32-le", "UTF-32"),
    (codecs.BOM_UTF32_BE, "utf-32-be", "UTF-32"),
    (codecs.BOM_UTF16_LE, "utf-16-le", "UTF-16"),
    (codecs.BOM_UTF16_BE, "utf-16-be", "UTF-16"),
)
"""Byte order mark, encoding, name. UTF-32 is before UTF-16, whose mark it begins with."""
REMEDY = "correct or delete the line, or restore the table from a backup"


class TrialTable(NamedTuple):
    """The content of a table."""

    rows: list[Row]
    """Values by column, in the order of the file. Numbers have a decimal point."""
    changes: tuple[str, ...]
    """Differences from the bytes that the study writes. Rows are appended only if there are none."""
    tail: bytes
    """Last row that was cut off while it was written. It is not in `rows`."""
    columns: tuple[str, ...] = ()
    """Names of its columns in the order of the file, empty if it has no header."""


class _Record(NamedTuple):
    """A line of a table, and its number from 1."""

    line: int
    values: list[str]


def table_line(values: Iterable[str]) -> bytes:
    """Return a line of a table as the study writes it."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([" ".join(value.splitlines()) for value in values])
    return text.getvalue().encode()


def parse_table(path: Path, columns: Iterable[str]) -> TrialTable:
    """Return the content of a table.

    Raises: ConfigError: If the table cannot be read, lacks one of `columns`, or a value is damaged.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    encoding, changes, begin = _encoding(content)
    cut = content.rfind(b"\n") + 1 if encoding == "utf-8" and b"\r" not in content else len(content)
    cut = max(begin, cut)
    if not cut and table_line(columns).startswith(content):
        return TrialTable([], tuple(changes), content)  # the header was cut off
    text = _decode(path, content[begin:cut], encoding)
    separator, header, records = _split(path, text, columns)
    canonical = b"".join(table_line(record.values) for record in (header, *records)) if header else b""
    tail = b""
    if header and canonical == content[:cut] and not _is_sorted_row(header, records, content[cut:]):
        tail = content[cut:]
    elif cut < len(content):  # other programs leave it out
        changes.append("no last line end")
        text += _decode(path, content[cut:], encoding)
        separator, header, records = _split(path, text, columns)
    if header is None:
        return TrialTable([], (*changes, *(["no header"] if content else [])), tail)
    names = _names(header, records)
    rows, has_commas = _rows(path, names, records)
    if not all(names):
        changes.append("empty columns")
    changes += [name for end, name in LINE_ENDS.items() if name and end in _line_ends(text)]
    changes += filter(None, [SEPARATORS[separator], "decimal commas" if has_commas else ""])
    is_ours = canonical == content[:cut] and all(
        row.get(name, "") in (value, restore_formula(value))
        for row, record in zip(rows, records, strict=True)
        for name, value in zip(names, record.values, strict=False)
    )
    if not changes and not is_ours:
        changes.append("other quotes, spaces or numbers")
    if not changes and not _is_in_order(header, records):
        changes.append("rows in another order")
    unknown = {name: "" for name in columns if name in ADDED and name not in names}
    rows = [row | unknown for row in rows]
    return TrialTable(rows, tuple(changes), tail, tuple(filter(None, names)))


def _encoding(content: bytes) -> tuple[str, list[str], int]:
    """Return the encoding of a table, its name if it is another one, and the number of bytes of its mark."""
    for mark, encoding, name in ENCODINGS:
        if content.startswith(mark):
            return encoding, [name], len(mark)
    if b"\0" in content[:2]:
        return ("utf-16-le" if content[0] else "utf-16-be"), ["UTF-16"], 0
    return "utf-8", [], 0


def _decode(path: Path, content: bytes, encoding: str) -> str:
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        line = 1 + content[: error.start].count(b"\n")
        raise ConfigError(
            f"{path}: cannot be read: line {line} is not {encoding.upper()}, another program has saved it in "
            "another encoding; save it as CSV UTF-8, or restore it from a backup"
        ) from error


def _is_sorted_row(record: _Record, records: Sequence[_Record], last: bytes) -> bool:
    """Return True if the `last` line is a whole row of an earlier attempt: a program has sorted the rows."""
    values = next(csv.reader([last[: csv.field_size_limit()].decode(errors="replace")]), list[str]())
    return len(values) == len(record.values) and not _is_in_order(record, [*records, _Record(0, values)])


def _is_in_order(header: _Record, records: Sequence[_Record]) -> bool:
    """Return True if rows are in the order in which the study writes them.

    A trial that is repeated when its participant is simulated to the end may come after later trials.
    """
    at = [header.values.index(name) for name in ("trial", "attempt") if name in header.values]
    at = at or [header.values.index(name) for name in ("block",) if name in header.values]
    cells = [[record.values[place] for place in at if place < len(record.values)] for record in records]
    if not all(text.isdecimal() for each in cells for text in each):
        return True
    numbers = [[*map(int, each)] for each in cells]
    trials = [*dict.fromkeys(tuple(number[:1]) for number in numbers)]
    return trials == sorted(trials) and sorted(numbers, key=lambda number: number[:1]) == sorted(numbers)


def _line_ends(text: str) -> set[str]:
    return set(re.findall(r"\r\n|\r|\n", text))


def _split(path: Path, text: str, columns: Iterable[str]) -> tuple[str, _Record | None, list[_Record]]:
    """Return the separator, the header (None if the file is empty) and the other lines that are not empty.

    Raises: ConfigError: If a column is missing or there twice, or a quote is not closed.
    """
    wanted = set(columns)
    separator, is_wrapped = _separator(text, wanted)
    records = _records(path, text, separator)
    if is_wrapped:
        lines = [next(filter(None, record.values)) for record in records]
        return _split(path, "".join(f"{line}\n" for line in lines), columns)
    if not records:
        return separator, None, []
    names = [name.strip() for name in records[0].values]
    if missing := sorted(wanted - {*names, *ADDED}):
        raise ConfigError(f"{path}: no column {missing[0]}; restore the table as the study wrote it")
    if twice := sorted(name for name in set(names) if name and names.count(name) > 1):
        raise ConfigError(f"{path}: column {twice[0]} is there twice; delete the one that was added")
    return separator, records[0], records[1:]


def _separator(text: str, wanted: set[str]) -> tuple[str, bool]:
    """Return the separator with which the first line has most of the columns `wanted`.

    The second value is True if spreadsheets with another separator have made one cell of each line.
    """
    lines = (line for line in re.split("[\r\n]+", text) if re.search(r"\w", line))
    first = next((line for line in lines if not line.lower().startswith("sep=")), "")
    first = first[: csv.field_size_limit()]  # `_records` refuses a longer value
    best = (-1, ",", False)
    for separator in SEPARATORS:
        values = next(csv.reader([first], delimiter=separator), list[str]())
        best = max(best, (len(wanted.intersection(map(str.strip, values))), separator, False), key=_known)
        cells = [*filter(None, values)]
        if len(cells) == 1 and cells[0] != first:
            inner = max(len(wanted.intersection(cells[0].split(each))) for each in SEPARATORS)
            best = max(best, (inner, separator, True), key=_known)
    return best[1:]


def _known(candidate: tuple[int, str, bool]) -> int:
    return candidate[0]


def _records(path: Path, text: str, separator: str) -> list[_Record]:
    if begin := int(text[:4].lower() == "sep="):  # a line for Excel
        text = re.sub(r"\A.*[\r\n]+", "", text)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    records: list[_Record] = []
    try:
        records += [
            _Record(begin + reader.line_num, values) for values in reader if any(map(str.strip, values))
        ]
    except csv.Error as error:
        line = begin + reader.line_num
        raise ConfigError(f"{path}, line {line}: {error}; {REMEDY}") from error
    return records


def _names(header: _Record, records: Sequence[_Record]) -> list[str]:
    """Return the names of the columns: `""` of one without name and values, else its number from 1."""
    names = [name.strip() for name in header.values]
    for place, name in enumerate(names):
        if not name and any(record.values[place : place + 1] not in ([], [""]) for record in records):
            names[place] = str(place + 1)
    return names


def _rows(path: Path, names: Sequence[str], records: Sequence[_Record]) -> tuple[list[Row], bool]:
    """Return the rows, and True if numbers have decimal commas."""
    records = _with_empty_texts(names, records)
    at = [place for place, name in enumerate(names) if name in (*NUMBERS, *COUNTS)]
    numbers = [record.values[place] for record in records for place in at if place < len(record.values)]
    has_commas = any("," in number for number in numbers)
    is_decimal = has_commas and not any("." in number for number in numbers)
    rows: list[Row] = []
    for record in records:
        try:
            rows.append(_row(names, record.values, is_decimal=is_decimal))
        except ValueError as error:
            raise ConfigError(f"{path}, line {record.line}: {error}; {REMEDY}") from error
    return rows, has_commas


def _with_empty_texts(names: Sequence[str], records: Sequence[_Record]) -> Sequence[_Record]:
    """Return `records` with empty texts where another program has written `NA` into all that were empty."""
    at = {place for place, name in enumerate(names) if name in MAY_BE_EMPTY}
    at = {place for place in at if all(any(record.values[place : place + 1]) for record in records)}
    return [
        record._replace(
            values=[
                "" if place in at and value.strip().lower() in NOT_KNOWN else value
                for place, value in enumerate(record.values)
            ]
        )
        for record in records
    ]


def _row(names: Sequence[str], values: Sequence[str], *, is_decimal: bool) -> Row:
    """Return a row of a table. Raises ValueError if it is damaged."""
    missing = len(names) - len(values)
    if any(map(str.strip, values[len(names) :])):
        raise ValueError(f"not {len(names)} values")
    row = dict(zip(names, [*map(str.strip, values), *[""] * missing], strict=False))
    if missing > 0 and not (
        row.get("outcome") == "skipped" and row.get("began_utc")
    ):  # then the rest is empty
        raise ValueError(f"not {len(names)} values")
    row.pop("", None)
    for name in COUNTS:
        if name in row:
            row[name] = _count(name, row[name].replace(",", "."))
    for name in NUMBERS:
        if name in row:
            row[name] = _number(name, row[name], is_decimal=is_decimal)
    for name in row.keys() - {*COUNTS, *NUMBERS}:
        row[name] = restore_formula(row[name])
    if (outcome := row.get("outcome", "hit")) not in OUTCOMES:
        raise ValueError(f"outcome is {outcome!r}, not one of {', '.join(OUTCOMES)}")
    if began := row.get("began_utc"):
        row["began_utc"] = parse_time(began)
    check_error(row)
    return row


def _count(name: str, text: str) -> str:
    if (found := COUNT.fullmatch(text)) is None:
        raise ValueError(f"{name} is {text!r}, not a whole number")
    return found[1]


def _number(name: str, text: str, *, is_decimal: bool) -> str:
    if text.lower() in NOT_KNOWN:
        return ""
    if "," in text and (is_decimal or not GROUPED.fullmatch(text)):
        text = text.replace(",", ".", 1)
    if not NUMBER.fullmatch(text) or math.isinf(float(text)):
        raise ValueError(f"{name} is {text!r}, not a number or empty")
    return text
