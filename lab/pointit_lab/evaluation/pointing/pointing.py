"""Corrected systematic errors of pointing and drift of the IMU, as rows of one table."""

from collections.abc import Callable, Sequence
from pathlib import Path

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets import proximity_feedback, vr_eyefinger
from pointit_lab.evaluation.pointing import drift_simulated
from pointit_lab.evaluation.pointing.drift import drift_rows
from pointit_lab.evaluation.pointing.offset import offset_rows
from pointit_lab.evaluation.recordings.row import Row, arranged

RECORDED = (vr_eyefinger.NAME, proximity_feedback.NAME)
"""Folders with recordings of people who point without a cursor."""

SETS = (*RECORDED, drift_simulated.NAME)


def pointing_rows(
    recordings: Path, sets: Sequence[str], subjects: Sequence[str], tick: Callable[[str], None]
) -> list[Row]:
    """Return the errors after correction.

    Args:
        recordings: folder with one folder per set.
        sets: keys of `SETS` to evaluate. Empty: all.
        subjects: subjects whose rows to return. Empty: all, and the rows over all.
        tick: called with a short description of the current step.

    Raises:
        ConfigError: If a file is damaged, no set is present, or there is no data of these subjects.
    """
    wanted = tuple(sets) or SETS
    recorded = [name for name in wanted if name in RECORDED]
    if recorded and not any((recordings / name).is_dir() for name in recorded):
        raise ConfigError(f"{recordings}: has none of the folders {', '.join(recorded)}")
    measured = (*offset_rows(recordings, tick), *drift_rows(recordings, tick))
    rows = [row for row in measured if row.set in wanted]
    known = dict.fromkeys(row.subject for row in rows)
    for subject in subjects:
        if subject not in known:
            raise ConfigError(f"{recordings}: has no subject {subject!r}; there are {', '.join(known)}")
    return arranged(row for row in rows if not subjects or row.subject in subjects)
