"""Second localizations with memory: of the same person better, each pair counted with and without."""

from dataclasses import replace
from pathlib import Path

import pytest

from pointit.cli.main import command
from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets import read_trials
from pointit_lab.evaluation.localization.memory import (
    OTHERS,
    OWN,
    WITHOUT,
    accepted_of,
    memory_rows,
    remembered_bias,
)
from pointit_lab.evaluation.localization.trial import FollowRecording
from pointit_lab.evaluation.recordings.row import MetricSpread
from tests.support.invoked import printed
from tests.support.published_recordings import Stand, write_track


def following(folder: Path, name: str, subject: str, stand: Stand) -> FollowRecording:
    write_track(folder / name, stand, duration_s=11.0, subject=subject)
    (followed,) = read_trials(folder / name).followed
    return replace(followed, name=name)


def test_memory_of_the_person_lowers_the_error_and_that_of_another_one_is_not_used(tmp_path: Path) -> None:
    here, there = Stand(bias_deg=9.0, noise_deg=1.0), Stand(x=-1.0, y=1.2, bias_deg=9.0, noise_deg=1.0)
    followed = [
        following(tmp_path, "first", "anna", here),
        following(tmp_path, "second", "anna", there),
        following(tmp_path, "third", "ben", Stand(bias_deg=-12.0, noise_deg=1.0)),
    ]
    rows = {(row.condition, row.solver): row for row in memory_rows(followed) if row.subject == "anna"}
    alone, own = rows["3 s", "pointit"].position_m, rows["3 s", OWN].position_m
    assert isinstance(alone, MetricSpread)
    assert isinstance(own, MetricSpread)
    assert own.median < 0.9 * alone.median
    assert rows["3 s", "pointit"].n == rows["3 s", OWN].n >= 2 * 7  # of nine each, those after a measurement
    assert rows["3 s", OTHERS].n == rows["3 s", WITHOUT].n == 2 * 9


def test_localizations_follow_one_another_and_each_adds_to_the_memory(tmp_path: Path) -> None:
    accepted = list(accepted_of(following(tmp_path, "first", "anna", Stand(bias_deg=9.0, noise_deg=1.0))))
    ends_s = [each.start_s + float(each.condition.split()[0]) for each in accepted]
    assert len(accepted) > 1
    assert all(each.start_s >= end_s for each, end_s in zip(accepted[1:], ends_s[:-1], strict=True))
    remembered = remembered_bias(accepted)
    assert remembered is not None
    assert 1 <= remembered.localizations <= len(accepted)
    assert remembered_bias([]) is None


def test_who_is_localized_once_has_no_second_localization(tmp_path: Path) -> None:
    write_track(tmp_path, Stand(), duration_s=2.2)
    with pytest.raises(ConfigError, match="nobody is localized twice"):
        printed(command, "evaluate", "localization", "--data", str(tmp_path), "--memory")
