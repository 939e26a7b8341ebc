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
def test_jump_leaves_hardly_a_larger_error_than_anchoring_again(by: str, jump_ns: int) -> None:
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
    stray_rad = 0.25 * abs(JUMP_RAD) if by == "anchors" else 0.0  # an anchor may have been at another lamp
    assert off_rad < math.radians(0.32 * 60.0 + 3.0) + stray_rad  # what the drift of a minute comes to
    assert off_rad < 2.0 * pose.yaw_sigma_rad
    # and the true drift is learnt from then on
    for minute in (3, 4):
        point(drift, jumped(minute * MINUTE_NS, jump_ns), LAMPS[minute % 3], minute * MINUTE_NS)
    pose = drift.predict(5 * MINUTE_NS)
    assert abs(yaw_difference(pose.yaw_rad, jumped(5 * MINUTE_NS, jump_ns).yaw_rad)) < math.radians(6.0)


def test_confirmed_rate_outlives_a_turned_imu() -> None:
    drift = calibrated(PERSON)
    at_ns = 4 * MINUTE_NS
    turned = dataclasses.replace(drifted(PERSON, at_ns), yaw_rad=drifted(PERSON, at_ns).yaw_rad + 1.0)
    drift.reset(fix(turned, at_ns))
    assert drift.at(at_ns).yaw_rate_radps == pytest.approx(RATE_RADPS, abs=math.radians(0.03))


def test_contradicted_rate_is_doubted_at_once_and_forgotten_after_the_next_anchor() -> None:
    """The jump before the first anchor looked like a rate of -31 degrees a minute."""
    drift = DriftFilter(fix(PERSON, 0))
    point(drift, jumped(MINUTE_NS, 0), LAMPS[0], MINUTE_NS)
    learnt = drift.at(MINUTE_NS)
    assert learnt.yaw_rate_radps < -math.radians(0.3)
    point(drift, jumped(2 * MINUTE_NS, 0), LAMPS[1], 2 * MINUTE_NS)
    assert drift.at(2 * MINUTE_NS).yaw_rate_sigma_radps > learnt.yaw_rate_sigma_radps
    point(drift, jumped(3 * MINUTE_NS, 0), LAMPS[2], 3 * MINUTE_NS)
    assert drift.at(3 * MINUTE_NS).yaw_rate_radps == pytest.approx(math.radians(0.32), abs=math.radians(0.08))


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


def test_one_pointing_beside_is_forgotten_after_two_more_anchors() -> None:
    drift, spared = DriftFilter(fix(PERSON, 0)), DriftFilter(fix(PERSON, 0))
    for each in (drift, spared):
        assert point(each, drifted(PERSON, MINUTE_NS), LAMPS[1], MINUTE_NS).accepted
    point(drift, drifted(PERSON, 2 * MINUTE_NS), LAMPS[2], 2 * MINUTE_NS, math.radians(32.0))
    for minute in (3, 4):
        for each in (drift, spared):
            point(each, drifted(PERSON, minute * MINUTE_NS), LAMPS[minute % 3], minute * MINUTE_NS)
    have, want = drift.at(5 * MINUTE_NS), spared.at(5 * MINUTE_NS)
    assert abs(yaw_difference(have.yaw_rad, want.yaw_rad)) < math.radians(5.0)
    assert abs(yaw_difference(have.yaw_rad, want.yaw_rad)) < have.yaw_sigma_rad
