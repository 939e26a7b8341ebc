"""Score of one simulated trial, and metrics over many."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from pointit_lab.evaluation.selection.row import SelectionMetrics, TimeSpread


@dataclass(kw_only=True)
class Score:
    """Actions of a person in one trial; filled while it runs."""

    targets: int
    """Number of packages to select."""
    missed: int = 0
    """Targets not selected at the end or when they left."""
    toggles: int = 0
    wrong: int = 0
    """Toggles that left their package in the wrong state."""
    right_s: list[float] = field(default_factory=list[float])
    """Times of the correct toggles of targets, from the start."""
    took_s: list[float] = field(default_factory=list[float])
    """Times that count, see `SelectionMetrics`."""
    simulated_s: float = 0.0
    cpu_s: float = 0.0
    """Processor time of the simulation."""
    frames: int = 0
    """Frames drawn for the simulated eyes."""

    def toggled(self, at_s: float, *, selected: bool, is_target: bool) -> None:
        """Count a toggle of a package to `selected` or not."""
        self.toggles += 1
        self.wrong += selected is not is_target
        if selected and is_target:
            self.right_s.append(at_s)


def figures_of(scores: Sequence[Score], *, per_package: bool) -> SelectionMetrics:
    """Return the metrics over `scores`; `per_package`: n counts packages, not runs."""
    targets, toggles = sum(score.targets for score in scores), sum(score.toggles for score in scores)
    return SelectionMetrics(
        n=targets if per_package else len(scores),
        time_s=TimeSpread.of(took_s for score in scores for took_s in score.took_s),
        between_s=TimeSpread.of(
            after - before for score in scores for before, after in pairwise(sorted(score.right_s))
        ),
        wrong_rate=sum(score.wrong for score in scores) / toggles if toggles else None,
        missed_rate=sum(score.missed for score in scores) / targets if targets else None,
    )
