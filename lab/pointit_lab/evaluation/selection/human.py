"""Results of real people in the simulated conditions, from recordings if available."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from pointit_lab.evaluation.datasets import belts_lab
from pointit_lab.evaluation.selection.condition import LAB, lab_condition
from pointit_lab.evaluation.selection.row import SelectionMetrics, TimeSpread

Humans = dict[tuple[str, str], dict[str, SelectionMetrics]]
"""Metrics by bench and condition, then by the people's pointing device."""

USUALLY = {"pointing": "pointing", "mouse_gui": "mouse"}


def humans(recordings: Path | None, notes: list[str]) -> Humans:
    """Return the results of people; missing recordings are noted and left out.

    Args:
        recordings: folder with one folder per set. None: not given.
        notes: receives a message for each missing set.

    Raises:
        ConfigError: If a file is damaged.
    """
    name = belts_lab.NAME
    if recordings is None:
        notes.append(f"no people of {name} to compare with: give --data DIR with the recordings")
        return {}
    folder = recordings / name
    if not folder.is_dir():
        notes.append(f"no people of {name} to compare with: there is no folder {folder}")
        return {}
    return _lab(folder)


def lab_figures(runs: list[belts_lab.BeltRun]) -> SelectionMetrics:
    """Return the metrics over `runs` of people."""
    completions_s: list[float] = []
    toggles: list[belts_lab.Toggle] = []
    for run in runs:
        toggles += run.toggles
        # a run with a missed target has no end
        if run.completion_s is not None:
            completions_s.append(run.completion_s)

    wrong_rate = None
    if toggles:
        wrong_toggles = sum(toggle.is_wrong for toggle in toggles)
        wrong_rate = wrong_toggles / len(toggles)
    targets = sum(run.targets for run in runs)
    missed_rate = None
    if targets:
        missed = sum(run.missed for run in runs)
        missed_rate = missed / targets
    return SelectionMetrics(
        n=len(runs),
        time_s=TimeSpread.of(completions_s),
        between_s=TimeSpread.of(_intervals_s(runs)),
        wrong_rate=wrong_rate,
        missed_rate=missed_rate,
    )


def _intervals_s(runs: Sequence[belts_lab.BeltRun]) -> Iterator[float]:
    """Yield the times from each correct toggle of a run to the next."""
    for run in runs:
        correct = [toggle for toggle in run.toggles if not toggle.is_wrong]
        for before, after in pairwise(correct):
            yield after.at_s - before.at_s


def _lab(folder: Path) -> Humans:
    groups = defaultdict[tuple[str, str], list[belts_lab.BeltRun]](list)
    for run in belts_lab.read_runs(folder):
        condition = lab_condition(run.motion, run.level, run.speed_mps)
        device = USUALLY[run.interface]
        groups[condition, device].append(run)
    metrics: Humans = defaultdict(dict)
    for (condition, device), runs in groups.items():
        metrics[LAB, condition][device] = lab_figures(runs)
    return dict(metrics)
