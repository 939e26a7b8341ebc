"""`scenario_2 --localize --targets 3` in virtual time: people of unknown place, with a bias and drift.

Real services on a bus in memory; nobody tells them what the simulated person knows.
"""

import asyncio
import functools
import math
import statistics

import numpy as np
import pytest

from pointit.diagnosis.symptoms import UNSURE_M
from pointit.geometry.floor_sigma import position_sigma_m
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import UserPose
from pointit.schemas.topics import INTERACTION, POSE
from tests.integration.scenario.play import Found, Outcome, play, running

PERSON = ("user-sim.aim.elevation_bias_deg=10", "user-sim.wristband.yaw_drift_degpmin=15")
"""10 deg too high, and 0.25 deg/s: a person and a band as bad as they come."""


@functools.cache
def localized(seed: int, *settings: str) -> Outcome:
    return play(
        "scenario_2", Choices(seed=seed, localize=True, targets=3, settings=(*PERSON, *settings)), 40.0
    )


def first(outcome: Outcome) -> Found:
    return next(found for found in outcome.found if found.pose.method == "static_targets")


@pytest.mark.parametrize("seed", range(1, 6))
def test_person_at_an_unknown_place_is_located_and_leads_the_cursor(seed: int) -> None:
    outcome = localized(seed)
    holds = {news.target_index for news in outcome.progress if news.purpose == "pose"}
    assert holds == {0, 1, 2}
    assert "solved" in {news.phase for news in outcome.progress if news.purpose == "pose"}
    pose = first(outcome)
    assert pose.position_error_m < 1.0  # of one; how good they are is asserted of several, below
    assert pose.pose.elevation_bias_rad > 0.05
    assert outcome.states[:2] == ["idle", "localizing"]
    assert {cursor.surface_id for cursor in outcome.cursors if cursor.surface == "strip"} == {"0", "1"}


@pytest.mark.parametrize(("people", "honest"), [(5, 4), pytest.param(20, 18, marks=pytest.mark.long)])
def test_the_stated_uncertainty_is_honest_and_small(people: int, honest: int) -> None:
    poses = [first(localized(seed)) for seed in range(1, people + 1)]
    within = [pose.position_error_m <= 2.0 * position_sigma_m(pose.pose.covariance) for pose in poses]
    assert sum(within) >= honest
    errors_m = [pose.position_error_m for pose in poses]
    assert statistics.median(errors_m) <= 0.4
    assert (
        max(position_sigma_m(pose.pose.covariance) for pose in poses) <= 0.5
    )  # what is less certain is refused


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        ("user-sim.body.hand=left", "user-sim.body.neck_to_shoulder_m=0.15"),
        ("user-sim.body.footprint_to_neck_m=1.48", "user-sim.body.shoulder_to_wrist_m=0.52"),
        pytest.param(("user-sim.stance_shift_sd_m=0.05",), marks=pytest.mark.long),
        pytest.param(("user-sim.wristband.dropout_share=0.05",), marks=pytest.mark.long),
    ],
    ids=["left hand", "other body", "shifting feet", "lost samples"],
)
def test_small_errors_of_body_stance_and_radio_cost_little(settings: tuple[str, ...]) -> None:
    errors_m = [first(localized(seed, *settings)).position_error_m for seed in (1, 2, 3)]
    assert statistics.median(errors_m) <= 0.4


@pytest.mark.slow
def test_without_options_the_number_of_lamps_is_the_localizers_affair() -> None:
    outcome = play("scenario_2", Choices(seed=2, localize=True), 60.0)
    assert first(outcome).position_error_m < 0.5
    assert outcome.states[-1] in {"pointing", "localizing"}  # perhaps an anchor just now
    assert "pointing" in outcome.states


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


@pytest.mark.slow
def test_anchor_each_minute_holds_a_yaw_that_drifts_without_it() -> None:
    outcome = three_minutes(2, *EVERY_MINUTE)
    assert len(outcome.anchors) == 3
    assert final_error_deg(outcome) < 10.0  # of a single person; the median of twenty is asserted below
    alone = three_minutes(1, *STEADY)
    assert alone.anchors == []
    assert final_error_deg(alone) > 30.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "most_deg"),
    [pytest.param(STEADY, 3.0, id="steady"), pytest.param((), BOUND_DEG, id="as measured")],
)
def test_so_it_is_for_most_people(kind: tuple[str, ...], most_deg: float) -> None:
    errors_deg = [final_error_deg(three_minutes(seed, *kind, *EVERY_MINUTE)) for seed in range(1, 21)]
    assert statistics.median(errors_deg) <= most_deg, np.round(sorted(errors_deg), 1)


@pytest.mark.slow
def test_person_who_notices_a_wrong_cursor_corrects_it() -> None:
    """The realistic person of `--localize`, who counts no minutes."""
    outcome = three_minutes(1, *STEADY, "user-sim.anchor_when_off_deg=10")
    assert 2 <= len(outcome.anchors) <= 12
    assert final_error_deg(outcome) < 15.0
    assert {cursor.surface_id for cursor in outcome.cursors[-500:] if cursor.surface == "strip"}


USERS = ("user1", "user2")


async def _localize(seed: int, duration_s: float) -> tuple[dict[str, list[str]], dict[str, UserPose]]:
    plan = read_scenario("scenario_3")
    choices = Choices(seed=seed, localize=True)
    launches = list(site_launches(plan, choices))
    for index, user in enumerate(USERS):
        launches += user_launches(plan, choices, user, index)
    bus = MemoryBus(LocalBroker())
    states: dict[str, list[str]] = {user: [] for user in USERS}
    poses: dict[str, UserPose] = {}
    bus.subscribe(INTERACTION, lambda now, user: states[user].append(now.state))
    bus.subscribe(POSE, lambda pose, user: poses.update({user: pose}))
    async with running(launches, bus, VirtualClock()) as services:
        await asyncio.wait({services}, timeout=duration_s)
    return states, poses


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.long)])
@pytest.mark.slow
def test_both_are_localized_one_after_the_other_and_point(seed: int) -> None:
    plan = read_scenario("scenario_3")
    states, poses = run_virtually(_localize(seed, 60.0))
    for index, user in enumerate(USERS):
        assert states[user][-1] == "pointing", states
        place = plan.places[index % len(plan.places)]
        sigma_m = position_sigma_m(poses[user].covariance)
        assert sigma_m <= UNSURE_M
        assert math.dist(poses[user].position_m[:2], place.position_m[:2]) <= 3.0 * sigma_m
