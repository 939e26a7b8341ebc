"""The drift filter: anchors, headings, rests, fixes, jumps, and any input."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, UserPose
from pointit.services.localizer.drift.filter import AnchorResult, DriftFilter, DriftPose, DriftSettings, Fix
from pointit.services.localizer.tracking import PoseTracker
from tests.unit.localizer.person import EYES_M, Person, angles, yaw_difference

MINUTE_NS = 60 * NS_PER_S
LAMPS: tuple[Vec3, ...] = ((3.0, 0.5, 0.2), (-1.0, 2.5, 0.8), (0.5, -3.0, 0.0))
RATE_RADPS = math.radians(0.4)
START_SIGMAS = np.array([0.05, 0.05, math.radians(2.0)])


def fix(person: Person, stamp_ns: int, sigmas: NDArray[np.float64] = START_SIGMAS) -> Fix:
    covariance = np.diag(sigmas**2)
    return Fix(x_m=person.x, y_m=person.y, yaw_rad=person.yaw_rad, covariance=covariance, stamp_ns=stamp_ns)


def drifted(person: Person, stamp_ns: int, rate_radps: float = RATE_RADPS) -> Person:
    yaw_rad = person.yaw_rad + rate_radps * stamp_ns / NS_PER_S
    return Person(person.x, person.y, yaw_rad, person.bias_rad)


def point(
    drift: DriftFilter, person: Person, lamp: Vec3, stamp_ns: int, beside_rad: float = 0.0
) -> AnchorResult:
    direction = vector.rotate_z(person.direction(lamp), beside_rad)
    return drift.update_anchor(
        stamp_ns,
        lamp,
        (0.0, 0.0, EYES_M),
        direction,
        elevation_bias_rad=person.bias_rad,
        spread_rad=math.radians(0.3),
    )


def calibrated(person: Person, minutes: int = 3) -> DriftFilter:
    """Return a filter that has had an anchor each minute, while the yaw drifted."""
    drift = DriftFilter(fix(person, 0))
    for minute in range(1, minutes + 1):
        at_ns = minute * MINUTE_NS
        assert point(drift, drifted(person, at_ns), LAMPS[minute % 3], at_ns).accepted
    return drift


PERSON = Person(0.4, -0.3, 2.0, math.radians(6.0))


def test_one_anchor_a_minute_determines_an_exact_persons_drift() -> None:
    drift = calibrated(PERSON)
    pose = drift.predict(4 * MINUTE_NS)
    truth = drifted(PERSON, 4 * MINUTE_NS)
    assert abs(yaw_difference(pose.yaw_rad, truth.yaw_rad)) < math.radians(1.0)
    assert pose.yaw_rate_radps == pytest.approx(RATE_RADPS, abs=math.radians(0.03))
    assert pose.yaw_rate_sigma_radps < 0.5 * DriftSettings().rate_sigma_radps
    assert pose.anchored_ns == 3 * MINUTE_NS
    assert math.hypot(pose.x_m - PERSON.x, pose.y_m - PERSON.y) < 0.05


def test_outlier_is_rejected_named_and_forgotten_after_the_next_anchor() -> None:
    drift = calibrated(PERSON)
    spared = calibrated(PERSON)
    at_ns = 4 * MINUTE_NS
    beside = point(drift, drifted(PERSON, at_ns), LAMPS[0], at_ns, math.radians(36.0))
    assert not beside.accepted
    assert math.degrees(beside.azimuth_error_rad) == pytest.approx(-36.0, abs=2.0)
    assert "36° to the right" in beside.reason
    assert "point at that target again" in beside.reason

    truth = drifted(PERSON, at_ns)
    doubted = drift.at(at_ns)
    assert abs(yaw_difference(doubted.yaw_rad, truth.yaw_rad)) < 2.0 * doubted.yaw_sigma_rad
    assert doubted.anchored_ns == 3 * MINUTE_NS
    for each in (drift, spared):
        assert point(each, truth, LAMPS[0], at_ns + NS_PER_S).accepted

    have = drift.at(at_ns + NS_PER_S)
    want = spared.at(at_ns + NS_PER_S)
    assert have.yaw_rad == pytest.approx(want.yaw_rad, abs=math.radians(1.0))
    assert have.yaw_rate_radps == pytest.approx(want.yaw_rate_radps, abs=math.radians(0.02))


def test_a_pointing_far_too_high_is_rejected() -> None:
    drift = calibrated(PERSON)
    at_ns = 4 * MINUTE_NS
    now = drifted(PERSON, at_ns)
    high = Person(now.x, now.y, now.yaw_rad, now.bias_rad + math.radians(25.0))
    direction = high.direction(LAMPS[0])
    result = drift.update_anchor(
        at_ns, LAMPS[0], (0.0, 0.0, EYES_M), direction, elevation_bias_rad=PERSON.bias_rad
    )
    assert not result.accepted
    assert "25° below the ray" in result.reason


def test_a_turned_imu_is_believed_the_second_time() -> None:
    drift = calibrated(PERSON)
    turned = Person(PERSON.x, PERSON.y, PERSON.yaw_rad + math.radians(40.0), PERSON.bias_rad)
    assert not point(drift, drifted(turned, 4 * MINUTE_NS), LAMPS[0], 4 * MINUTE_NS).accepted
    second_ns = 4 * MINUTE_NS + 10 * NS_PER_S
    believed = point(drift, drifted(turned, second_ns), LAMPS[1], second_ns)
    assert believed.accepted
    assert believed.reason == ""
    pose = drift.at(second_ns)
    error = abs(yaw_difference(pose.yaw_rad, drifted(turned, second_ns).yaw_rad))
    assert error < math.radians(2.0)
    assert error < 3 * pose.yaw_sigma_rad
    assert pose.anchored_ns == second_ns


def test_anchors_that_contradict_each_other_end_in_a_doubt() -> None:
    drift = calibrated(PERSON)
    sure = drift.predict(4 * MINUTE_NS)
    results = [
        point(drift, drifted(PERSON, at_ns), LAMPS[i], at_ns, math.radians(beside))
        for i, beside in enumerate((40.0, -40.0, 120.0))
        for at_ns in (4 * MINUTE_NS + i * NS_PER_S,)
    ]
    assert not any(result.accepted for result in results)
    assert drift.at(5 * MINUTE_NS).yaw_sigma_rad > 2 * sure.yaw_sigma_rad
    assert drift.at(5 * MINUTE_NS).position_sigma_m > 2 * sure.position_sigma_m


def test_a_person_who_walked_keeps_yaw_and_rate() -> None:
    drift = calibrated(PERSON)
    at_ns = 5 * MINUTE_NS
    before = drift.predict(at_ns)
    walked = drifted(Person(8.0, 5.0, PERSON.yaw_rad), at_ns)
    drift.reset(fix(walked, at_ns, np.array([0.2, 0.2, math.radians(5.0)])))
    pose = drift.at(at_ns)
    assert pose.x_m == pytest.approx(8.0)
    assert pose.yaw_sigma_rad < before.yaw_sigma_rad
    assert pose.yaw_rate_radps == pytest.approx(RATE_RADPS, abs=math.radians(0.03))
    assert pose.yaw_rate_sigma_radps <= before.yaw_rate_sigma_radps
    assert pose.covariance[0, 0] == pytest.approx(0.2**2)


@pytest.mark.parametrize("restarted", [False, True])
def test_yaw_origin_change_keeps_position_and_first_anchor_restores_yaw(*, restarted: bool) -> None:
    drift = calibrated(PERSON)
    at_ns = 4 * MINUTE_NS
    before = drift.predict(at_ns)
    drift.reset_yaw(at_ns, is_restarted=restarted)
    pose = drift.at(at_ns)
    assert pose.yaw_sigma_rad >= math.pi / 2
    assert (pose.x_m, pose.y_m) == (before.x_m, before.y_m)
    assert np.array_equal(pose.covariance[:2, :2], before.covariance[:2, :2])
    if restarted:
        assert pose.yaw_rate_radps == 0.0
        assert pose.yaw_rate_sigma_radps == pytest.approx(DriftSettings().rate_sigma_radps)
    else:
        assert pose.yaw_rate_radps == before.yaw_rate_radps
        assert pose.yaw_rate_sigma_radps == pytest.approx(before.yaw_rate_sigma_radps)

    turned = Person(PERSON.x, PERSON.y, drifted(PERSON, at_ns).yaw_rad + 2.5, PERSON.bias_rad)
    assert point(drift, turned, LAMPS[0], at_ns + NS_PER_S).accepted
    told = drift.at(at_ns + NS_PER_S)
    assert abs(yaw_difference(told.yaw_rad, turned.yaw_rad)) < math.radians(2.0)
    assert told.yaw_sigma_rad < math.radians(12.0)  # that one pointing may have been at another lamp


@pytest.mark.parametrize("late_s", [5.0, 20.0])
def test_a_late_localization_counts_as_one_in_time(late_s: float) -> None:
    """The drift since makes it less certain now, but it still measures the rate."""
    at_ns = 2 * MINUTE_NS
    now_ns = 2 * MINUTE_NS + round(late_s * NS_PER_S)
    new = fix(drifted(PERSON, at_ns), at_ns, np.array([0.2, 0.2, math.radians(4.0)]))
    timely, late = (DriftFilter(fix(PERSON, 0)) for _ in range(2))
    timely.reset(new)
    want = timely.predict(now_ns)
    late.predict(now_ns)
    late.reset(new)
    have = late.at(now_ns)

    assert have.yaw_rad == pytest.approx(want.yaw_rad, abs=math.radians(0.2))
    assert have.yaw_sigma_rad == pytest.approx(
        want.yaw_sigma_rad, rel=0.05
    )  # cases that are joined differ by 3 %
    assert have.yaw_rate_radps == pytest.approx(want.yaw_rate_radps, rel=0.02)
    assert have.yaw_rate_sigma_radps == pytest.approx(want.yaw_rate_sigma_radps, rel=0.05)
    assert have.position_sigma_m == pytest.approx(want.position_sigma_m, rel=0.01)

    # a minute on, both have become as uncertain: the rate and the yaw hang together in both
    later_ns = now_ns + MINUTE_NS
    assert late.at(later_ns).yaw_sigma_rad == pytest.approx(timely.at(later_ns).yaw_sigma_rad, rel=0.05)


def test_facing_a_wall_sets_the_yaw_beyond_the_gate() -> None:
    drift = calibrated(PERSON)
    at_ns = 4 * MINUTE_NS
    turned = Person(PERSON.x, PERSON.y, drifted(PERSON, at_ns).yaw_rad + 1.5)
    level = vector.direction(0.7 - turned.yaw_rad, 0.1)
    result = drift.update_heading(at_ns, 0.7, level)
    assert result.accepted
    assert "was replaced" in result.note
    assert abs(yaw_difference(drift.at(at_ns).yaw_rad, turned.yaw_rad)) < math.radians(1.0)
    assert math.hypot(drift.at(at_ns).x_m - PERSON.x, drift.at(at_ns).y_m - PERSON.y) < 0.05
    gentle = drift.update_heading(at_ns + NS_PER_S, 0.7, level)
    assert gentle.note == ""
    assert not drift.update_heading(at_ns, 0.7, vector.direction(0.0, -1.5)).accepted


def test_resting_arm_determines_the_rate_unlike_a_moving_one() -> None:
    drift = DriftFilter(fix(PERSON, 0))
    assert drift.update_rest_rate(20 * NS_PER_S, RATE_RADPS, math.radians(0.04)).accepted
    pose = drift.predict(3 * MINUTE_NS)
    error = yaw_difference(pose.yaw_rad, drifted(PERSON, 3 * MINUTE_NS).yaw_rad)
    assert abs(error) < math.radians(8.0)  # of 72°: the first 20 s went by unknown
    refused = drift.update_rest_rate(3 * MINUTE_NS, RATE_RADPS + math.radians(0.5), math.radians(0.04))
    assert not refused.accepted
    assert "rest it" in refused.reason


def test_raised_arm_cannot_make_the_rate_surer_than_people_creep() -> None:
    held = DriftFilter(fix(PERSON, 0))
    hanging = DriftFilter(fix(PERSON, 0))
    for second in range(1, 60):
        for drift in (held, hanging):
            assert drift.update_rest_rate(
                second * NS_PER_S, RATE_RADPS, math.radians(0.05), is_raised=drift is held
            ).accepted
    creep_radps = DriftSettings().creep_sigma_radps
    assert held.at(60 * NS_PER_S).yaw_rate_sigma_radps > 0.5 * creep_radps
    assert hanging.at(60 * NS_PER_S).yaw_rate_sigma_radps < 0.2 * creep_radps


def test_raised_rests_measure_the_rate_when_anchors_show_the_creep() -> None:
    """Anchors give the rate, so that rests show the creep; later rests show that the rate has changed."""
    creep = math.radians(0.3)
    drift = calibrated(PERSON)
    for second in range(10):
        at_ns = 3 * MINUTE_NS + second * NS_PER_S
        drift.update_rest_rate(at_ns, RATE_RADPS + creep, math.radians(0.05), is_raised=True)
    assert drift.at(3 * MINUTE_NS).yaw_rate_radps == pytest.approx(RATE_RADPS, abs=math.radians(0.12))
    changed = RATE_RADPS - math.radians(0.3)
    for minute in range(4, 9):
        drift.update_rest_rate(minute * MINUTE_NS, changed + creep, math.radians(0.05), is_raised=True)
    assert drift.at(8 * MINUTE_NS).yaw_rate_radps == pytest.approx(changed, abs=math.radians(0.15))


def test_a_late_anchor_counts_at_its_own_time() -> None:
    rate = math.radians(0.9)
    sure = DriftSettings(rate_sigma_radps=math.radians(0.9), max_late_s=60.0)
    early, late = (DriftFilter(fix(PERSON, 0), sure) for _ in range(2))
    for drift in (early, late):
        drift.update_rest_rate(NS_PER_S, rate, math.radians(0.001))
    at_ns = 40 * NS_PER_S
    then = drifted(PERSON, at_ns, rate)
    point(early, then, LAMPS[0], at_ns)
    late.predict(70 * NS_PER_S)
    point(late, then, LAMPS[0], at_ns)
    a = early.predict(70 * NS_PER_S)
    b = late.predict(70 * NS_PER_S)

    assert b.yaw_rad == pytest.approx(a.yaw_rad, abs=math.radians(0.3))
    assert b.anchored_ns == at_ns
    refused = point(calibrated(PERSON), drifted(PERSON, MINUTE_NS), LAMPS[0], MINUTE_NS)
    assert not refused.accepted
    assert "120 s old" in refused.reason


def test_a_clock_that_is_set_back_is_followed() -> None:
    drift = calibrated(PERSON)
    before = drift.at(3 * MINUTE_NS)
    pose = drift.predict(5 * NS_PER_S)
    assert (pose.yaw_rad, pose.stamp_ns) == (before.yaw_rad, 5 * NS_PER_S)
    assert pose.anchored_ns <= pose.stamp_ns
    assert drift.predict(65 * NS_PER_S).yaw_sigma_rad > before.yaw_sigma_rad


def test_bad_anchors_are_refused_with_a_sentence() -> None:
    drift = calibrated(PERSON)
    eyes = (0.0, 0.0, EYES_M)
    at_ns = 3 * MINUTE_NS
    forward = (1.0, 0.0, 0.0)
    for result in (
        drift.update_anchor(at_ns, LAMPS[0], eyes, (0.01, 0.0, -1.0)),
        drift.update_anchor(at_ns, (PERSON.x, PERSON.y, 0.0), eyes, forward),
        drift.update_rest_rate(at_ns, 5.0, 0.01),
        drift.update_rest_rate(0, 0.0, 0.01),
    ):
        assert not result.accepted
        assert "; " in result.reason


@pytest.mark.parametrize("jump_deg_min", [30.0, -50.0])
def test_rests_in_succession_that_contradict_the_known_drift_end_it(jump_deg_min: float) -> None:
    drift = DriftFilter(fix(PERSON, 0))
    true_rad = PERSON.yaw_rad
    rate = RATE_RADPS
    for second in range(1, 300):
        if second == 200:
            rate += math.radians(jump_deg_min) / 60.0
        true_rad += rate
        at_ns = second * NS_PER_S
        if second % 10 == 0:
            accepted = drift.update_rest_rate(at_ns, rate, math.radians(0.03)).accepted
            assert accepted is (second != 200), second
        if not 200 <= second < 210:
            pose = drift.predict(at_ns)
            assert abs(yaw_difference(pose.yaw_rad, true_rad)) < 3.0 * pose.yaw_sigma_rad

    assert drift.at(300 * NS_PER_S).yaw_rate_radps == pytest.approx(rate, abs=math.radians(0.05))


def test_single_turns_of_a_resting_body_end_no_drift() -> None:
    drift = DriftFilter(fix(PERSON, 0))
    for second in range(10, 600, 10):
        turn = math.radians(0.8) * (-1) ** (second // 60) if second % 60 == 0 else 0.0
        result = drift.update_rest_rate(second * NS_PER_S, RATE_RADPS + turn, math.radians(0.03))
        assert result.accepted is (turn == 0.0)
    assert drift.at(600 * NS_PER_S).yaw_rate_radps == pytest.approx(RATE_RADPS, abs=math.radians(0.05))


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
def test_covariance_stays_valid_after_any_steps(happened: list[Step], sigma: float) -> None:
    drift = DriftFilter(some_fix(0.0, 0.0, 0.0, sigma, 0))
    for step in happened:
        apply(drift, step)
        check(drift.at(0), drift._state.moments()[1])
    check(drift.at(2**62), drift._state.moments()[1])


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
    direction = PERSON.direction(LAMPS[0])

    def filters() -> DriftFilter:
        return calibrated(PERSON)

    drift = filters()
    refused = point(drift, drifted(PERSON, 3 * MINUTE_NS), LAMPS[0], late)
    assert "old" in refused.reason

    drift.set_time(now_ns)
    assert point(drift, drifted(PERSON, 3 * MINUTE_NS), LAMPS[0], late).accepted
    drift = filters()
    origin = (0.0, 0.0, 1.64)
    taken = drift.update_anchor(late, LAMPS[0], origin, direction, now_ns=now_ns)
    assert "old" not in taken.reason
    assert filters().update_heading(late, 0.0, (1.0, 0.0, 0.0), now_ns=now_ns).accepted
    assert not filters().update_heading(late, 0.0, (1.0, 0.0, 0.0)).accepted
    assert filters().update_rest_rate(late, RATE_RADPS, 0.01, now_ns=now_ns).accepted
    assert not filters().update_rest_rate(late, RATE_RADPS, 0.01).accepted

    drift = filters()
    drift.reset_yaw(now_ns, is_restarted=False)
    assert drift.at(now_ns).stamp_ns == now_ns
