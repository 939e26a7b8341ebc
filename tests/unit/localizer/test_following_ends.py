"""Following a robot ends when pointing begins: localizer and supervisor together, in virtual time."""

import numpy as np
import pytest

from pointit.services.localizer.config import LocalizerConfig
from tests.unit.localizer.follower import START_NS, follow

LATE_S = {"prompt": (0.3, 0.8), "late": (1.0, 2.5)}
"""When the arm begins to rise after the press, which is after rays count for late ones."""

FOUND_S = {"prompt": 7.0, "late": 11.0}
"""Median time until they may point: rays come at 5 Hz and 20 of them are needed, after the reaction."""


@pytest.mark.parametrize("who", LATE_S)
def test_poses_of_people_who_turn_away_when_they_may_point(who: str) -> None:
    """Were the pose not settled when pointing begins, every third would end more than 1 m off."""
    config = LocalizerConfig(method="moving_target")
    courses = [follow(seed, config, late_s=LATE_S[who], duration_s=14.0) for seed in range(25)]
    assert {len(course.poses) for course in courses} == {1}
    assert {course.states[-1] for course in courses} == {"pointing"}
    for course in courses:
        (pose,) = course.poses
        assert pose.stamp_ns <= START_NS + course.pointing_s * 1e9  # no ray after that is in it
        assert [news.phase for news in course.told].count("solved") == 1
    errors_m = np.array([course.error_m for course in courses])
    sigmas_m = np.array([course.sigma_m for course in courses])
    assert np.max(errors_m) < 1.0
    assert np.median(errors_m) < 0.25
    assert np.mean(errors_m <= 2.0 * sigmas_m) >= 0.95
    assert np.median([course.pointing_s for course in courses]) < FOUND_S[who]


def test_poses_that_are_followed_on_while_people_point_elsewhere() -> None:
    """Asked for explicitly (`autostart`), it goes on, but takes no pose that contradicts the surest one.

    Otherwise half of them would end more than 1 m off.
    """
    config = LocalizerConfig(method="moving_target", autostart=True)
    courses = [follow(seed, config, late_s=LATE_S["prompt"], duration_s=30.0) for seed in range(8)]
    assert {course.states[-1] for course in courses} == {"pointing"}
    reasons = [news.reason for course in courses for news in course.told]
    assert any("contradict the pose" in reason or "rays miss" in reason for reason in reasons)
    errors_m = np.array([course.error_m for course in courses])
    sigmas_m = np.array([course.sigma_m for course in courses])
    assert np.max(errors_m) < 1.0
    assert np.mean(errors_m <= 2.0 * sigmas_m) >= 0.95
