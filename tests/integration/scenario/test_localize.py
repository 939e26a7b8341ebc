"""`scenario_2 --localize --targets 3` in virtual time: people of unknown place, with a bias and drift.

Real services on a bus in memory; nobody tells them what the simulated person knows.
"""

import functools
import statistics

import pytest

from pointit.launch.plan.launches import Choices
from pointit.services.localizer.certainty import position_sigma_m
from tests.integration.scenario.play import Found, Outcome, play

PERSON = ("user-sim.aim.elevation_bias_deg=10", "user-sim.wristband.yaw_drift_degpmin=15")
"""10 deg too high, and 0.25 deg/s: a person and a band as bad as they come."""


@functools.cache
def localized(seed: int, *settings: str) -> Outcome:
    return play(
        "scenario_2", Choices(seed=seed, localize=True, targets=3, settings=(*PERSON, *settings)), 40.0
    )


def first(outcome: Outcome) -> Found:
    """Return the pose that the localization found."""
    return next(found for found in outcome.found if found.pose.method == "static_targets")


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_person_of_unknown_place_is_found_and_leads_the_cursor_over_the_strips(seed: int) -> None:
    outcome = localized(seed)
    holds = {news.target_index for news in outcome.progress if news.purpose == "pose"}
    assert holds == {0, 1, 2}
    assert "solved" in {news.phase for news in outcome.progress if news.purpose == "pose"}
    pose = first(outcome)
    assert pose.position_error_m < 1.0  # of one; how good they are is asserted of several, below
    assert pose.pose.elevation_bias_rad > 0.05
    assert outcome.states[:2] == ["idle", "localizing"]
    assert {cursor.surface_id for cursor in outcome.cursors if cursor.surface == "strip"} == {"0", "1"}


@pytest.mark.parametrize(
    ("people", "honest"), [(5, 4), pytest.param(20, 18, marks=[pytest.mark.long, pytest.mark.timeout(300)])]
)
def test_the_stated_uncertainty_is_honest_and_small(people: int, honest: int) -> None:
    poses = [first(localized(seed)) for seed in range(1, people + 1)]
    within = [pose.position_error_m <= 2.0 * position_sigma_m(pose.pose) for pose in poses]
    assert sum(within) >= honest
    errors_m = [pose.position_error_m for pose in poses]
    assert statistics.median(errors_m) <= 0.4
    assert max(position_sigma_m(pose.pose) for pose in poses) <= 0.5  # what is less certain is refused


@pytest.mark.parametrize(
    "settings",
    [
        ("user-sim.body.hand=left", "user-sim.body.neck_to_shoulder_m=0.15"),
        ("user-sim.body.footprint_to_neck_m=1.48", "user-sim.body.shoulder_to_wrist_m=0.52"),
        ("user-sim.stance_shift_sd_m=0.05",),
        ("user-sim.wristband.dropout_share=0.05",),
    ],
    ids=["left hand", "other body", "shifting feet", "lost samples"],
)
def test_small_errors_of_body_stance_and_radio_cost_little(settings: tuple[str, ...]) -> None:
    errors_m = [first(localized(seed, *settings)).position_error_m for seed in (1, 2, 3)]
    assert statistics.median(errors_m) <= 0.4


def test_without_options_the_number_of_lamps_is_the_localizers_affair() -> None:
    outcome = play("scenario_2", Choices(seed=2, localize=True), 60.0)
    assert first(outcome).position_error_m < 0.5
    assert outcome.states[-1] in {"pointing", "localizing"}  # perhaps an anchor just now
    assert "pointing" in outcome.states


def test_the_summary_of_a_run_knows_where_people_were_found() -> None:
    outcome = localized(2)
    assert outcome.monitor is not None
    assert outcome.monitor.found["anna"].method == "static_targets"
