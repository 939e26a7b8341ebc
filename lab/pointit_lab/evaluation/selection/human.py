"""Results of real people in the simulated conditions, from recordings if available."""

from collections import defaultdict
from itertools import pairwise
from pathlib import Path

from pointit_lab.evaluation.datasets import belts_lab, belts_vr
from pointit_lab.evaluation.selection.condition import LAB, VR, lab_condition, vr_condition
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
    found: Humans = {}
    for name, read in ((belts_lab.NAME, _lab), (belts_vr.NAME, _vr)):
        if recordings is None:
            notes.append(f"no people of {name} to compare with: give --data DIR with the recordings")
        elif not (recordings / name).is_dir():
            notes.append(f"no people of {name} to compare with: there is no folder {recordings / name}")
        else:
            found |= read(recordings / name)
    return found


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


def vr_figures(passages: list[belts_vr.Passage]) -> SelectionMetrics:
    """Return the metrics over `passages` of packages, including those that should not be selected."""
    targets = [passage for passage in passages if passage.is_target]
    took_s = [passage.took_s for passage in targets if passage.took_s is not None]
    wrong = sum(passage.took_s is not None for passage in passages if not passage.is_target)
    toggles = wrong + len(took_s)
    return SelectionMetrics(
        n=len(targets),
        time_s=TimeSpread.of(took_s),
        wrong_rate=wrong / toggles if toggles else None,
        missed_rate=1.0 - len(took_s) / len(targets) if targets else None,
    )


def _lab(folder: Path) -> Humans:
    groups: dict[tuple[str, str], list[belts_lab.BeltRun]] = defaultdict(list)
    for run in belts_lab.read_runs(folder):
        groups[lab_condition(run.motion, run.level, run.speed_mps), USUALLY[run.interface]].append(run)
    return _gathered(LAB, {key: lab_figures(runs) for key, runs in groups.items()})


def _vr(folder: Path) -> Humans:
    groups: dict[tuple[str, str], list[belts_vr.Passage]] = defaultdict(list)
    for passage in belts_vr.read_passages(folder):
        groups[vr_condition(passage.speed_mps), "pointing"].append(passage)
    return _gathered(VR, {key: vr_figures(passages) for key, passages in groups.items()})


def _gathered(bench: str, groups: dict[tuple[str, str], SelectionMetrics]) -> Humans:
    found: Humans = defaultdict(dict)
    for (condition, means), figures in groups.items():
        found[bench, condition][means] = figures
    return dict(found)
