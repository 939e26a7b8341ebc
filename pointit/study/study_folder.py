"""Folder of a study: its definition, and the trials, answers and progress of each participant."""

import contextlib
import datetime as dt
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import Any, Self

from pydantic import Field, StrictBool

from pointit.errors import ConfigError
from pointit.runtime.config.config import Config, Layers
from pointit.runtime.config.yaml_edit import dump_yaml
from pointit.runtime.config.yaml_file import parse_yaml, read_yaml
from pointit.runtime.host.state_file import write_atomically
from pointit.study.append_only_csv import AppendOnlyCsv, free_path
from pointit.study.model import Study, read_study
from pointit.study.plan import check_answers, check_levels, check_trials
from pointit.study.table_file import Row, columns_of, parse_table, table_line

Note = Callable[[str], object]
"""Receives a sentence on changed or omitted data."""

STUDY = "study.yaml"
COLUMNS_FILE = "columns.csv"
TRIALS = "trials.csv"
PARTICIPANT = "participant.yaml"
ANSWERS = "answers.csv"
ANSWER_COLUMNS = ("participant", "questionnaire", "item", "condition", "block", "value")
ATTEMPT = ("trial", "attempt")
"""Columns that name a row of the trials of a participant."""
ANSWER = ("questionnaire", "block", "item")
"""Columns that name a row of the answers of a participant."""
RECORD = (
    *("pseudonym", "simulated", "group", "seed", "order", "versions", "consented", "begun", "configuration"),
    *("clock_apart_s", "ended"),
)
"""Keys of `participant.yaml` that the study writes."""


def no_note(_: str) -> None:
    """Ignore a sentence."""


class ParticipantRecord(Config):
    """The keys of `participant.yaml` that are read. It has more, and people may add their own."""

    pseudonym: str | int = ""
    simulated: StrictBool = False
    order: tuple[str, ...] = ()
    consented: StrictBool = False
    begun: str | dt.datetime = ""
    ended: str | dt.datetime = ""
    clock_apart_s: float = Field(default=0.0, ge=0)
    configuration: tuple[dict[str, Any], ...] = ()


class StudyFolder:
    """The data of a study."""

    def __init__(self, path: Path, study: Study, source: str, on_note: Note = no_note) -> None:
        """Create the folder, or open that of the same study.

        Args:
            path: the folder.
            study: the study.
            source: content of its YAML file.
            on_note: called with a sentence on changes by crashes and people.

        Raises:
            ConfigError: If the folder holds another study, or cannot be written.
        """
        self.path = path
        self.columns = columns_of(list(study.factors))
        self._study = study
        self._on_note = on_note
        self.is_replayed = False
        """True if sessions begin again and write only what is not there yet."""
        study_file = path / STUDY
        if study_file.exists():
            changed = _difference(read_yaml(study_file), parse_yaml(source.encode(), "the study"))
            if changed:
                raise ConfigError(
                    f"{study_file} differs from the study; use another folder, or that file (see {changed})"
                )
            return

        # The study's file is written last: it says that the folder is complete.
        if (path / COLUMNS_FILE).exists():
            raise ConfigError(f"{path / COLUMNS_FILE} is not of this study; use another folder")
        rows = [("column", "unit", "meaning"), *self.columns]
        table = b"".join(map(table_line, rows))
        write_atomically(path / COLUMNS_FILE, table, mode=0o644)
        write_atomically(study_file, source.encode(), mode=0o644)

    def replayed(self) -> Self:
        """Return this folder for sessions that begin again."""
        folder = copy(self)
        folder.is_replayed = True
        return folder

    def trials(self, participant: str) -> AppendOnlyCsv:
        """Return the table of the trials of `participant`.

        Raises: ConfigError: If it cannot be used, another process writes it, or rows are lost or damaged.
        """
        path = self.path / participant / TRIALS
        check_begun(path.parent)
        names = [name for name, _, _ in self.columns]
        table = AppendOnlyCsv(path, names, ATTEMPT, self._on_note)
        with contextlib.ExitStack() as unless_used:
            unless_used.callback(table.close)
            check_trials(self._study, path, table.rows)
            if self.is_replayed:
                table.replay()
            unless_used.pop_all()
        return table

    def answers(self, participant: str) -> AppendOnlyCsv:
        """Return the table of the answers of `participant`."""
        path = self.path / participant / ANSWERS
        table = AppendOnlyCsv(path, ANSWER_COLUMNS, ANSWER, self._on_note)
        with contextlib.ExitStack() as unless_used:
            unless_used.callback(table.close)
            check_answers(self._study, path, table.rows)
            if self.is_replayed:
                table.replay()
            unless_used.pop_all()
        return table

    def about(self, participant: str) -> dict[str, Any]:
        """Return the content of `participant.yaml`, empty if they have not begun."""
        about = read_about(self.path / participant)
        if self.is_replayed:
            about = {name: value for name, value in about.items() if name not in RECORD}
        return about

    def put_about(self, participant: str, about: Mapping[str, Any]) -> None:
        """Replace the content of `participant.yaml`. One that people have edited is kept beside it."""
        path = self.path / participant / PARTICIPANT
        if path.exists():
            content = path.read_bytes()
            is_edited = content != _yaml(read_yaml(path))
            if is_edited:
                aside = free_path(path.with_name(f"edited_{PARTICIPANT}"))
                write_atomically(aside, content, mode=0o644, durable=True)
                self._on_note(f"{path}: somebody has edited it; their file is kept as {aside.name}.")
        write_atomically(path, _yaml(about), mode=0o644, durable=True)

    def recording(self, participant: str) -> Path:
        """Return a free path for the next recording of `participant`."""
        return free_path(self.path / participant / "session.mcap")


def _yaml(about: Mapping[str, Any]) -> bytes:
    return dump_yaml(dict(about)).encode()


def _difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """Return the first key whose value differs, or `""`. Comments, line ends and quotes are no difference."""
    for key in {**one, **other}:
        if one.get(key) != other.get(key):
            return key
    return ""


def study_in(folder: Path) -> Study:
    """Return the study whose data are in `folder`. Raises: ConfigError: If it is not there, or damaged."""
    if not (folder / STUDY).exists():
        raise ConfigError(
            f"{folder}: there is no {STUDY}; give the folder that `pointit study run` has written"
        )
    return read_study(folder / STUDY)


def read_about(folder: Path) -> dict[str, Any]:
    """Return the content of `participant.yaml` in `folder`, empty if there is none.

    Raises: ConfigError: If it cannot be read, or a value is of another kind than the study writes.
    """
    path = folder / PARTICIPANT
    if not path.exists():
        return {}
    about = read_yaml(path)
    known = {name: about[name] for name in ParticipantRecord.model_fields if name in about}
    layers = Layers()
    layers.add(known, str(path))
    layers.build(ParticipantRecord)
    return about


def check_begun(folder: Path) -> None:
    """Check that a participant who has begun has a table. Raises: ConfigError: If it is gone or empty."""
    path = folder / TRIALS
    if not path.exists():
        problem = "missing"
    elif _is_blank(path):
        problem = "empty"
    else:
        return
    if read_about(folder).get("begun"):
        raise ConfigError(
            f"{path}: is {problem}, but {folder.name} has begun; restore it from a backup, or move {folder} "
            "away to begin again"
        )


def _is_blank(path: Path) -> bool:
    try:
        return not path.read_bytes().strip()
    except OSError:  # `parse_table` raises it with its reason
        return False


def read_trials(study: Study, folder: Path, on_note: Note = no_note) -> list[Row]:
    """Return the rows of the trials of the participant in `folder`.

    Args:
        study: the study.
        folder: folder of the participant.
        on_note: called with a sentence on omitted rows.

    Raises: ConfigError: If a file cannot be read, a value is damaged, or a row is not of their plan.
    """
    rows = read_any_trials(study, folder, on_note)
    check_trials(study, folder / TRIALS, rows)
    return rows


def read_any_trials(study: Study, folder: Path, on_note: Note = no_note) -> list[Row]:
    """Return rows as `read_trials` does, also those that are not of the participant's plan."""
    check_begun(folder)
    columns = [name for name, _, _ in columns_of(list(study.factors))]
    rows = read_table(folder / TRIALS, columns, on_note)
    check_levels(study, folder / TRIALS, rows)
    return rows


def read_answers(study: Study, folder: Path, on_note: Note = no_note) -> list[Row]:
    """Return the rows of the answers of the participant in `folder`, as `read_trials` does."""
    if not (folder / ANSWERS).exists():
        return []
    rows = read_table(folder / ANSWERS, ANSWER_COLUMNS, on_note)
    check_answers(study, folder / ANSWERS, rows)
    return rows


def check_record(folder: Path, about: Mapping[str, Any], rows: Iterable[Row]) -> None:
    """Check that the record of the participant in `folder` states whether `rows` are of a person.

    Raises: ConfigError: If there are rows, and `about`, the content of `participant.yaml`, does not state it.
    """
    if any(rows) and "simulated" not in about:
        raise ConfigError(
            f"{folder / PARTICIPANT}: does not state whether the trials are of a person; restore it from a "
            f"backup, or move {folder} away"
        )


def read_table(path: Path, columns: Sequence[str], on_note: Note = no_note) -> list[Row]:
    """Return the rows of a table with `columns`; sentences are those of `read_trials`.

    Raises: ConfigError: If it cannot be read, or another program has rewritten it.
    """
    table = parse_table(path, columns)
    if table.tail:
        on_note(f"The last line of {path.parent.name}/{path.name} is not whole and left out.")
    return table.rows
