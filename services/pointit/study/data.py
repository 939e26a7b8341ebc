"""The folder of a study: tables that survive kill -9, and what has been done so far."""

import contextlib
import csv
import datetime as dt
import io
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError, PointItError
from pointit.runtime.host.atomic_file import write_atomically
from pointit.study.columns import COUNTS, FIXED, NUMBERS, OUTCOMES, REPEATED, columns_of
from pointit.study.model import Study, read_study

STUDY, COLUMNS_FILE, TRIALS, PARTICIPANT, ANSWERS = (
    "study.yaml", "columns.csv", "trials.csv", "participant.yaml", "answers.csv",
)  # fmt: skip
ANSWER_COLUMNS = ("participant", "questionnaire", "item", "condition", "block", "value")
Row = dict[str, str]
NUMBER = re.compile(r"[+-]?\d+(\.\d*)?(e[+-]?\d+)?")


class AppendOnlyCsv:
    """A CSV file of which each row is on the disk when `append` returns, or not there at all."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        """Open or create the table; a row that was cut off by a crash is removed.

        Raises: ConfigError: If it cannot be read or written, has other columns, or another process writes it.
        """
        self.path = path
        self._columns = columns
        head = _line(columns)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a+b", buffering=0)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be used ({error.strerror or error})") from error
        with contextlib.ExitStack() as unless_used:
            unless_used.callback(self._file.close)
            _lock(self._file, path)
            self._file.seek(0)
            content = self._file.read()
            whole = content[: content.rfind(b"\n") + 1]
            if whole != content:
                self._file.truncate(len(whole))
            if not whole:
                self._write(head)
            elif not whole.startswith(head):
                raise ConfigError(f"{path}: has other columns than this study; use another folder")
            self.rows = read_table(path, columns)
            unless_used.pop_all()

    def append(self, *rows: Mapping[str, object]) -> None:
        """Add rows and wait until they are on the disk.

        Raises: PointItError: If they cannot be written. Nothing of them is there then.
        """
        texts = [{name: _text(row.get(name)) for name in self._columns} for row in rows]
        self._write(b"".join(_line(list(row.values())) for row in texts))
        self.rows += texts

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, line: bytes) -> None:
        size = os.fstat(self._file.fileno()).st_size
        try:
            written = self._file.write(line)
            os.fsync(self._file.fileno())
        except OSError as error:
            written, reason = 0, error.strerror
        else:
            reason = "no space left"
        if written != len(line):
            self._file.truncate(size)
            raise PointItError(
                f"{self.path}: a row cannot be written ({reason}); all earlier ones are there: make room, "
                "then give the same command to go on"
            )


class StudyFolder:
    """The data of a study."""

    def __init__(self, path: Path, study: Study, source: str) -> None:
        """Create the folder, or open that of the same study.

        Args:
            path: the folder.
            study: the study.
            source: content of its YAML file.

        Raises:
            ConfigError: If the folder holds another study, or cannot be written.
        """
        self.path = path
        self.columns = columns_of(list(study.factors))
        copy = path / STUDY
        if copy.exists() and copy.read_text(encoding="utf-8") != source:
            raise ConfigError(f"{copy} differs from the study; use another folder, or that file")
        if not copy.exists():
            if (path / COLUMNS_FILE).exists():
                raise ConfigError(f"{path / COLUMNS_FILE} is not of this study; use another folder")
            table = "".join(_line(row).decode() for row in [("column", "unit", "meaning"), *self.columns])
            write_atomically(path / COLUMNS_FILE, table.encode(), mode=0o644)
            write_atomically(copy, source.encode(), mode=0o644)

    def trials(self, participant: str) -> AppendOnlyCsv:
        """Return the table of the trials of `participant`."""
        return AppendOnlyCsv(self.path / participant / TRIALS, [name for name, _, _ in self.columns])

    def answers(self, participant: str) -> AppendOnlyCsv:
        """Return the table of the answers of `participant`."""
        return AppendOnlyCsv(self.path / participant / ANSWERS, ANSWER_COLUMNS)

    def about(self, participant: str) -> dict[str, Any]:
        """Return the content of `participant.yaml`, empty if they have not begun."""
        return read_about(self.path / participant)

    def put_about(self, participant: str, about: Mapping[str, Any]) -> None:
        """Replace the content of `participant.yaml`."""
        text = yaml.safe_dump(dict(about), sort_keys=False, allow_unicode=True)
        write_atomically(self.path / participant / PARTICIPANT, text.encode(), mode=0o644, durable=True)

    def recording(self, participant: str) -> Path:
        """Return a free path for the next recording of `participant`."""
        folder = self.path / participant
        names = (f"session{'' if number == 1 else f'_{number}'}.mcap" for number in range(1, 10_000))
        return next(path for name in names if not (path := folder / name).exists())


def study_in(folder: Path) -> Study:
    """Return the study whose data are in `folder`. Raises: ConfigError: If it is not there, or damaged."""
    if not (folder / STUDY).exists():
        raise ConfigError(
            f"{folder}: there is no {STUDY}; give the folder that `pointit study run` has written"
        )
    return read_study(folder / STUDY)


def read_about(folder: Path) -> dict[str, Any]:
    """Return the content of `participant.yaml` in `folder`, empty if there is none."""
    path = folder / PARTICIPANT
    return read_yaml(path) if path.exists() else {}


def read_table(
    path: Path, columns: Iterable[str] = FIXED, on_cut: Callable[[str], object] = lambda _: None
) -> list[Row]:
    """Return the rows of a table, without a last line that a crash has cut off, of which `on_cut` is told.

    Raises: ConfigError: If the table cannot be read, lacks one of `columns`, or a value is damaged.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({error})") from error
    whole = text[: text.rfind("\n") + 1]
    reader = csv.reader(io.StringIO(whole, newline=""), strict=True)
    rows: list[Row] = []
    try:
        header = next(reader, list[str]())
        if header and (missing := sorted(set(columns) - set(header))):
            raise ConfigError(f"{path}: no column {missing[0]}; restore the table as the study wrote it")
        rows += [_row(header, values) for values in reader]
    except (ValueError, csv.Error) as error:
        raise ConfigError(f"{path}, line {reader.line_num}: {error}; correct or delete the line") from error
    if whole != text:
        on_cut(f"The last line of {path.parent.name}/{path.name} is not whole and left out.")
    return rows


def _row(header: Sequence[str], values: Sequence[str]) -> Row:
    """Return a row of a table. Raises ValueError if it is damaged."""
    if len(values) != len(header):
        raise ValueError(f"not {len(header)} values")
    row = dict(zip(header, values, strict=True))
    for name in filter(row.__contains__, COUNTS):
        if not row[name].isdecimal() or len(row[name]) > 9:
            raise ValueError(f"{name} is {row[name]!r}, not a whole number")
    for name in filter(row.__contains__, NUMBERS):
        if row[name] and not NUMBER.fullmatch(row[name]):
            raise ValueError(f"{name} is {row[name]!r}, not a number or empty")
    if (outcome := row.get("outcome", "hit")) not in OUTCOMES:
        raise ValueError(f"outcome is {outcome!r}, not one of {', '.join(OUTCOMES)}")
    dt.datetime.fromisoformat(row.get("began_utc") or "2000-01-01")
    return row


def counts(row: Row) -> bool:
    """Return True if an attempt counts, so that its trial is done."""
    return not row["reason"].startswith(REPEATED)


def done_trials(rows: Sequence[Row]) -> set[int]:
    """Return the numbers of the trials that are done."""
    return {int(row["trial"]) for row in rows if counts(row)}


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _line(values: Sequence[str]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([" ".join(value.splitlines()) for value in values])
    return text.getvalue().encode()


def _lock(file: Any, path: Path) -> None:
    try:
        import fcntl  # noqa: PLC0415 - not on Windows
    except ImportError:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise ConfigError(f"{path}: another process runs this participant") from error
