"""The drift filter when the IMU's yaw jumps, and when two fixes share rays."""

import dataclasses
import math

import pytest

from pointit.schemas import NS_PER_S, UserPose
from pointit.services.localizer.drift.filter import DriftFilter
from pointit.services.localizer.tracking.pose_tracking import PoseTracker
from tests.unit.localizer.person import Person, yaw_difference
from tests.unit.localizer.test_drift_filter import (
    LAMPS,
    MINUTE_NS,
    PERSON,
    RATE_RADPS,
    calibrated,
    drifted,
    fix,
    point,
)

JUMP_RAD = math.radians(-51.0)
"""Jump of the IMU's yaw."""


def jumped(at_ns: int, jump_ns: int, rate_radps: float = math.radians(0.32)) -> Person:
    """The person with an IMU that drifts and jumps at `jump_ns`."""
    now = drifted(PERSON, at_ns, rate_radps)
    return dataclasses.replace(now, yaw_rad=now.yaw_rad + (JUMP_RAD if at_ns > jump_ns else 0.0))


@pytest.mark.parametrize("jump_ns", [MINUTE_NS // 2, 3 * MINUTE_NS // 2])
@pytest.mark.parametrize("by", ["anchors", "localizations"])
def test_jump_leaves_no_larger_error_than_anchoring_again(by: str, jump_ns: int) -> None:
    """A jump between two yaws looks like a rate; the third yaw contradicts that rate."""
    drift = DriftFilter(fix(PERSON, 0))
    for minute in (1, 2):
        at_ns = minute * MINUTE_NS
        now = jumped(at_ns, jump_ns)
        if by == "anchors":
            point(drift, now, LAMPS[minute], at_ns)
        else:
            drift.reset(fix(now, at_ns))
    pose = drift.predict(3 * MINUTE_NS)
    off_rad = abs(yaw_difference(pose.yaw_rad, jumped(3 * MINUTE_NS, jump_ns).yaw_rad))
    assert off_rad < math.radians(0.32 * 60.0 + 3.0)  # what the drift of a minute comes to
    assert off_rad < 2.0 * pose.yaw_sigma_rad
    # and the true drift is learnt from then on
    for minute in (3, 4):
        point(drift, jumped(minute * MINUTE_NS, jump_ns), LAMPS[minute % 3], minute * MINUTE_NS)
    pose = drift.predict(5 * MINUTE_NS)
    assert abs(yaw_difference(pose.yaw_rad, jumped(5 * MINUTE_NS, jump_ns).yaw_rad)) < math.radians(6.0)


def test_anchor_that_contradicts_the_rate_says_so() -> None:
    drift = DriftFilter(fix(PERSON, 0))
    assert point(drift, jumped(MINUTE_NS, 0), LAMPS[0], MINUTE_NS).note == ""
    result = point(drift, jumped(2 * MINUTE_NS, 0), LAMPS[1], 2 * MINUTE_NS)
    assert result.accepted
    assert "rate" in result.note


def test_confirmed_rate_outlives_a_turned_imu() -> None:
    drift = calibrated(PERSON)
    at_ns = 4 * MINUTE_NS
    turned = dataclasses.replace(drifted(PERSON, at_ns), yaw_rad=drifted(PERSON, at_ns).yaw_rad + 1.0)
    drift.reset(fix(turned, at_ns))
    assert drift.at(at_ns).yaw_rate_radps == pytest.approx(RATE_RADPS, abs=math.radians(0.03))


def test_anchors_in_quick_succession_confirm_no_rate() -> None:
    drift = DriftFilter(fix(PERSON, 0))
    for second in (60, 61, 62, 63):
        assert point(drift, jumped(second * NS_PER_S, 0), LAMPS[0], second * NS_PER_S).accepted
    assert point(drift, jumped(2 * MINUTE_NS, 0), LAMPS[1], 2 * MINUTE_NS).note != ""


def test_localizations_with_rays_in_common_do_not_add_up() -> None:
    """Windows of 10 s, 6 s apart: the second begins after the middle of the first, but before its end."""
    tracking = PoseTracker()
    sigma_rad = math.radians(4.19)
    for start_s in (0, 6):
        newest_ns = (start_s + 10) * NS_PER_S
        pose = UserPose(
            stamp_ns=newest_ns,
            position_m=(1.0, 2.0, 0.0),
            yaw_rad=0.5,
            covariance=(0.04, 0.0, 0.0, 0.0, 0.04, 0.0, 0.0, 0.0, sigma_rad**2),
            method="moving_target",
        )
        found = tracking.set_localized(pose, start_s * NS_PER_S, (start_s + 5) * NS_PER_S, newest_ns)
        assert math.sqrt(found.covariance[8]) >= sigma_rad


def test_anchor_that_was_taken_against_the_rate_is_dropped_when_the_next_one_contradicts_it() -> None:
    """One pointing beside, not a jump: the next anchor fits what was known before."""
    drift, spared = DriftFilter(fix(PERSON, 0)), DriftFilter(fix(PERSON, 0))
    for each in (drift, spared):
        assert point(each, drifted(PERSON, MINUTE_NS), LAMPS[1], MINUTE_NS).accepted
    at_ns = 2 * MINUTE_NS
    assert point(drift, drifted(PERSON, at_ns), LAMPS[2], at_ns, math.radians(32.0)).note != ""
    for each in (drift, spared):
        assert point(each, drifted(PERSON, 3 * MINUTE_NS), LAMPS[0], 3 * MINUTE_NS).accepted
    assert drift.at(4 * MINUTE_NS).yaw_rad == pytest.approx(spared.at(4 * MINUTE_NS).yaw_rad, abs=1e-3)
