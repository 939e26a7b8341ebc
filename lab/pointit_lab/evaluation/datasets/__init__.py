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
    wanted = tuple(names) or tuple(SETS)
    there = [name for name in wanted if (recordings / name).is_dir()]
    if not there:
        raise ConfigError(f"{recordings}: has none of the folders {', '.join(wanted)}")
    for name in wanted:
        if name in there:
            SETS[name](recordings / name, reading)
        else:
            reading.skip(recordings / name, "there is no such folder")
    known = dict.fromkeys(trial.subject for trial in reading.trials)
    unknown_subjects = [subject for subject in subjects if subject not in known]
    if unknown_subjects:
        raise ConfigError(
            f"{recordings}: has no subject {unknown_subjects[0]!r}; there are {', '.join(known) or 'none'}"
        )
    if subjects:
        reading.trials = [trial for trial in reading.trials if trial.subject in subjects]
    if not reading.trials:
        raise ConfigError(f"{recordings}: has nothing to evaluate: {'; '.join(reading.notes) or 'no trials'}")
    return reading
