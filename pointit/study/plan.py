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

Cell = tuple[tuple[str, str], ...]
"""Levels by factor, in the order of `StudyTrial.cell`."""

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
    # Participants take turns in groups, and within a group in the rows of the square.
    index = study.people.index(participant)
    groups = study.cells("between")
    group = groups[index % len(groups)]
    rows = square(study.order, len(study.cells("block")))
    row = rows[index // len(groups) % len(rows)]
    if study.order == "blocked_random":
        rng = np.random.default_rng([study.seed, index])
        row = tuple(rng.permutation(len(row)).tolist())
    blocks = [study.cells("block")[place] for place in row]

    # Each block has random numbers of its own, and each trial a seed: a session can go on anywhere.
    trials: list[StudyTrial] = []
    for number, block in enumerate(blocks, 1):
        rng = np.random.default_rng([study.seed, index, number])
        practice = _shuffled(study, rng, study.practice)
        cells = list(practice)
        for _ in range(study.repetitions):
            cells += _shuffled(study, rng)
        for place, cell in enumerate(cells):
            seeds = np.random.SeedSequence([study.seed, index, number, place])
            levels = {**group, **block, **cell}
            trial = StudyTrial(
                number=len(trials) + 1,
                block=number,
                place=place,
                practice=place < len(practice),
                cell={name: levels[name] for name in study.factors},
                seed=int(seeds.generate_state(1)[0]),
            )
            trials.append(trial)
    order = tuple(condition_of(block) for block in blocks)
    return StudyPlan(participant=participant, group=group, order=order, trials=tuple(trials))


def _shuffled(study: Study, rng: np.random.Generator, count: int | None = None) -> list[dict[str, str]]:
    """Return all cells of a block in random order, or `count` of them, repeated if there are fewer."""
    cells = study.cells("trial")
    count = len(cells) if count is None else count
    shuffled: list[dict[str, str]] = []
    while len(shuffled) < count:
        order: list[int] = rng.permutation(len(cells)).tolist()
        shuffled += [cells[index] for index in order]
    return shuffled[:count]


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
        block = int(row["block"])
        planned = plan.order[block - 1 : block]
        if row["condition"] in plan.order and row["condition"] not in planned:
            in_plan = repr(planned[0]) if planned else "there is no such block"
            raise ConfigError(
                f"{path}: block {block} has condition {row['condition']!r}, in the plan {in_plan}; {MIXED}"
            )


def row_errors(plan: StudyPlan, rows: Iterable[Row]) -> Iterator[str]:
    """Yield a sentence on each row that is not of `plan`, or is there twice."""
    rows = list(rows)
    by_number = {trial.number: trial for trial in plan.trials}
    for row in rows:
        trial = by_number.get(int(row["trial"]))
        if trial is None:
            yield f"trial {row['trial']} is not that of the plan, which has {len(plan.trials)}; {MIXED}"
            continue
        # One sentence a row: of the first level that differs.
        for name, level in trial.cell.items():
            if row.get(name) != level:
                yield (
                    f"trial {row['trial']} is not that of the plan: {name} is {row.get(name)!r}, in the plan "
                    f"{level!r}; {MIXED}"
                )
                break

    attempts = Counter((row["trial"], row["attempt"]) for row in rows)
    for (trial_number, attempt), count in attempts.items():
        if count > 1:
            yield f"attempt {attempt} at trial {trial_number} is there twice"
            break
    others = {row["participant"] for row in rows} - {plan.participant}
    if others:
        yield f"{plan.participant} has data of {min(others)}"


def _level(text: str, levels: Iterable[str]) -> str:
    """Return the level that stands as `text` in a table, in which line ends are spaces, or `text`."""
    return next((level for level in levels if one_line(level) == text), text)


def check_names(study: Study) -> None:
    """Check that programs for statistics read each name in a table of the study as a name.

    Raises: ConfigError: If they take a participant, level, questionnaire or item for a missing value.
    """
    names: dict[str, Iterable[str]] = {"participants": study.people}
    for name, factor in study.factors.items():
        names[f"factors.{name}"] = factor.levels
    names["questionnaires"] = itertools.chain.from_iterable(
        (scale.name, *scale.items) for scale in map(scale_of, study.questionnaires)
    )
    for key, own_names in names.items():
        for name in own_names:
            if name.strip() in NOT_KNOWN:
                raise ConfigError(
                    f"{key}: {name!r} is read as a missing value by programs for statistics: give it another "
                    "name"
                )


def check_sequences(study: Study) -> None:
    """Check that each block of a tapping study has a sequence of which there is a throughput.

    Raises: ConfigError: If a condition has fewer movements of one distance and width than
        `MIN_SEQUENCE_TRIALS` in a block, even if all trials are hits.
    """
    if not isinstance(study.task, Tapping):
        return
    movements, condition = _shortest_sequence(study)
    if movements >= MIN_SEQUENCE_TRIALS:
        return

    # The least number of repetitions that suffices is found by trying.
    advised = study.repetitions + 1
    while advised < MAX_ADVISED_REPETITIONS:
        more = study.model_copy(update={"repetitions": advised})
        if _shortest_sequence(more)[0] >= MIN_SEQUENCE_TRIALS:
            break
        advised += 1
    of_condition = f"{condition}: " if condition else ""
    raise ConfigError(
        f"repetitions: {study.repetitions}: {of_condition}a block has {movements} "
        f"movements with one distance and width, of which the first trial is none, and throughput needs "
        f"{MIN_SEQUENCE_TRIALS}; use repetitions: {min(advised, MAX_ADVISED_REPETITIONS)} or more"
    )


def _shortest_sequence(study: Study) -> tuple[int, str]:
    """Return the fewest movements of one condition, distance and width in a block, and the condition."""
    distances: dict[Cell, float] = {}
    for cell in _cells(study):
        task = study.task_in(dict(cell))
        distances[cell] = task.model_dump()["distance_m"]
    shortest: list[tuple[int, str]] = []
    for name in study.people:
        plan = plan_of(study, name)
        for number in range(1, len(plan.order) + 1):
            trials = [trial for trial in plan.block(number) if not trial.practice]
            cells = [tuple(trial.cell.items()) for trial in trials]
            # A movement has the distance of the trial before, at whose target it begins.
            counts: dict[Cell, Counter[float]] = {cell: Counter() for cell in cells}
            for previous, cell in itertools.pairwise(cells):
                counts[cell][distances[previous]] += 1
            for cell, by_distance in counts.items():
                most = max(by_distance.values(), default=0)
                shortest.append((most, condition_of(dict(cell))))
    return min(shortest)


def _cells(study: Study) -> Iterator[Cell]:
    """Yield all combinations of levels, in the order of `StudyTrial.cell`."""
    cells_by_vary = [study.cells(vary) for vary in ("between", "block", "trial")]
    for parts in itertools.product(*cells_by_vary):
        levels: dict[str, str] = {}
        for part in parts:
            levels |= part
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
