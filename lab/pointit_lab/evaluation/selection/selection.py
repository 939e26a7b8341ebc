"""Comparison of simulated people with real ones, by condition and selection method."""

import zlib
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from pointit.schemas import NS_PER_S, SelectionEvent
from pointit_lab.evaluation.recordings.parallel import map_in_order
from pointit_lab.evaluation.selection.condition import Condition
from pointit_lab.evaluation.selection.difference import Difference, differences_of
from pointit_lab.evaluation.selection.human import Humans
from pointit_lab.evaluation.selection.method import selector_config
from pointit_lab.evaluation.selection.row import Score, SelectionTrialRow, figures_of
from pointit_lab.evaluation.selection.stage import RIGHT_BAY, TrialSetup, stage_of
from pointit_lab.evaluation.selection.world import START_NS, USUAL, Rates, World

SETTLE_S = 1.5
"""A run is over when exactly the targets have been selected for this time."""

CHUNK = 5
"""Maximum of trials in one piece of work."""


@dataclass(frozen=True, kw_only=True)
class SelectionTrial:
    """Parameters of one trial."""

    condition: Condition
    method: str
    seed: int
    rates: Rates = USUAL

    @property
    def entropy(self) -> tuple[int, ...]:
        """Return the seed of everything random; the same for every method."""
        name = f"{self.condition.bench}/{self.condition.name}"
        return (self.seed, zlib.crc32(name.encode()))


def run(trial: SelectionTrial) -> Score:
    """Run `trial` and return its score."""
    setup = stage_of(trial.condition, trial.entropy)
    world = World(
        setup.environment,
        setup.movers,
        setup.people,
        surfaces=setup.surfaces,
        selector=selector_config(trial.method),
        seed=trial.entropy,
        rates=trial.rates,
    )
    recorder = TrialRecorder(trial.condition, setup)
    end_ns = START_NS + round(setup.limit_s * NS_PER_S)
    while world.now_ns < end_ns and not recorder.is_over(world.now_ns):
        recorder.take(world.step(), world.entered_ns)
    score = recorder.finish()
    score.simulated_s = (world.now_ns - START_NS) / NS_PER_S
    score.frames = world.frames
    return score


class TrialRecorder:
    """Records the events of packages."""

    def __init__(self, condition: Condition, setup: TrialSetup) -> None:
        self._passing = condition.per_package
        self._stage = setup
        self._score = Score(targets=condition.targets)
        self._selected: dict[str, bool] = {}
        """Selected packages; True for targets."""
        self._last_ns = START_NS
        self._took_s: dict[str, float] = {}
        """Time from a target's entry to its final selection."""
        self._out: set[str] = set()
        self._right_out = 0

    def take(self, events: Sequence[SelectionEvent], entered_ns: Mapping[str, int]) -> None:
        """Record `events`; `entered_ns`: entry time of each package."""
        for event in events:
            at_s = (event.stamp_ns - START_NS) / NS_PER_S
            is_target = event.kind == self._stage.target_kind
            if event.event == "selected":
                self._selected[event.object_id] = is_target
                self._toggled(event, at_s, selected=True)
                if is_target and event.object_id in entered_ns:
                    took_ns = event.stamp_ns - entered_ns[event.object_id]
                    self._took_s[event.object_id] = took_ns / NS_PER_S
            elif event.event == "deselected" and event.user:
                self._selected.pop(event.object_id, None)
                self._took_s.pop(event.object_id, None)
                self._toggled(event, at_s, selected=False)
            elif event.event == "dispatched":
                self._leave(event)

    def is_over(self, now_ns: int) -> bool:
        """Return True if nothing can change any more."""
        if self._passing:
            return len(self._out) >= self._stage.packages
        settled_ns = now_ns - self._last_ns
        return self._is_complete and settled_ns >= SETTLE_S * NS_PER_S

    def finish(self) -> Score:
        """Return the score at the end of the trial."""
        score = self._score
        if self._passing:
            score.missed = score.targets - self._right_out
            score.took_s = list(self._took_s.values())
        else:
            correct = sum(self._selected.values())
            score.missed = score.targets - correct
            if score.missed == 0 and score.right_s:
                score.took_s = [(self._last_ns - START_NS) / NS_PER_S]
        return score

    @property
    def _is_complete(self) -> bool:
        are_targets = self._selected.values()
        return len(are_targets) == self._score.targets and all(are_targets)

    def _toggled(self, event: SelectionEvent, at_s: float, *, selected: bool) -> None:
        is_target = event.kind == self._stage.target_kind
        self._score.toggled(at_s, selected=selected, is_target=is_target)
        self._last_ns = event.stamp_ns

    def _leave(self, event: SelectionEvent) -> None:
        if event.object_id in self._out:
            return
        self._out.add(event.object_id)
        is_target = event.kind == self._stage.target_kind
        self._right_out += is_target and event.bay == RIGHT_BAY


def selection_rows(
    conditions: Sequence[Condition],
    methods: Sequence[str],
    *,
    trials: int,
    seed: int,
    jobs: int,
    humans: Humans,
    tick: Callable[[int, int], None],
) -> tuple[list[SelectionTrialRow], list[Difference]]:
    """Return results of simulated people by condition and method, and differences of methods.

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
    # the same seeds for every method
    tasks: list[SelectionTrial] = []
    for condition, method, number in product(conditions, methods, range(trials)):
        tasks.append(SelectionTrial(condition=condition, method=method, seed=seed + number))
    scores = map_in_order(run, tasks, jobs=jobs, chunk=CHUNK, tick=tick)

    # a row for each condition and method
    groups = defaultdict[tuple[Condition, str], list[Score]](list)
    for task, score in zip(tasks, scores, strict=True):
        groups[task.condition, task.method].append(score)
    rows: list[SelectionTrialRow] = []
    for (condition, method), own_scores in groups.items():
        figures = figures_of(own_scores, per_package=condition.per_package)
        human = humans.get((condition.bench, condition.name), {})
        row = SelectionTrialRow(
            bench=condition.bench,
            condition=condition.name,
            method=method,
            figures=figures,
            human=human,
        )
        rows.append(row)
    return rows, differences_of(groups)


def document(rows: Sequence[SelectionTrialRow], differences: Sequence[Difference]) -> dict[str, Any]:
    """Return the document for `--json FILE`."""
    row_objects = [row.as_json() for row in rows]
    difference_objects = [difference.as_json() for difference in differences]
    return {"rows": row_objects, "differences": difference_objects}
