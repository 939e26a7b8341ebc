"""Simulated people who select, beside real ones: by method, in each condition."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pointit.evaluation.recordings.parallel import map_parallel
from pointit.evaluation.selection.condition import Condition
from pointit.evaluation.selection.difference import Difference, differences_of
from pointit.evaluation.selection.human import Humans
from pointit.evaluation.selection.row import SelectionRow
from pointit.evaluation.selection.score import Score, figures_of
from pointit.evaluation.selection.trial import Trial, run

CHUNK = 5
"""Trials in one piece of work at most."""


@dataclass(frozen=True, kw_only=True)
class SimulationSpeed:
    """How fast time went by in the simulation."""

    simulated_s: float
    cpu_s: float
    """Processor time, of all processes together."""

    @classmethod
    def of(cls, results: Iterable[Sequence[Score]]) -> "SimulationSpeed":
        """Return that of all `results`."""
        scores = [score for each in results for score in each]
        return cls(
            simulated_s=sum(score.simulated_s for score in scores),
            cpu_s=sum(score.cpu_s for score in scores),
        )

    @property
    def times_real(self) -> float:
        """Return how many times faster than real time it was, on one core."""
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
    """Return how simulated people do by condition and method, how methods differ, and the speed.

    A trial has the same people, packages and unrest of hands with every method, whatever else is tried: rows
    of one condition differ by the method alone. Every trial has a seed of its own.

    Args:
        conditions: what is tried.
        methods: as `selection_method.selector_config` takes them.
        trials: of each condition and method.
        seed: of all that is random in the first trial; the next one has the next.
        jobs: processes to use; 1: this one alone.
        humans: figures of people.
        tick: called with the number of trials that are done and of all.

    Raises:
        PointItError: a process came to an end by itself.
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
    """Return what `--json FILE` writes."""
    return {
        "rows": [row.as_json() for row in rows],
        "differences": [difference.as_json() for difference in differences],
    }


def done(trials: Sequence[Trial]) -> list[Score]:
    """Return what became of `trials`; for other processes."""
    return [run(trial) for trial in trials]


def _worked(pieces: Sequence[Sequence[Trial]], jobs: int) -> Iterator[tuple[int, list[Score]]]:
    if jobs > 1:
        yield from map_parallel(done, pieces, jobs)
    else:
        for number, piece in enumerate(pieces):
            yield number, done(piece)


def _cut(trials: int) -> list[range]:
    return [range(first, min(first + CHUNK, trials)) for first in range(0, trials, CHUNK)]
