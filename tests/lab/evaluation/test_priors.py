"""Rows with the memory of a person's other recordings, and with other people, as priors."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from pointit_lab.evaluation.localization.localization import OURS, localization_rows
from pointit_lab.evaluation.localization.priors import MEMORY, PEOPLE, known_rows, person_biases, prior_rows
from pointit_lab.evaluation.localization.trial import FollowRecording, Trial
from pointit_lab.evaluation.recordings.row import Row
from tests.unit.localizer.person import EYES_M, Person, pointings

RATE_HZ = 25.0


def recording(person: str, name: str, bias_deg: float, seed: int) -> FollowRecording:
    """12 s of following a robot on a circle of 0.6 m; the elevation errs for seconds at a time."""
    times_s = np.arange(300) / RATE_HZ
    angles = math.tau * times_s / 12.0
    way = [(2.5 + 0.6 * math.cos(a), 0.6 * math.sin(a), 0.9) for a in angles.tolist()]
    stands = Person(0.3, -0.2, 0.7, math.radians(bias_deg))
    rays = pointings(stands, way, each=1, rate_hz=RATE_HZ, noise_rad=math.radians(1.0), seed=seed)
    return FollowRecording(
        set="s",
        subject=person,
        pointings=rays,
        heads_m=np.tile([0.3, -0.2, EYES_M], (len(rays), 1)),
        eye_height_m=EYES_M,
        yaw_rad=0.7,
        name=name,
    )


def trials(*recordings: FollowRecording) -> Iterator[Trial]:
    for each in recordings:
        yield from each.trials((1, 2, 10))


def median_m(rows: list[Row], solver: str) -> float:
    (row,) = (
        row for row in rows if (row.solver, row.subject) == (solver, "a") and row.condition.startswith("1 s")
    )
    assert row.position_m is not None
    return row.position_m.median


def test_the_memory_of_another_recording_makes_short_windows_better() -> None:
    rows = known_rows(list(trials(recording("a", "1", 9.0, 0), recording("a", "2", 9.5, 1))))
    assert {row.condition for row in rows} == {"1 s, known", "2 s, known"}
    assert median_m(rows, MEMORY) < 0.7 * median_m(rows, "pointit")


def test_who_has_one_recording_is_not_remembered() -> None:
    assert known_rows(list(trials(recording("a", "1", 9.0, 0)))) == []


def test_the_prior_of_a_person_is_that_of_all_others() -> None:
    biases = {"a": 11.0, "b": 13.0, "c": 12.0, "d": 12.5}
    told = list(trials(*(recording(name, "1", bias, 0) for name, bias in biases.items())))
    found = person_biases(told)
    assert {name: math.degrees(found["s", name]) for name in biases} == pytest.approx(biases, abs=0.5)
    priors = prior_rows(told, baselines=True, tick=lambda _done: None)
    assert {row.solver for row in priors.rows} == {PEOPLE}
    alone = localization_rows(told, baselines=False, jobs=1, tick=lambda _done, _of: None)
    assert median_m(priors.rows, PEOPLE) < 0.8 * median_m(alone, OURS)
    assert "of the 4 here +12." in priors.remarks[-1]
    assert prior_rows(told, baselines=False, tick=lambda _done: None).rows == []
