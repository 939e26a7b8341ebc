"""The drift filter for any input, when the IMU's yaw or the clock jumps, and when two fixes share rays."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.schemas import NS_PER_S, UserPose
from pointit.services.localizer.drift.filter import DriftFilter, DriftPose, Fix
from pointit.services.localizer.tracking import PoseTracker
from tests.unit.localizer.person import EYES_M, Person, angles, yaw_difference
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
from tests.unit.localizer.test_drift_filter import LAMPS as PLACES

EYES = (0.0, 0.0, EYES_M)
metres = st.floats(-20.0, 20.0)
places = st.tuples(metres, metres, st.floats(0.0, 3.0))
times = st.integers(0, 2**62) | st.integers(0, 600 * NS_PER_S)
sigmas = st.floats(0.0, 100.0)
Step = tuple[Any, ...]
steps: st.SearchStrategy[Step] = st.one_of(
    st.tuples(st.just("anchor"), times, places, angles, st.floats(-1.5, 1.5), st.floats(0.0, 1.0)),
    st.tuples(st.just("heading"), times, angles, angles, sigmas),
    st.tuples(st.just("still"), times, st.floats(-1.0, 1.0), sigmas, st.booleans()),
    st.tuples(st.just("predict"), times),
    st.tuples(st.just("reset"), times, metres, metres, angles, sigmas),
    st.tuples(st.just("lose"), times, st.booleans()),
)


def some_fix(x: float, y: float, yaw: float, sigma: float, stamp_ns: int) -> Fix:
    half = np.array([[sigma, 0.0, 0.0], [0.5, 0.2, 0.0], [0.1, sigma, 0.05]])
    return Fix(x_m=x, y_m=y, yaw_rad=yaw, covariance=half @ half.T, stamp_ns=stamp_ns)


def apply(drift: DriftFilter, step: Step) -> None:
    match step:
        case ("anchor", stamp_ns, target, azimuth, elevation, spread):
            ray = vector.direction(azimuth, elevation)
            drift.update_anchor(stamp_ns, target, EYES, ray, spread_rad=spread)
        case ("heading", stamp_ns, wall, azimuth, sigma):
            drift.update_heading(stamp_ns, wall, vector.direction(azimuth, 0.0), sigma)
        case ("still", stamp_ns, rate, sigma, raised):
            drift.update_rest_rate(stamp_ns, rate, sigma, is_raised=raised)
        case ("predict", stamp_ns):
            drift.predict(stamp_ns)
        case ("reset", stamp_ns, x, y, yaw, sigma):
            drift.reset(some_fix(x, y, yaw, sigma, stamp_ns))
        case ("lose", stamp_ns, restarted):
            drift.reset_yaw(stamp_ns, is_restarted=restarted)
        case _:
            raise AssertionError(step)


def check(pose: DriftPose, whole: NDArray[np.float64]) -> None:
    values = (pose.x_m, pose.y_m, pose.yaw_rad, pose.yaw_rate_radps, pose.yaw_rate_sigma_radps)
    assert all(map(math.isfinite, values))
    assert np.all(np.isfinite(whole))
    assert np.array_equal(whole, whole.T)
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-12))
    assert np.all(np.diag(whole) >= 0.0)
    assert np.linalg.eigvalsh(whole / np.outer(scale, scale))[0] >= -1e-6
    assert pose.yaw_sigma_rad <= math.pi + 1e-9
    assert abs(pose.yaw_rad) <= math.pi


@settings(max_examples=150)
@example([("predict", 76830445), ("heading", 0, 0.0, 0.0, 4.9e-55), ("reset", 0, 0.0, 0.0, 0.0, 6.0)], 0.0)
@example([("heading", 0, 0.0, 0.0, 1e-200)] * 3, 0.0)
@given(st.lists(steps, max_size=12), sigmas)
def test_whatever_happens_the_covariance_stays_one(happened: list[Step], sigma: float) -> None:
    drift = DriftFilter(some_fix(0.0, 0.0, 0.0, sigma, 0))
    for step in happened:
        apply(drift, step)
        check(drift.at(0), drift._state.moments()[1])
    check(drift.at(2**62), drift._state.moments()[1])


@given(st.lists(st.floats(20.0, 120.0), min_size=1, max_size=6), st.floats(-0.4, 0.4), st.integers(0, 999))
def test_the_yaw_gets_surer_by_an_anchor_and_less_sure_in_between(
    pauses: list[float], rate_degps: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    spread = np.diag([0.1, 0.1, math.radians(3.0)]) ** 2
    drift = DriftFilter(Fix(x_m=0.0, y_m=0.0, yaw_rad=0.0, covariance=spread, stamp_ns=0))
    at_s = 0.0
    for pause in pauses:
        last = drift.at(round(at_s * NS_PER_S)).yaw_sigma_rad
        for part in (0.2, 0.5, 1.0):
            now = drift.predict(round((at_s + part * pause) * NS_PER_S)).yaw_sigma_rad
            assert now > last
            last = now
        at_s += pause
        around, yaw = rng.uniform(-math.pi, math.pi), math.radians(rate_degps) * at_s
        target = (3.0 * math.cos(around), 3.0 * math.sin(around), 0.5)
        ray = vector.direction(around - yaw, math.atan2(0.5 - EYES_M, 3.0))
        assert drift.update_anchor(round(at_s * NS_PER_S), target, EYES, ray).accepted
        assert drift.at(round(at_s * NS_PER_S)).yaw_sigma_rad < last


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


S = 1_000_000_000


def test_every_entry_of_the_filter_follows() -> None:
    now_ns = 20 * S
    late = now_ns - S
    direction = PERSON.direction(PLACES[0])

    def filters() -> DriftFilter:
        return calibrated(PERSON)

    drift = filters()
    refused = point(drift, drifted(PERSON, 3 * MINUTE_NS), PLACES[0], late)
    assert "old" in refused.reason
    drift.set_time(now_ns)
    assert point(drift, drifted(PERSON, 3 * MINUTE_NS), PLACES[0], late).accepted
    drift = filters()
    origin = (0.0, 0.0, 1.64)
    taken = drift.update_anchor(late, PLACES[0], origin, direction, now_ns=now_ns)
    assert "old" not in taken.reason
    assert filters().update_heading(late, 0.0, (1.0, 0.0, 0.0), now_ns=now_ns).accepted
    assert not filters().update_heading(late, 0.0, (1.0, 0.0, 0.0)).accepted
    assert filters().update_rest_rate(late, RATE_RADPS, 0.01, now_ns=now_ns).accepted
    assert not filters().update_rest_rate(late, RATE_RADPS, 0.01).accepted
    drift = filters()
    drift.reset_yaw(now_ns, is_restarted=False)
    assert drift.at(now_ns).stamp_ns == now_ns
