"""The folder of a study: its tables are read and joined."""

import csv
import importlib
import importlib.util
import io
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.study_report.model import NUMBERS, OUTCOMES, Answer, Trial, Trials

TEXTS = ("participant", "task", "outcome")
"""Columns of text that the analysis needs."""
COUNTS = ("block", "trial", "attempt", "practice")
"""Columns of whole numbers that the analysis needs."""


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
    needed = (*TEXTS, *COUNTS, *NUMBERS)
    tables = {path: _table(path, notes, needed) for path in sorted(folder.glob("*/trials.csv"))}
    if not tables:
        raise ConfigError(f"{folder}: no participant; a study's folder has P01/trials.csv and so on")
    factors = _factors(tables)
    rows: list[Trial] = []
    for path, (_, lines) in tables.items():
        known = {row.participant for row in rows}
        rows += [_trial(path, *line, factors) for line in lines]
        if twice := known & {line["participant"] for _, line in lines}:
            raise ConfigError(f"{path}: {min(twice)} is also in another folder; move one of them away")
    notes += [f"{path.parent.name} has no trial." for path, (_, lines) in tables.items() if not lines]
    rows.sort(key=lambda row: (row.participant, row.block, row.trial, row.attempt))
    answers = tuple(
        Answer(**{name: line[name] for name in Answer.__slots__})
        for path in sorted(folder.glob("*/answers.csv"))
        for _, line in _table(path, notes, Answer.__slots__)[1]
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
    path = folder / "study.yaml"
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

    Numbers stay as they are written. Returns the files. Raises: ConfigError: As of `trials`.
    """
    names: list[str] = []
    every: list[dict[str, str]] = []
    for path in sorted(Path(folder).glob("*/trials.csv")):
        header, lines = _table(path, [])
        names = names or header
        every += [line for _, line in lines]
    target = Path(to) / "all_trials.csv"
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names, restval="", extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(every)
    if importlib.util.find_spec("pyarrow") is None:
        return [target]
    table = importlib.import_module("pyarrow.csv").read_csv(target)
    importlib.import_module("pyarrow.parquet").write_table(table, target.with_suffix(".parquet"))
    return [target, target.with_suffix(".parquet")]


def _table(
    path: Path, notes: list[str], needed: Iterable[str] = (*TEXTS, *COUNTS)
) -> tuple[list[str], list[tuple[int, dict[str, str]]]]:
    """Return the header and the numbered lines of a table."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({error})") from error
    reader = csv.reader(io.StringIO(text, newline=""))
    header = next(reader, list[str]())
    if missing := [name for name in needed if name not in header]:
        raise ConfigError(f"{path}: no column {', '.join(missing)}; restore the table as the study wrote it")
    lines: list[tuple[int, dict[str, str]]] = []
    broken = 0
    for values in _values(path, reader):
        if broken:
            raise ConfigError(f"{path}, line {broken}: not {len(header)} values; correct or delete the line")
        if len(values) != len(header):
            broken = reader.line_num
        else:
            lines.append((reader.line_num, dict(zip(header, values, strict=True))))
    if not broken and lines and not text.endswith("\n"):
        broken = lines.pop()[0]
    if broken:
        notes.append(f"The last line of {path.parent.name}/{path.name} is not whole and left out.")
    return header, lines


def _values(path: Path, reader: "Iterator[list[str]]") -> Iterator[list[str]]:
    try:
        yield from reader
    except csv.Error as error:
        raise ConfigError(f"{path}: cannot be read ({error})") from error


def _factors(tables: Mapping[Path, tuple[list[str], object]]) -> tuple[str, ...]:
    """Return the names of the columns between `practice` and `task`, which all tables share."""
    found = {
        path: tuple(names[names.index("practice") + 1 : names.index("task")])
        for path, (names, _) in tables.items()
    }
    first, factors = next(iter(found.items()))
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


def _trial(path: Path, number: int, line: Mapping[str, str], factors: tuple[str, ...]) -> Trial:
    def wrong(name: str, expected: str) -> ConfigError:
        return ConfigError(f"{path}, line {number}: {name} is {line[name]!r}, not {expected}; correct it")

    counts: dict[str, int] = {}
    for name in COUNTS:
        if not line[name].isdecimal() or len(line[name]) > 9:
            raise wrong(name, "a whole number")
        counts[name] = int(line[name])
    if line["outcome"] not in OUTCOMES:
        raise wrong("outcome", f"one of {', '.join(OUTCOMES)}")
    numbers: dict[str, float] = {}
    for name in NUMBERS:
        if line.get(name, "") == "":
            continue
        try:
            numbers[name] = float(line[name])
        except ValueError:
            raise wrong(name, "a number") from None
        if not math.isfinite(numbers[name]):
            raise wrong(name, "a number or empty")
    return Trial(
        participant=line["participant"],
        block=counts["block"],
        trial=counts["trial"],
        attempt=counts["attempt"],
        is_practice=counts["practice"] != 0,
        levels=tuple(line[factor] for factor in factors),
        outcome=line["outcome"],
        reason=line.get("reason", ""),
        numbers=numbers,
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
