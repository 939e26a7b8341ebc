"""The folder of a study: its tables are read and joined to trials and answers."""

import csv
import importlib
import importlib.util
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pointit.errors import ConfigError
from pointit.runtime.host.state_file import replaced_file
from pointit.study.study_folder import TRIALS, check_record, read_about, read_answers, read_trials, study_in
from pointit.study.table_file import COUNTS, NUMBERS, Row, columns_of, counts, spreadsheet_row

MEASURES: Mapping[str, str] = {
    "selection_s": "time to selection, s",
    "first_hover_s": "time to the first hover of the target, s",
    "error_deg": "error of the selection, °",
    "error_m": "error of the selection, m",
    "path_length_deg": "length of the ray's path, °",
    "corrections": "corrections",
}
"""Columns that a report compares, with their titles."""
TARGET = [f"target_{axis}_m" for axis in "xyz"]
"""Columns of the position of a trial's target."""
SELECTED = [f"selected_{axis}_m" for axis in "xyz"]
"""Columns of the selected position."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TrialRow:
    """One attempt at a trial: a row of `trials.csv`."""

    participant: str
    block: int
    trial: int
    attempt: int
    levels: tuple[str, ...]
    """Level of each factor of `Trials.factors`."""
    outcome: str
    """One of `OUTCOMES`."""
    counts: bool
    """False for practice and an attempt to be repeated."""
    numbers: Mapping[str, float]
    """Known values of `NUMBERS`."""


@dataclass(frozen=True, kw_only=True)
class Trials:
    """All attempts at all trials of a study, in the order of participants, blocks, trials and attempts."""

    folder: Path
    title: str
    stated: Mapping[str, tuple[str, ...]]
    """Levels by factor in the order of `study.yaml`."""
    rows: tuple[TrialRow, ...]
    answers: tuple[Row, ...] = ()
    """Rows of `answers.csv`."""
    notes: tuple[str, ...] = ()
    """Sentences about rows and participants that are left out."""

    @cached_property
    def factors(self) -> tuple[str, ...]:
        """Names of the factors."""
        return tuple(self.stated)

    @cached_property
    def participants(self) -> tuple[str, ...]:
        """Pseudonyms, sorted."""
        return tuple(sorted({row.participant for row in self.rows}))

    @cached_property
    def counted(self) -> tuple[TrialRow, ...]:
        """The last attempt at each trial, without practice and attempts to be repeated."""
        last_attempts: dict[tuple[str, int, int], TrialRow] = {}
        for row in self.rows:
            if row.counts:
                last_attempts[row.participant, row.block, row.trial] = row
        return tuple(last_attempts.values())

    @cached_property
    def conditions(self) -> tuple[tuple[str, ...], ...]:
        """Combinations of levels with a counted trial, in the order of their factors' levels."""
        levels_of_factors = [self.levels(factor) for factor in self.factors]

        def place(condition: tuple[str, ...]) -> list[int]:
            pairs = zip(levels_of_factors, condition, strict=True)
            return [levels.index(level) for levels, level in pairs]

        return tuple(sorted({row.levels for row in self.counted}, key=place))

    def levels(self, factor: str) -> tuple[str, ...]:
        """Return the levels of `factor` in their order. Raises: ConfigError: If there is no such factor."""
        index = self.index(factor)
        used = {row.levels[index] for row in self.counted}
        return tuple(level for level in self.stated[factor] if level in used)

    def index(self, factor: str) -> int:
        """Return the position of `factor`. Raises: ConfigError: If the study has no such factor."""
        if factor not in self.factors:
            named = ", ".join(self.factors) or "none"
            raise ConfigError(f"{self.folder}: no factor {factor!r}; factors of this study: {named}")
        return self.factors.index(factor)

    def is_within(self, factor: str) -> bool:
        """Return True if a participant has more than one level of `factor`."""
        index = self.index(factor)
        pairs = {(row.participant, row.levels[index]) for row in self.counted}
        participants = {participant for participant, _ in pairs}
        return len(pairs) > len(participants)

    def has(self, measure: str) -> bool:
        """Return True if a counted trial has a value of `measure`."""
        return any(measure in row.numbers for row in self.counted)

    def label(self, levels: Iterable[str]) -> str:
        """Return the name of a condition, such as `press, 0.3`; `all` without factors."""
        return ", ".join(levels) or "all"

    def named(self, levels: Iterable[str]) -> dict[str, str]:
        """Return the levels of a condition by factor, the first columns of a table."""
        return dict(zip(self.factors, levels, strict=True))


def trials(folder: str | Path) -> Trials:
    """Return the trials and answers of the study in `folder`, of all participants.

    Empty numbers are unknown. An incomplete last line, of a running session or a killed writer, is omitted
    with a note. Raises: ConfigError: If there is no study or trial, a column is missing, a value cannot be
    used, or a row is not of the plan of its participant.
    """
    folder = Path(folder)
    study = study_in(folder)
    levels = {name: tuple(factor.levels) for name, factor in study.factors.items()}
    notes: list[str] = []
    rows: list[TrialRow] = []
    answers: list[Row] = []
    for path in sorted(folder.glob(f"*/{TRIALS}")):
        participant = path.parent
        lines = read_trials(study, participant, notes.append)
        # What contradicts the record of the sessions is noted, and counts nevertheless.
        try:
            check_record(participant, read_about(participant), lines)
        except ConfigError as error:
            notes.append(f"{error}.")
        if not lines:
            notes.append(f"{participant.name} has no trial.")
        rows += [_trial(line, levels) for line in lines]
        answers += read_answers(study, participant, notes.append)
    rows.sort(key=lambda row: (row.participant, row.block, row.trial, row.attempt))
    all_trials = Trials(
        folder=folder, title=study.name, stated=levels, rows=tuple(rows), answers=tuple(answers)
    )
    if not all_trials.counted:
        raise ConfigError(f"{folder}: no trial besides practice; there is nothing to report")
    return replace(all_trials, notes=(*notes, *_gaps(all_trials)))


def write_all_trials(folder: str | Path, to: str | Path) -> list[Path]:
    """Write the rows of all participants to `all_trials.csv` in `to`, and to Parquet if pyarrow is installed.

    Rows are in the order of participants and trials. Numbers stay as they are written in the first, and are
    numbers in the second, null if they are not known.
    Returns the files. Raises: ConfigError: As of `trials`.
    """
    study = study_in(Path(folder))
    names = [name for name, _, _ in columns_of(list(study.factors))]
    paths = sorted(Path(folder).glob(f"*/{TRIALS}"))
    rows: list[Row] = []
    for path in paths:
        rows += sorted(read_trials(study, path.parent), key=_attempt)

    target = Path(to) / "all_trials.csv"
    with replaced_file(target) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(map(spreadsheet_row, rows))
    if importlib.util.find_spec("pyarrow") is None:
        return [target]
    parquet = target.with_suffix(".parquet")
    _write_parquet(rows, names, parquet)
    return [target, parquet]


def _write_parquet(rows: Sequence[Row], names: Iterable[str], path: Path) -> None:
    """Write rows as a table with a type for each column. Needs pyarrow."""
    arrow = importlib.import_module("pyarrow")
    number_types = dict.fromkeys(COUNTS, arrow.int64()) | dict.fromkeys(NUMBERS, arrow.float64())
    columns: dict[str, Any] = {}
    for name in names:
        texts = [row[name] for row in rows]
        if name in number_types:
            numbers = [float(text) if text else None for text in texts]
            columns[name] = arrow.array(numbers).cast(number_types[name])
        else:
            columns[name] = arrow.array(texts, arrow.string())
    with replaced_file(path) as part:
        importlib.import_module("pyarrow.parquet").write_table(arrow.table(columns), part)


def _attempt(line: Row) -> tuple[int, int]:
    return int(line["trial"]), int(line["attempt"])


def _trial(line: Row, levels: Iterable[str]) -> TrialRow:
    is_practice = line["practice"] != "0"
    numbers = {name: float(line[name]) for name in NUMBERS if line[name]}
    return TrialRow(
        participant=line["participant"],
        block=int(line["block"]),
        trial=int(line["trial"]),
        attempt=int(line["attempt"]),
        levels=tuple(line[factor] for factor in levels),
        outcome=line["outcome"],
        counts=not is_practice and counts(line),
        numbers=numbers,
    )


def _gaps(trials: Trials) -> list[str]:
    """Return a sentence for each participant who lacks levels that others have."""
    notes: list[str] = []
    for factor in filter(trials.is_within, trials.factors):
        index = trials.index(factor)
        levels = trials.levels(factor)
        for participant in trials.participants:
            own_levels = {row.levels[index] for row in trials.counted if row.participant == participant}
            missing = [level for level in levels if level not in own_levels]
            if missing:
                notes.append(
                    f"{participant} has no trial with {factor} {', '.join(missing)},"
                    " and is left out of comparisons with it."
                )
    return notes
