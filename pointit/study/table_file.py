"""Columns and bytes of a study's tables. A table that another program has rewritten is refused."""

import csv
import datetime as dt
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from pointit.conversion.export_csv import neutralize_formula, restore_formula
from pointit.errors import ConfigError
from pointit.schemas.text import system_reason

Outcome = Literal["hit", "wrong", "timeout", "skipped"]
Row = dict[str, str]

OUTCOMES = get_args(Outcome)

_TEXT = (resources.files("pointit.study") / "texts" / "columns.csv").read_text(encoding="utf-8")
COLUMNS = tuple((name, unit, meaning) for name, unit, meaning in csv.reader(io.StringIO(_TEXT)))[1:]
"""Name, unit, meaning. A column of each factor, its level, stands after `practice`."""

FIXED = frozenset(name for name, _, _ in COLUMNS)
COUNTS = ("block", "trial", "attempt", "practice")
"""Columns of whole numbers, which are never empty."""
SPOKEN = ("announced", "stepped", "confirmed")
"""Columns of counts that are known where names are spoken."""
NUMBERS = ("corrections", *SPOKEN, *(name for name, unit, _ in COLUMNS if unit))
"""Columns of numbers that may be empty, which means not known."""
FACTORS_AFTER = "practice"
REPEATED = "repeated"
"""First word of the reason of an attempt that does not count."""
NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)
COUNT = re.compile(r"\d{1,9}")
PLAIN = frozenset((*COUNTS, *NUMBERS, "item", "value"))
"""Columns of numbers. Their minus sign starts no formula of a spreadsheet."""
REMEDY = "restore it from a backup, or begin in a new folder with `pointit study run --to`"


def columns_of(factors: list[str]) -> list[tuple[str, str, str]]:
    """Return all columns of a study with these factors, in their order."""
    names = [name for name, _, _ in COLUMNS]
    place = names.index(FACTORS_AFTER) + 1
    levels = [(name, "", "level of this factor") for name in factors]
    return [*COLUMNS[:place], *levels, *COLUMNS[place:]]


def utc(stamp_ns: int) -> str:
    """Return a time as ISO 8601, UTC, to the microsecond."""
    return dt.datetime.fromtimestamp(stamp_ns / 1e9, dt.UTC).isoformat(timespec="microseconds")


def counts(row: Mapping[str, str]) -> bool:
    """Return True if an attempt counts, so that its trial is done."""
    return not row["reason"].startswith(REPEATED)


def done_trials(rows: Iterable[Mapping[str, str]]) -> set[int]:
    """Return the numbers of the trials that are done."""
    return {int(row["trial"]) for row in rows if counts(row)}


class TrialTable(NamedTuple):
    """The content of a table."""

    rows: list[Row]
    """Values by column, in the order of the file."""
    tail: bytes
    """Last row that was cut off while it was written. It is not in `rows`."""


def one_line(text: str) -> str:
    """Return `text` as it stands in a table."""
    return " ".join(text.splitlines())


def table_line(values: Iterable[str]) -> bytes:
    """Return a line of a table as the study writes it."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(map(one_line, values))
    return text.getvalue().encode()


def spreadsheet_row(row: Row) -> Row:
    """Return a row with texts that no spreadsheet takes for a formula."""
    safe_row = dict(row)
    for name, text in row.items():
        if name not in PLAIN:
            safe_row[name] = neutralize_formula(text)
    return safe_row


def parse_table(path: Path, columns: Sequence[str]) -> TrialTable:
    """Return the content of a table with `columns`.

    Raises: ConfigError: If the table cannot be read, or has other bytes than the study writes.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({system_reason(error)})") from error

    # What follows the last line end was cut off while it was written.
    cut = content.rfind(b"\n") + 1
    whole = content[:cut]
    tail = content[cut:]
    header = table_line(columns)
    if not whole and header.startswith(tail):  # the header was cut off
        return TrialTable([], tail)
    if not whole.startswith(header):
        start = _common_start(content, header)
        raise ConfigError(
            f"{path}: another program has rewritten it (line 1 has {_shown(content, start)}, and the study "
            f"writes {_shown(header, start)}): {REMEDY}"
        )
    rows: list[Row] = []
    for number, line in enumerate(whole.splitlines(keepends=True)[1:], 2):
        try:
            rows.append(_row(columns, line))
        except (ValueError, csv.Error) as error:  # UnicodeDecodeError is one
            raise ConfigError(
                f"{path}, line {number}: {error}; another program has rewritten the table, or it is damaged: "
                f"{REMEDY}"
            ) from error
    return TrialTable(rows, tail)


def _common_start(content: bytes, line: bytes) -> int:
    """Return the number of bytes with which both begin."""
    count = 0
    for byte, our_byte in zip(content, line, strict=False):
        if byte != our_byte:
            break
        count += 1
    return count


def _shown(line: bytes, start: int) -> str:
    """Return a few characters around the byte `start`."""
    return repr(line[max(0, start - 10) : start + 20].decode(errors="replace"))


def _row(names: Sequence[str], line: bytes) -> Row:
    """Return a row of a table. Raises ValueError if the study writes another line for its values."""
    values = next(csv.reader([line.decode()], strict=True), list[str]())
    if len(values) != len(names):
        raise ValueError(f"not {len(names)} values")
    row = dict(zip(names, values, strict=True))
    for name, text in row.items():
        if name not in PLAIN:
            row[name] = restore_formula(text)

    _check_values(row)

    # Any other difference, however small, is that of another program.
    if table_line(spreadsheet_row(row).values()) != line:
        raise ValueError("other quotes, spaces or line ends than the study's")
    return row


def _check_values(row: Row) -> None:
    """Check counts, numbers, outcome and time. Raises ValueError."""
    for name in COUNTS:
        if name in row and not COUNT.fullmatch(row[name]):
            raise ValueError(f"{name} is {row[name]!r}, not a whole number")
    for name in NUMBERS:
        if row.get(name) and not _is_number(row[name]):
            raise ValueError(f"{name} is {row[name]!r}, not a number or empty, as the study writes it")
    outcome = row.get("outcome", "hit")
    if outcome not in OUTCOMES:
        raise ValueError(f"outcome is {outcome!r}, not one of {', '.join(OUTCOMES)}")
    began = row.get("began_utc")
    if began and not _is_time(began):
        raise ValueError(f"began_utc is {began!r}, not a time such as 2026-01-31T10:00:00.5+00:00")


def _is_number(text: str) -> bool:
    if not NUMBER.fullmatch(text):
        return False
    number = float(text)
    if math.isinf(number):
        return False
    return text == f"{number:.6g}" or text == str(int(number))


def _is_time(text: str) -> bool:
    try:
        return ":" in text and dt.datetime.fromisoformat(text).tzinfo is not None
    except ValueError:
        return False
