"""Results of real people in the simulated conditions, from recordings if available."""

from collections import defaultdict
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
    elif not (recordings / name).is_dir():
        notes.append(f"no people of {name} to compare with: there is no folder {recordings / name}")
    else:
        return _lab(recordings / name)
    return {}


def lab_figures(runs: list[belts_lab.BeltRun]) -> SelectionMetrics:
    """Return the metrics over `runs` of people."""
    toggles = [toggle for run in runs for toggle in run.toggles]
    targets = sum(run.targets for run in runs)
    return SelectionMetrics(
        n=len(runs),
        time_s=TimeSpread.of(run.completion_s for run in runs if run.completion_s is not None),
        between_s=TimeSpread.of(
            after.at_s - before.at_s
            for run in runs
            for before, after in pairwise([toggle for toggle in run.toggles if not toggle.is_wrong])
        ),
        wrong_rate=sum(toggle.is_wrong for toggle in toggles) / len(toggles) if toggles else None,
        missed_rate=sum(run.missed for run in runs) / targets if targets else None,
    )


def _lab(folder: Path) -> Humans:
    groups: dict[tuple[str, str], list[belts_lab.BeltRun]] = defaultdict(list)
    for run in belts_lab.read_runs(folder):
        groups[lab_condition(run.motion, run.level, run.speed_mps), USUALLY[run.interface]].append(run)
    found: Humans = defaultdict(dict)
    for (condition, means), runs in groups.items():
        found[LAB, condition][means] = lab_figures(runs)
    return dict(found)
