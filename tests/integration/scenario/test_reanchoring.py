"""Three minutes with an IMU that drifts by 15 deg a minute: pointing at a lamp each minute holds the yaw.

Measured at the end, as the recorded people's drift is: half a minute after the last anchor at most. What an
anchor tells is as good as one pointing without a cursor, so both kinds of people are looked at.
"""

import statistics

import numpy as np
import pytest

from pointit.launch.plan.launches import Choices
from tests.integration.scenario.play import Outcome, play

DURATION_S = 210.0
LAST_S = 20.0
DRIFTING = (
    "user-sim.aim.elevation_bias_deg=10",
    "user-sim.wristband.yaw_drift_degpmin=15",
    "user-sim.anchor_when_off_deg=0",
    "user-sim.rate_hz=25",
)
STEADY = ("user-sim.aim.azimuth_error_reach_sd_deg=2", "user-sim.aim.bent_arm_share=0")
"""Somebody who points within 2 deg sideways from one time to the next; as measured, people's is 4 to 6."""
BOUND_DEG = 6.0
"""Limit of the median yaw error of people as measured. The line through four yaws with an error of 5 deg each
has a sigma of 4.7 deg 20 s after the last: no filter has a median below 3.2 deg, and 20 people scatter."""
EVERY_MINUTE = ("user-sim.anchor_every_s=60",)


def three_minutes(seed: int, *settings: str) -> Outcome:
    choices = Choices(seed=seed, localize=True, targets=3, settings=(*DRIFTING, *settings))
    return play("scenario_2", choices, DURATION_S)


def final_error_deg(outcome: Outcome) -> float:
    """Return the median yaw error over the last seconds."""
    errors = [found.yaw_error_deg for found in outcome.followed if found.at_s > DURATION_S - LAST_S]
    return float(np.median(errors))


@pytest.mark.timeout(300)  # 10 s on a quiet machine
def test_an_anchor_each_minute_holds_the_yaw_and_without_it_drifts_away() -> None:
    for seed, kind in ((1, STEADY), (2, ())):
        outcome = three_minutes(seed, *kind, *EVERY_MINUTE)
        assert len(outcome.anchors) == 3
        assert final_error_deg(outcome) < 10.0  # of single people; the median of twenty is asserted below
    alone = three_minutes(1, *STEADY)
    assert alone.anchors == []
    assert final_error_deg(alone) > 30.0


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("kind", "most_deg"),
    [pytest.param(STEADY, 3.0, id="steady"), pytest.param((), BOUND_DEG, id="as measured")],
)
def test_so_it_is_for_most_people(kind: tuple[str, ...], most_deg: float) -> None:
    errors_deg = [final_error_deg(three_minutes(seed, *kind, *EVERY_MINUTE)) for seed in range(1, 21)]
    assert statistics.median(errors_deg) <= most_deg, np.round(sorted(errors_deg), 1)


def test_who_notices_that_the_cursor_is_off_sets_it_right_by_themselves() -> None:
    """The realistic person of `--localize`, who counts no minutes."""
    outcome = three_minutes(1, *STEADY, "user-sim.anchor_when_off_deg=10")
    assert 2 <= len(outcome.anchors) <= 12
    assert final_error_deg(outcome) < 15.0
    assert {cursor.surface_id for cursor in outcome.cursors[-500:] if cursor.surface == "strip"}
