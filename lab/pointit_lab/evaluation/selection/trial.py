"""One trial of a condition, a method and a seed, and its score."""

import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pointit.schemas import NS_PER_S, SelectionEvent
from pointit_lab.evaluation.selection.condition import Condition
from pointit_lab.evaluation.selection.method import selector_config
from pointit_lab.evaluation.selection.score import Score
from pointit_lab.evaluation.selection.stage import TrialSetup, stage_of
from pointit_lab.evaluation.selection.world import START_NS, USUAL, Rates, World

SETTLE_S = 1.5
"""A run is over when exactly the targets have been selected for this time."""


@dataclass(frozen=True, kw_only=True)
class Trial:
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


def run(trial: Trial) -> Score:
    """Run `trial` and return its score."""
    began_ns = time.process_time_ns()
    stage = stage_of(trial.condition, trial.entropy)
    world = World(
        stage.environment,
        stage.movers,
        stage.people,
        surfaces=stage.surfaces,
        selector=selector_config(trial.method),
        seed=trial.entropy,
        rates=trial.rates,
    )
    watch = TrialRecorder(trial.condition, stage)
    end_ns = START_NS + round(stage.limit_s * NS_PER_S)
    while world.now_ns < end_ns and not watch.is_over(world.now_ns):
        watch.take(world.step(), world.entered_ns)
    score = watch.finish()
    score.simulated_s = (world.now_ns - START_NS) / NS_PER_S
    score.frames = world.frames
    score.cpu_s = (time.process_time_ns() - began_ns) / 1e9
    return score


class TrialRecorder:
    """Records the events of packages."""

    def __init__(self, condition: Condition, stage: TrialSetup) -> None:
        self._passing = condition.per_package
        self._stage = stage
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
                    self._took_s[event.object_id] = (event.stamp_ns - entered_ns[event.object_id]) / NS_PER_S
            elif event.event == "deselected" and event.user:
                self._selected.pop(event.object_id, None)
                self._took_s.pop(event.object_id, None)
                self._toggled(event, at_s, selected=False)
            elif event.event in self._stage.ends:
                self._leave(event)

    def is_over(self, now_ns: int) -> bool:
        """Return True if nothing can change any more."""
        if self._passing:
            return len(self._out) >= self._stage.packages
        return self._is_complete and now_ns - self._last_ns >= SETTLE_S * NS_PER_S

    def finish(self) -> Score:
        """Return the score at the end of the trial."""
        score = self._score
        if self._passing:
            score.missed = score.targets - self._right_out
            score.took_s = list(self._took_s.values())
        else:
            score.missed = score.targets - sum(self._selected.values())
            if score.missed == 0 and score.right_s:
                score.took_s = [(self._last_ns - START_NS) / NS_PER_S]
        return score

    @property
    def _is_complete(self) -> bool:
        return len(self._selected) == self._score.targets and all(self._selected.values())

    def _toggled(self, event: SelectionEvent, at_s: float, *, selected: bool) -> None:
        is_target = event.kind == self._stage.target_kind
        self._score.toggled(at_s, selected=selected, is_target=is_target)
        self._last_ns = event.stamp_ns

    def _leave(self, event: SelectionEvent) -> None:
        if event.object_id in self._out:
            return
        self._out.add(event.object_id)
        if event.kind != self._stage.target_kind:
            return
        bay = self._stage.right_bay
        self._right_out += event.bay == bay if bay else self._selected.get(event.object_id, False)
