"""Windows of a recording: gaps of any length are stepped over, and nothing else is."""

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.localization.trial import SLACK_S, STRIDE_S, WINDOWS_S, FollowRecording, Reading


def following(stamps_s: list[float]) -> FollowRecording:
    ones = np.ones((len(stamps_s), 3))
    return FollowRecording(
        set="s",
        subject="a",
        pointings=Pointings(np.array(stamps_s), ones, ones, ones),
        heads_m=np.cumsum(ones, axis=0),
        eye_height_m=1.6,
        yaw_rad=None,
    )


@given(st.lists(st.floats(0.0, 60.0), min_size=1, max_size=60))
def test_no_window_is_lost(times: list[float]) -> None:
    stamps_s = sorted(times)
    stamps_s[0] = 0.0
    found = [(trial.condition, trial.pointings.stamps_s.tolist()) for trial in following(stamps_s).trials()]
    wanted: list[tuple[str, list[float]]] = []
    for length_s in WINDOWS_S:
        start_s = 0.0
        while start_s < stamps_s[-1] - length_s + SLACK_S + 1e-9:
            inside = [t for t in stamps_s if start_s <= t < start_s + length_s]
            if len(inside) > 1:
                wanted.append((f"{length_s} s", inside))
            start_s += STRIDE_S
    assert found == wanted


def test_a_gap_of_years_takes_no_time() -> None:
    trials = list(following([0.0, 0.5, 0.9, 1e9, 1e9 + 0.5, 1e9 + 1.1]).trials([1]))
    assert [trial.pointings.stamps_s[0] for trial in trials] == [0.0, 1e9]


def test_who_was_too_short_is_noted() -> None:
    reading = Reading()
    reading.follow(Path("short.csv"), following([0.0, 0.3, 0.6]))
    assert reading.trials == []
    assert reading.notes == [
        "short.csv is skipped: its 3 different samples within 0.6 s fill no window of 1 s"
    ]
