"""The full list of trials of a participant, and what is left of it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pointit.runtime.errors import ConfigError
from pointit.study.data import Row, done_trials
from pointit.study.model import Study
from pointit.study.order import square
from pointit.study.tasks.scene import Trial


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Order and trials of one participant."""

    participant: str
    group: dict[str, str]
    """Levels of the factors between participants."""
    order: tuple[str, ...]
    """Names of the conditions of the blocks."""
    trials: tuple[Trial, ...]

    def block(self, number: int) -> tuple[Trial, ...]:
        """Return the trials of a block."""
        return tuple(trial for trial in self.trials if trial.block == number)


def condition_of(cell: dict[str, str]) -> str:
    """Return the name of a condition, such as `gauge` or `gauge, wide`."""
    return ", ".join(cell.values())


def plan_of(study: Study, participant: str) -> Plan:
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
    trials: list[Trial] = []
    for number, block in enumerate(blocks, 1):
        rng = np.random.default_rng([study.seed, index, number])
        practice = _shuffled(study, rng, study.practice)
        data = [cell for _ in range(study.repetitions) for cell in _shuffled(study, rng)]
        for place, inner in enumerate(practice + data):
            seed = int(np.random.SeedSequence([study.seed, index, number, place]).generate_state(1)[0])
            trials.append(
                Trial(
                    number=len(trials) + 1,
                    block=number,
                    place=place,
                    practice=place < len(practice),
                    cell={name: {**group, **block, **inner}[name] for name in study.factors},
                    seed=seed,
                )
            )
    return Plan(
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


class Progress:
    """The trials that are left. A crash at any time loses at most the attempt that was going on."""

    def __init__(self, plan: Plan, rows: Sequence[Row]) -> None:
        """Go on after the attempts in `rows`."""
        self._trials = {trial.number: trial for trial in plan.trials}
        self._left = sorted(self._trials.keys() - done_trials(rows))
        self._attempts = Counter(int(row["trial"]) for row in rows)
        self._last = int(rows[-1]["trial"]) if rows else None

    @property
    def left(self) -> int:
        """Return the number of trials to do."""
        return len(self._left)

    @property
    def current(self) -> Trial | None:
        """Return the next trial, or None if all are done."""
        return self._trials[self._left[0]] if self._left else None

    @property
    def attempt(self) -> int:
        """Return the number of the next attempt at the current trial, from 1."""
        return self._attempts[self._left[0]] + 1

    def end(self, *, is_done: bool) -> None:
        """Note that an attempt at the current trial has ended."""
        self._last = self._left[0]
        self._attempts[self._last] += 1
        if is_done:
            self._left.pop(0)

    def repeat(self) -> int | None:
        """Do the last trial again; return its number, or None if there is none."""
        if self._last is not None and self._last not in self._left:
            self._left.insert(0, self._last)
        return self._last
