"""Trials and answers of a study."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pointit.errors import ConfigError
from pointit.study.table_file import Row

MEASURES: Mapping[str, str] = {
    "selection_s": "time to selection, s",
    "first_hover_s": "time to the first hover of the target, s",
    "error_deg": "error of the selection, °",
    "error_m": "error of the selection, m",
    "path_length_deg": "length of the ray's path, °",
    "corrections": "corrections",
}
"""Columns that a report compares, with their titles."""
TARGET, SELECTED = ([f"{what}_{axis}_m" for axis in "xyz"] for what in ("target", "selected"))


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
        last = {(row.participant, row.block, row.trial): row for row in self.rows if row.counts}
        return tuple(last.values())

    @cached_property
    def conditions(self) -> tuple[tuple[str, ...], ...]:
        """Combinations of levels with a counted trial, in the order of their factors' levels."""
        places = [{level: place for place, level in enumerate(self.levels(each))} for each in self.factors]
        found = {row.levels for row in self.counted}
        return tuple(
            sorted(found, key=lambda each: [at[level] for at, level in zip(places, each, strict=True)])
        )

    def levels(self, factor: str) -> tuple[str, ...]:
        """Return the levels of `factor` in their order. Raises: ConfigError: If there is no such factor."""
        index = self.index(factor)
        found = {row.levels[index] for row in self.counted}
        return tuple(level for level in self.stated[factor] if level in found)

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
