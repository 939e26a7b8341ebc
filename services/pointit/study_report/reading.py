"""The folder of a study: its tables are read and joined."""

import csv
import importlib
import importlib.util
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.study.columns import COUNTS, NUMBERS
from pointit.study.data import ANSWER_COLUMNS, ANSWERS, STUDY, TRIALS, Row, counts, read_table
from pointit.study_report.model import TrialRow, Trials


def trials(folder: str | Path) -> Trials:
    """Return the trials and answers of the study in `folder`, of all participants.

    Factors are the columns between `practice` and `task`. Empty numbers are not known. A last line that is
    not whole, of a participant who is writing or whose writer was killed, is left out with a note.

    Raises:
        ConfigError: If there is no participant, one is there twice, a column is missing, a value cannot be
            used, or participants have different factors.
    """
    folder = Path(folder)
    notes: list[str] = []
    tables = {path: read_table(path, on_cut=notes.append) for path in sorted(folder.glob(f"*/{TRIALS}"))}
    if not tables:
        raise ConfigError(f"{folder}: no participant; a study's folder has P01/{TRIALS} and so on")
    factors = _factors(tables)
    rows: list[TrialRow] = []
    for path, lines in tables.items():
        if twice := {row.participant for row in rows} & {line["participant"] for line in lines}:
            raise ConfigError(f"{path}: {min(twice)} is also in another folder; move one of them away")
        rows += [_trial(line, factors) for line in lines]
    notes += [f"{path.parent.name} has no trial." for path, lines in tables.items() if not lines]
    rows.sort(key=lambda row: (row.participant, row.block, row.trial, row.attempt))
    answers = tuple(
        line
        for path in sorted(folder.glob(f"*/{ANSWERS}"))
        for line in read_table(path, ANSWER_COLUMNS, notes.append)
    )
    study = Trials(folder=folder, factors=factors, rows=tuple(rows), answers=answers, stated=_stated(folder))
    if not study.counted:
        raise ConfigError(f"{folder}: no trial besides practice; there is nothing to report")
    _check_levels(study)
    return replace(study, notes=(*notes, *_gaps(study)))


def title(folder: str | Path) -> str:
    """Return the name in the `study.yaml` of `folder`, else the folder's name.

    Raises: ConfigError: If `study.yaml` is not YAML.
    """
    return str(_yaml(Path(folder)).get("name") or Path(folder).resolve().name)


def _yaml(folder: Path) -> dict[str, Any]:
    path = folder / STUDY
    return read_yaml(path) if path.exists() else {}


def _stated(folder: Path) -> dict[str, tuple[str, ...]]:
    factors = _yaml(folder).get("factors")
    found: dict[str, tuple[str, ...]] = {}
    for name, factor in cast("dict[str, Any]", factors).items() if isinstance(factors, dict) else ():
        levels = cast("dict[str, Any]", factor).get("levels") if isinstance(factor, dict) else None
        if isinstance(levels, dict | list):
            found[name] = tuple(str(level) for level in cast("list[Any]", levels))
    return found


def write_all_trials(folder: str | Path, to: str | Path) -> list[Path]:
    """Write the rows of all participants to `all_trials.csv` in `to`, and to Parquet if pyarrow is installed.

    Numbers stay as they are written in the first, and are numbers in the second, null if they are not known.
    Returns the files. Raises: ConfigError: As of `trials`.
    """
    rows = [row for path in sorted(Path(folder).glob(f"*/{TRIALS}")) for row in read_table(path)]
    target = Path(to) / "all_trials.csv"
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    if importlib.util.find_spec("pyarrow") is None:
        return [target]
    arrow = importlib.import_module("pyarrow")
    kinds = dict.fromkeys(COUNTS, arrow.int64()) | dict.fromkeys(NUMBERS, arrow.float64())
    columns = {
        name: arrow.array([row[name] for row in rows], arrow.string())
        if name not in kinds
        else arrow.array([float(row[name]) if row[name] else None for row in rows]).cast(kinds[name])
        for name in rows[0]
    }
    parquet = target.with_suffix(".parquet")
    importlib.import_module("pyarrow.parquet").write_table(arrow.table(columns), parquet)
    return [target, parquet]


def _factors(tables: Mapping[Path, list[Row]]) -> tuple[str, ...]:
    """Return the names of the columns between `practice` and `task`, which all tables share."""
    found: dict[Path, tuple[str, ...]] = {}
    for path, lines in tables.items():
        if lines:
            names = list(lines[0])
            found[path] = tuple(names[names.index("practice") + 1 : names.index("task")])
    first, factors = next(iter(found.items()), (Path(), ()))
    for path, own in found.items():
        if own != factors:
            raise ConfigError(
                f"{path}: factors {', '.join(own) or 'none'}, but {first} has {', '.join(factors) or 'none'};"
                " report studies one by one"
            )
    return factors


def _check_levels(study: Trials) -> None:
    for row in study.rows:
        for factor, level in study.named(row.levels).items():
            if level not in study.stated.get(factor, (level,)):
                raise ConfigError(
                    f"{study.folder}: {row.participant} has {factor} {level!r}, but study.yaml"
                    f" {', '.join(study.stated[factor])}; correct the one that is wrong"
                )


def _trial(line: Row, factors: tuple[str, ...]) -> TrialRow:
    return TrialRow(
        participant=line["participant"],
        block=int(line["block"]),
        trial=int(line["trial"]),
        attempt=int(line["attempt"]),
        levels=tuple(line[factor] for factor in factors),
        outcome=line["outcome"],
        counts=line["practice"] == "0" and counts(line),
        numbers={name: float(line[name]) for name in NUMBERS if line[name]},
    )


def _gaps(study: Trials) -> list[str]:
    """Return a sentence for each participant who lacks levels that others have."""
    notes: list[str] = []
    for factor in filter(study.is_within, study.factors):
        index, levels = study.index(factor), study.levels(factor)
        for participant in study.participants:
            own = {row.levels[index] for row in study.counted if row.participant == participant}
            if lacking := [level for level in levels if level not in own]:
                notes.append(
                    f"{participant} has no trial with {factor} {', '.join(lacking)},"
                    " and is left out of comparisons with it."
                )
    return notes
