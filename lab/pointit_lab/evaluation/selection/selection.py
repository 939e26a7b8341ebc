"""Comparison of simulated people with real ones, by condition and selection method."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pointit_lab.evaluation.recordings.parallel import map_parallel
from pointit_lab.evaluation.selection.condition import Condition
from pointit_lab.evaluation.selection.difference import Difference, differences_of
from pointit_lab.evaluation.selection.human import Humans
from pointit_lab.evaluation.selection.row import SelectionRow
from pointit_lab.evaluation.selection.score import Score, figures_of
from pointit_lab.evaluation.selection.trial import Trial, run

CHUNK = 5
"""Maximum of trials in one piece of work."""


@dataclass(frozen=True, kw_only=True)
class SimulationSpeed:
    """Speed of the simulation relative to real time."""

    simulated_s: float
    cpu_s: float
    """Processor time of all processes together."""

    @classmethod
    def of(cls, results: Iterable[Sequence[Score]]) -> "SimulationSpeed":
        """Return the speed over all `results`."""
        scores = [score for each in results for score in each]
        return cls(
            simulated_s=sum(score.simulated_s for score in scores),
            cpu_s=sum(score.cpu_s for score in scores),
        )

    @property
    def times_real(self) -> float:
        """Return the real-time factor on one core."""
        return self.simulated_s / self.cpu_s if self.cpu_s else 0.0


def selection_rows(
    conditions: Sequence[Condition],
    methods: Sequence[str],
    *,
    trials: int,
    seed: int,
    jobs: int,
    humans: Humans,
    tick: Callable[[int, int], None],
) -> tuple[list[SelectionRow], list[Difference], SimulationSpeed]:
    """Return results of simulated people by condition and method, differences of methods, and the speed.

    A trial has the same people, packages and hand motion for every method, so that rows of one condition
    differ by the method alone. Every trial has its own seed.

    Args:
        conditions: conditions to evaluate.
        methods: names for `method.selector_config`.
        trials: number of trials of each condition and method.
        seed: seed of the first trial, incremented for each.
        jobs: number of processes; 1: this one alone.
        humans: metrics of people.
        tick: called with the number of finished trials and of all.

    Raises:
        PointItError: If a process ended unexpectedly.
    """
    pieces = [
        [Trial(condition=condition, method=method, seed=seed + number) for number in numbers]
        for condition in conditions
        for method in methods
        for numbers in _cut(trials)
    ]
    results: dict[int, list[Score]] = {}
    done, total = 0, len(conditions) * len(methods) * trials
    tick(done, total)
    for number, scores in _worked(pieces, jobs):
        results[number] = scores
        done += len(scores)
        tick(done, total)
    groups: dict[tuple[Condition, str], list[Score]] = defaultdict(list)
    for number, piece in enumerate(pieces):
        groups[piece[0].condition, piece[0].method] += results[number]
    rows = [
        SelectionRow(
            bench=condition.bench,
            condition=condition.name,
            method=method,
            figures=figures_of(scores, per_package=condition.per_package),
            human=humans.get((condition.bench, condition.name), {}),
        )
        for (condition, method), scores in groups.items()
    ]
    return rows, differences_of(groups), SimulationSpeed.of(results.values())


def document(rows: Sequence[SelectionRow], differences: Sequence[Difference]) -> dict[str, Any]:
    """Return the document for `--json FILE`."""
    return {
        "rows": [row.as_json() for row in rows],
        "differences": [difference.as_json() for difference in differences],
    }


def done(trials: Sequence[Trial]) -> list[Score]:
    """Return the scores of `trials`. Runs in other processes."""
    return [run(trial) for trial in trials]


def _worked(pieces: Sequence[Sequence[Trial]], jobs: int) -> Iterator[tuple[int, list[Score]]]:
    if jobs > 1:
        yield from map_parallel(done, pieces, jobs)
    else:
        for number, piece in enumerate(pieces):
            yield number, done(piece)


def _cut(trials: int) -> list[range]:
    return [range(first, min(first + CHUNK, trials)) for first in range(0, trials, CHUNK)]
