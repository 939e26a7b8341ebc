"""Recordings of people who are localized, each set read into trials of one format."""

from collections.abc import Callable, Sequence
from pathlib import Path

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets import motion_relloc, proximity_waypoints, vr_arm_pointing
from pointit_lab.evaluation.localization.trial import TrialReading

SETS: dict[str, Callable[[Path, TrialReading], None]] = {
    module.NAME: module.read for module in (motion_relloc, proximity_waypoints, vr_arm_pointing)
}
"""Readers by the name of the folder."""


def read_trials(recordings: Path, names: Sequence[str] = (), subjects: Sequence[str] = ()) -> TrialReading:
    """Return the trials of the sets `names` (empty: all present ones) and `subjects` (empty: all).

    Missing sets and files are noted and skipped.

    Args:
        recordings: folder with one folder per set.
        names: keys of `SETS`.
        subjects: names in the files.

    Raises:
        ConfigError: If a file is damaged, no set is present, or there is no data of these subjects.
    """
    reading = TrialReading()
    selected_sets = tuple(names) or tuple(SETS)
    present = [name for name in selected_sets if (recordings / name).is_dir()]
    if not present:
        raise ConfigError(f"{recordings}: has none of the folders {', '.join(selected_sets)}")
    for name in selected_sets:
        if name in present:
            SETS[name](recordings / name, reading)
        else:
            reading.skip(recordings / name, "there is no such folder")

    # subjects are known only from the trials
    known = dict.fromkeys(trial.subject for trial in reading.trials)
    for subject in subjects:
        if subject not in known:
            known_names = ", ".join(known) or "none"
            raise ConfigError(f"{recordings}: has no subject {subject!r}; there are {known_names}")
    if subjects:
        reading.trials = [trial for trial in reading.trials if trial.subject in subjects]
    if not reading.trials:
        reasons = "; ".join(reading.notes) or "no trials"
        raise ConfigError(f"{recordings}: has nothing to evaluate: {reasons}")
    return reading
