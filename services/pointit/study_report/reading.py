"""The folder of a study: its tables are read and joined."""

import csv
import importlib
import importlib.util
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from pointit.errors import ConfigError
from pointit.runtime.host.atomic_file import replaced_file
from pointit.study.append_only_csv import spreadsheet_row
from pointit.study.columns import COUNTS, NUMBERS, columns_of, counts
from pointit.study.study_folder import TRIALS, check_record, read_about, read_answers, read_trials, study_in
from pointit.study.table_file import Row
from pointit.study_report.trial_row import TrialRow, Trials


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
        lines = read_trials(study, path.parent, notes.append)
        try:
            check_record(path.parent, read_about(path.parent), lines)
        except ConfigError as error:
            notes.append(f"{error}.")
        if not lines:
            notes.append(f"{path.parent.name} has no trial.")
        rows += [_trial(line, levels) for line in lines]
        answers += read_answers(study, path.parent, notes.append)
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
    rows = [row for path in paths for row in read_trials(study, path.parent)]
    target = Path(to) / "all_trials.csv"
    with replaced_file(target) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(map(spreadsheet_row, rows))
    if importlib.util.find_spec("pyarrow") is None:
        return [target]
    arrow = importlib.import_module("pyarrow")
    kinds = dict.fromkeys(COUNTS, arrow.int64()) | dict.fromkeys(NUMBERS, arrow.float64())
    columns = {
        name: arrow.array([row[name] for row in rows], arrow.string())
        if name not in kinds
        else arrow.array([float(row[name]) if row[name] else None for row in rows]).cast(kinds[name])
        for name in names
    }
    parquet = target.with_suffix(".parquet")
    with replaced_file(parquet) as part:
        importlib.import_module("pyarrow.parquet").write_table(arrow.table(columns), part)
    return [target, parquet]


def _trial(line: Row, levels: Iterable[str]) -> TrialRow:
    return TrialRow(
        participant=line["participant"],
        block=int(line["block"]),
        trial=int(line["trial"]),
        attempt=int(line["attempt"]),
        levels=tuple(line[factor] for factor in levels),
        outcome=line["outcome"],
        counts=line["practice"] == "0" and counts(line),
        numbers={name: float(line[name]) for name in NUMBERS if line[name]},
    )


def _gaps(trials: Trials) -> list[str]:
    """Return a sentence for each participant who lacks levels that others have."""
    notes: list[str] = []
    for factor in filter(trials.is_within, trials.factors):
        index, levels = trials.index(factor), trials.levels(factor)
        for participant in trials.participants:
            own = {row.levels[index] for row in trials.counted if row.participant == participant}
            if lacking := [level for level in levels if level not in own]:
                notes.append(
                    f"{participant} has no trial with {factor} {', '.join(lacking)},"
                    " and is left out of comparisons with it."
                )
    return notes
