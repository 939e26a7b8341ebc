"""Trials and answers of a study, read from its folder of tables."""

import csv
import importlib
import importlib.util
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import cast

import yaml

from pointit.runtime.errors import ConfigError

TEXTS = ("participant", "task", "target", "outcome")
"""Columns of text that the analysis needs."""
COUNTS = ("block", "trial", "attempt", "practice")
"""Columns of whole numbers that the analysis needs."""
OUTCOMES = ("hit", "wrong", "timeout", "skipped")
REPEATED = "repeated"
"""First word of the reason of an attempt that does not count."""
MEASURES: Mapping[str, str] = {
    "selection_s": "time to selection, s",
    "first_hover_s": "time to the first hover of the target, s",
    "error_deg": "error of the selection, °",
    "error_m": "error of the selection, m",
    "path_length_deg": "length of the ray's path, °",
    "corrections": "corrections",
}
"""What a report compares, with their titles."""
TARGET, SELECTED = ([f"{what}_{axis}_m" for axis in "xyz"] for what in ("target", "selected"))
SIZES = ("target_distance_m", "target_width_m", "target_distance_deg", "target_width_deg")
NUMBERS = (*MEASURES, *SIZES, *TARGET, *SELECTED)
"""Columns of numbers that may be empty, which means not known."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Trial:
    """One attempt at a trial: a row of `trials.csv`."""

    participant: str
    block: int
    trial: int
    attempt: int
    is_practice: bool
    levels: tuple[str, ...]
    """Level of each factor of `Trials.factors`."""
    task: str
    target: str
    outcome: str
    """One of `OUTCOMES`."""
    reason: str
    numbers: Mapping[str, float]
    """Known values of `NUMBERS`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Answer:
    """One answer to one item of a questionnaire."""

    participant: str
    questionnaire: str
    item: str
    condition: str
    block: str
    value: str


@dataclass(frozen=True, kw_only=True)
class Trials:
    """All attempts at all trials of a study, in the order of participants, blocks, trials and attempts."""

    folder: Path
    factors: tuple[str, ...]
    rows: tuple[Trial, ...]
    answers: tuple[Answer, ...] = ()
    notes: tuple[str, ...] = ()
    """Sentences about rows and participants that are left out."""

    @cached_property
    def participants(self) -> tuple[str, ...]:
        """Pseudonyms, sorted."""
        return tuple(sorted({row.participant for row in self.rows}))

    @cached_property
    def counted(self) -> tuple[Trial, ...]:
        """The last attempt at each trial, without practice and attempts to be repeated."""
        rows = (row for row in self.rows if not row.is_practice and not row.reason.startswith(REPEATED))
        last = {(row.participant, row.block, row.trial): row for row in rows}
        return tuple(last.values())

    @cached_property
    def conditions(self) -> tuple[tuple[str, ...], ...]:
        """Combinations of levels with a counted trial; numbers are sorted as numbers."""
        return tuple(sorted({row.levels for row in self.counted}, key=lambda each: [*map(_order, each)]))

    def levels(self, factor: str) -> tuple[str, ...]:
        """Return the levels of `factor`, sorted. Raises: ConfigError: If the study has no such factor."""
        index = self.index(factor)
        return tuple(sorted({row.levels[index] for row in self.counted}, key=_order))

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
        return len(pairs) > len({participant for participant, _ in pairs})

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

    Factors are the columns between `practice` and `task`. Empty numbers are not known. A last line that is
    not whole, of a participant who is writing or whose writer was killed, is left out with a note.

    Raises:
        ConfigError: If there is no participant, a column is missing, a value cannot be used, or participants
            have different factors.
    """
    folder = Path(folder)
    files = sorted(folder.glob("*/trials.csv"))
    if not files:
        raise ConfigError(f"{folder}: no participant; a study's folder has P01/trials.csv and so on")
    notes: list[str] = []
    rows: list[Trial] = []
    factors: tuple[str, ...] | None = None
    for path in files:
        header, lines = _table(path, notes)
        found = _factors(path, header)
        if factors is None:
            factors = found
        elif found != factors:
            raise ConfigError(
                f"{path}: factors {', '.join(found) or 'none'}, but {files[0]} has"
                f" {', '.join(factors) or 'none'}; studies are reported one by one"
            )
        if not lines:
            notes.append(f"{path.parent.name} has no trial.")
        rows += [_trial(path, number, line, found) for number, line in lines]
    if not rows:
        raise ConfigError(f"{folder}: no trial of any participant; run the study first")
    rows.sort(key=lambda row: (row.participant, row.block, row.trial, row.attempt))
    answered = [
        Answer(**{name: line[name] for name in Answer.__slots__})
        for path in sorted(folder.glob("*/answers.csv"))
        for _, line in _table(path, notes, Answer.__slots__)[1]
    ]
    made = Trials(folder=folder, factors=factors or (), rows=tuple(rows), answers=tuple(answered))
    if not made.counted:
        raise ConfigError(f"{folder}: only practice so far; there is nothing to report")
    notes += _gaps(made)
    return Trials(
        folder=folder, factors=made.factors, rows=made.rows, answers=made.answers, notes=tuple(notes)
    )


def title(folder: str | Path) -> str:
    """Return the title, else the name, in the `study.yaml` of `folder`; the folder's name if there is none.

    Raises: ConfigError: If `study.yaml` is not YAML.
    """
    folder = Path(folder)
    try:
        study = yaml.safe_load((folder / "study.yaml").read_text(encoding="utf-8"))
    except FileNotFoundError:
        study = None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(
            f"{folder / 'study.yaml'}: cannot be read ({str(error).splitlines()[0]})"
        ) from error
    named = cast("dict[str, object]", study) if isinstance(study, dict) else {}
    return str(named.get("title") or named.get("name") or folder.resolve().name)


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
    reader = csv.reader(text.splitlines(keepends=True))
    header = next(reader, list[str]())
    if missing := [name for name in needed if name not in header]:
        raise ConfigError(f"{path}: no column {', '.join(missing)}; restore the table as the study wrote it")
    lines: list[tuple[int, dict[str, str]]] = []
    broken = 0
    for values in reader:
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


def _factors(path: Path, header: list[str]) -> tuple[str, ...]:
    begin, end = header.index("practice") + 1, header.index("task")
    if begin > end:
        raise ConfigError(f"{path}: column task stands before practice; factors stand between them")
    return tuple(header[begin:end])


def _trial(path: Path, number: int, line: Mapping[str, str], factors: tuple[str, ...]) -> Trial:
    def wrong(name: str, expected: str) -> ConfigError:
        return ConfigError(f"{path}, line {number}: {name} is {line[name]!r}, not {expected}; correct it")

    counts: dict[str, int] = {}
    for name in COUNTS:
        if not line[name].isdecimal():
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
        task=line["task"],
        target=line["target"],
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


def _order(level: str) -> tuple[int, float, str]:
    try:
        return 0, float(level), level
    except ValueError:
        return 1, 0.0, level
