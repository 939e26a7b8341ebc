"""The full list of trials of a participant, the check of rows against it, and the trials that are left."""

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pointit.errors import ConfigError
from pointit.study.model import Study
from pointit.study.order import square
from pointit.study.questionnaire import scale_of
from pointit.study.table_file import Row, done_trials, one_line
from pointit.study.tasks import StudyTrial, Tapping

MIN_SEQUENCE_TRIALS = 5
"""Minimum number of movements of a sequence that has a throughput. The standard's circles have 9 to 25."""
MAX_ADVISED_REPETITIONS = 100
MIXED = "a spreadsheet may have changed it: restore the table from a backup"
NOT_KNOWN = frozenset(
    (
        *("", "NA", "N/A", "n/a", "#N/A", "#N/A N/A", "#NA", "<NA>", "NULL", "null", "None", "NaN", "nan"),
        *("-NaN", "-nan", "1.#IND", "-1.#IND", "1.#QNAN", "-1.#QNAN", ".", "<missing>"),
    )
)
"""Texts that pandas, R, MATLAB and SAS read as missing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyPlan:
    """Order and trials of one participant."""

    participant: str
    group: dict[str, str]
    """Levels of the factors between participants."""
    order: tuple[str, ...]
    """Names of the conditions of the blocks."""
    trials: tuple[StudyTrial, ...]

    def block(self, number: int) -> tuple[StudyTrial, ...]:
        """Return the trials of a block."""
        return tuple(trial for trial in self.trials if trial.block == number)


def condition_of(cell: dict[str, str]) -> str:
    """Return the name of a condition, such as `gauge` or `gauge, wide`."""
    return ", ".join(cell.values())


def plan_of(study: Study, participant: str) -> StudyPlan:
    """Return the plan of `participant`: always the same one for the same study.

    Raises: ConfigError: If nobody of the study is called so.
    """
    if participant not in study.people:
        known = study.people
        raise ConfigError(
            f"{participant} does not take part in {study.name}; participants are {known[0]} to {known[-1]}"
        )
    index = study.people.index(participant)
    groups = study.cells("between")
    rows = square(study.order, len(study.cells("block")))
    row = rows[index // len(groups) % len(rows)]
    if study.order == "blocked_random":
        row = tuple(np.random.default_rng([study.seed, index]).permutation(len(row)).tolist())
    blocks = [study.cells("block")[each] for each in row]
    group = groups[index % len(groups)]
    trials: list[StudyTrial] = []
    for number, block in enumerate(blocks, 1):
        rng = np.random.default_rng([study.seed, index, number])
        practice = _shuffled(study, rng, study.practice)
        data = [cell for _ in range(study.repetitions) for cell in _shuffled(study, rng)]
        for place, inner in enumerate(practice + data):
            seed = int(np.random.SeedSequence([study.seed, index, number, place]).generate_state(1)[0])
            trials.append(
                StudyTrial(
                    number=len(trials) + 1,
                    block=number,
                    place=place,
                    practice=place < len(practice),
                    cell={name: {**group, **block, **inner}[name] for name in study.factors},
                    seed=seed,
                )
            )
    return StudyPlan(
        participant=participant,
        group=group,
        order=tuple(condition_of(block) for block in blocks),
        trials=tuple(trials),
    )


def _shuffled(study: Study, rng: np.random.Generator, count: int | None = None) -> list[dict[str, str]]:
    """Return all cells of a block in random order, or `count` of them, repeated if there are fewer."""
    cells = study.cells("trial")
    count = len(cells) if count is None else count
    rounds = -(-count // len(cells))
    return [cells[int(each)] for _ in range(rounds) for each in rng.permutation(len(cells))][:count]


def check_levels(study: Study, path: Path, rows: Iterable[Row]) -> None:
    """Check the levels in the rows of a participant.

    Raises: ConfigError: If one is not of the study.
    """
    for row in rows:
        for name, factor in study.factors.items():
            row[name] = _level(row[name], factor.levels)
            if row[name] not in factor.levels:
                raise ConfigError(f"{path}: {name} {row[name]!r} is not of the study; correct it")


def check_trials(study: Study, path: Path, rows: Sequence[Row]) -> None:
    """Check the levels of rows as `check_levels` does, and that they are of the participant's plan.

    Raises: ConfigError: If a level is not of the study, or a row is of another trial, condition or
        participant.
    """
    check_levels(study, path, rows)
    for text in row_errors(plan_of(study, path.parent.name), rows):
        raise ConfigError(f"{path.parent}: {text}")


def check_answers(study: Study, path: Path, rows: Iterable[Row]) -> None:
    """Check that each answer is of the condition that its block has in the participant's plan.

    Raises: ConfigError: If an answer is of another participant or another condition of the plan.
    """
    plan = plan_of(study, path.parent.name)
    for row in rows:
        row["condition"] = _level(row["condition"], plan.order)
        if row["participant"] != plan.participant:
            raise ConfigError(f"{path}: {plan.participant} has answers of {row['participant']}; {MIXED}")
        conditions = plan.order[int(row["block"]) - 1 : int(row["block"])]
        if row["condition"] in plan.order and row["condition"] not in conditions:
            raise ConfigError(
                f"{path}: block {row['block']} has condition {row['condition']!r}, in the plan "
                f"{''.join(map(repr, conditions)) or 'there is no such block'}; {MIXED}"
            )


def row_errors(plan: StudyPlan, rows: Iterable[Row]) -> Iterator[str]:
    """Yield a sentence on each row that is not of `plan`, or is there twice."""
    by_number = {trial.number: trial for trial in plan.trials}
    rows = list(rows)
    for row in rows:
        trial = by_number.get(int(row["trial"]))
        levels = {} if trial is None else trial.cell
        differing = [name for name, level in levels.items() if row.get(name) != level]
        if trial is None:
            yield f"trial {row['trial']} is not that of the plan, which has {len(plan.trials)}; {MIXED}"
        for name in differing[:1]:
            yield (
                f"trial {row['trial']} is not that of the plan: {name} is {row.get(name)!r}, in the plan "
                f"{levels[name]!r}; {MIXED}"
            )
    if twice := [key for key, n in Counter((row["trial"], row["attempt"]) for row in rows).items() if n > 1]:
        yield f"attempt {twice[0][1]} at trial {twice[0][0]} is there twice"
    if others := sorted({row["participant"] for row in rows} - {plan.participant}):
        yield f"{plan.participant} has data of {others[0]}"


def _level(text: str, levels: Iterable[str]) -> str:
    """Return the level that stands as `text` in a table, in which line ends are spaces, or `text`."""
    return next((level for level in levels if one_line(level) == text), text)


def check_names(study: Study) -> None:
    """Check that programs for statistics read each name in a table of the study as a name.

    Raises: ConfigError: If they take a participant, level, questionnaire or item for a missing value.
    """
    scales = [scale_of(each) for each in study.questionnaires]
    named = [("participants", name) for name in study.people]
    named += [
        (f"factors.{factor}", level) for factor in study.factors for level in study.factors[factor].levels
    ]
    named += [("questionnaires", name) for scale in scales for name in (scale.name, *scale.items)]
    for key, name in named:
        if name.strip() in NOT_KNOWN:
            raise ConfigError(
                f"{key}: {name!r} is read as a missing value by programs for statistics: give it another name"
            )


def check_sequences(study: Study) -> None:
    """Check that each block of a tapping study has a sequence of which there is a throughput.

    Raises: ConfigError: If a condition has fewer movements of one distance and width than
        `MIN_SEQUENCE_TRIALS` in a block, even if all trials are hits.
    """
    if not isinstance(study.task, Tapping) or (short := _shortest_sequence(study))[0] >= MIN_SEQUENCE_TRIALS:
        return
    movements, condition = short
    more = range(study.repetitions + 1, MAX_ADVISED_REPETITIONS)
    copies = (study.model_copy(update={"repetitions": each}) for each in more)
    enough = (copy.repetitions for copy in copies if _shortest_sequence(copy)[0] >= MIN_SEQUENCE_TRIALS)
    raise ConfigError(
        f"repetitions: {study.repetitions}: {f'{condition}: ' if condition else ''}a block has {movements} "
        f"movements with one distance and width, of which the first trial is none, and throughput needs "
        f"{MIN_SEQUENCE_TRIALS}; use repetitions: {next(enough, MAX_ADVISED_REPETITIONS)} or more"
    )


def _shortest_sequence(study: Study) -> tuple[int, str]:
    """Return the fewest movements of one condition, distance and width in a block, and the condition."""
    distances = {cell: study.task_in(dict(cell)).model_dump()["distance_m"] for cell in _cells(study)}
    shortest: list[tuple[int, str]] = []
    for name in study.people:
        plan = plan_of(study, name)
        for number in range(1, len(plan.order) + 1):
            trials = [trial for trial in plan.block(number) if not trial.practice]
            cells = [tuple(trial.cell.items()) for trial in trials]
            moved = Counter((cell, distances[before]) for before, cell in itertools.pairwise(cells))
            for cell in set(cells):
                max_count = max((count for (to, _), count in moved.items() if to == cell), default=0)
                shortest.append((max_count, condition_of(dict(cell))))
    return min(shortest)


def _cells(study: Study) -> Iterator[tuple[tuple[str, str], ...]]:
    """Yield all combinations of levels, in the order of `Trial.cell`."""
    for parts in itertools.product(*(study.cells(vary) for vary in ("between", "block", "trial"))):
        levels = {name: level for part in parts for name, level in part.items()}
        yield tuple((name, levels[name]) for name in study.factors)


class Progress:
    """The trials that are left. A crash at any time loses at most the attempt that was going on."""

    def __init__(self, plan: StudyPlan, rows: Sequence[Row]) -> None:
        """Continue after the attempts in `rows`."""
        self._trials = {trial.number: trial for trial in plan.trials}
        self._left = sorted(self._trials.keys() - done_trials(rows))
        self._attempts = Counter(int(row["trial"]) for row in rows)
        self._last = max((int(row["trial"]) for row in rows), default=None)

    @property
    def left(self) -> int:
        """Return the number of trials to do."""
        return len(self._left)

    @property
    def current(self) -> StudyTrial | None:
        """Return the next trial, or None if all are done."""
        return self._trials[self._left[0]] if self._left else None

    @property
    def attempt(self) -> int:
        """Return the number of the next attempt at the current trial, from 1."""
        return self._attempts[self._left[0]] + 1

    def end(self, *, is_done: bool) -> None:
        """Record the end of an attempt at the current trial."""
        self._last = self._left[0]
        self._attempts[self._last] += 1
        if is_done:
            self._left.pop(0)

    def repeat(self) -> int | None:
        """Do the last trial again; return its number, or None if there is none."""
        if self._last is not None and self._last not in self._left:
            self._left.insert(0, self._last)
        return self._last
