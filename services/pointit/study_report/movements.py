"""Movements from target to target, of tasks such as tapping."""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointit.study_report.model import SELECTED, TARGET, TrialRow, Trials

MOST_UNEVEN = 1.05
"""Highest ratio of distances, and of widths, that count as equal."""
Group = tuple[tuple[str, str], ...]
"""Levels by factor, without the factors that set the distance or the width, of which difficulty is made."""


class Movement(NamedTuple):
    """A trial that began at the known target of the trial before, in the same block."""

    trial: TrialRow
    distance_m: float
    """From target to target."""
    error_m: float
    """Along that line, positive beyond the target. NaN if nothing was selected."""
    before_m: float
    """Error with which the trial before ended, along its own line. NaN if not known."""
    size_m: tuple[float, float] = (0.0, 0.0)
    """Distance and width, where those that are nearly equal are the same."""
    group: Group = ()


def movements(study: Trials) -> list[Movement]:
    """Return the movements of all counted trials with a width, a target and a target before, by condition."""
    found: list[Movement] = []
    error_m = np.nan
    for start, row in zip(study.counted, study.counted[1:], strict=False):
        before_m, error_m = error_m, np.nan
        is_next = (start.participant, start.block) == (row.participant, row.block)
        if not is_next or not all(name in each.numbers for name in TARGET for each in (start, row)):
            continue
        target = _point(row, TARGET)
        line = target - _point(start, TARGET)
        distance_m = float(np.linalg.norm(line))
        if distance_m > 0 and row.numbers.get("target_width_m", 0) > 0:
            if all(name in row.numbers for name in SELECTED):
                error_m = float((_point(row, SELECTED) - target) @ line) / distance_m
            found.append(Movement(row, distance_m, error_m, before_m))
    found.sort(key=lambda each: study.conditions.index(each.trial.levels))
    distances = _merged([each.distance_m for each in found])
    widths = _merged([each.trial.numbers["target_width_m"] for each in found])
    sizes = [(distances[each.distance_m], widths[each.trial.numbers["target_width_m"]]) for each in found]
    kept = [factor for factor in study.factors if not _sets_size(study.index(factor), found, sizes)]
    groups = (tuple((name, each.trial.levels[study.index(name)]) for name in kept) for each in found)
    return [
        each._replace(size_m=size, group=group)
        for each, size, group in zip(found, sizes, groups, strict=True)
    ]


def _sets_size(factor: int, moved: Sequence[Movement], sizes: Sequence[tuple[float, float]]) -> bool:
    """Return True if each level of a factor has one distance of its own, or one width."""
    for part in (0, 1):
        by_level: dict[str, set[float]] = defaultdict(set)
        for each, size in zip(moved, sizes, strict=True):
            by_level[each.trial.levels[factor]].add(size[part])
        values = {value for found in by_level.values() for value in found}
        if 1 < len(by_level) == len(values) and all(len(found) == 1 for found in by_level.values()):
            return True
    return False


def _point(trial: TrialRow, names: Sequence[str]) -> NDArray[np.float64]:
    return np.array([trial.numbers[name] for name in names])


def _merged(values: Sequence[float]) -> dict[float, float]:
    """Return the mean of the group of each value; groups begin at the least, with at most `MOST_UNEVEN`."""
    groups: list[list[float]] = []
    for value in sorted(set(values)):
        if not groups or value > groups[-1][0] * MOST_UNEVEN:
            groups.append([])
        groups[-1].append(value)
    return {value: sum(group) / len(group) for group in groups for value in group}
