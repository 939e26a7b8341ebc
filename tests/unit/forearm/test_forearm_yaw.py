"""The yaw of a forearm, and true poses."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pointit.forearm.forearm_yaw import MAX_LATER_SIGMA_RAD, MAX_YAW_SIGMA_RAD, ForearmYaw
from pointit.forearm.true_pose import PoseError, TruePose, find_true_poses
from pointit.geometry import rotation
from pointit.schemas import NS_PER_S, TrackedObject, TrackedObjects, UserPose
from tests.support.bench import START_NS
from tests.unit.forearm.simulated_arm import Arm, Course, pointing, small, waving


@pytest.mark.parametrize(("make", "duration_s"), [(waving, 2.0), (pointing, 5.0)], ids=["waving", "pointing"])
def test_yaw_is_known_after_seconds_of_movement_within_its_sigma(
    make: Callable[[np.random.Generator], Course], duration_s: float
) -> None:
    errors_rad: list[float] = []
    for seed in range(6):
        arm = Arm(seed, delay_s=0.02 * (seed % 3))
        arm.move(make(arm.dice), duration_s)
        errors_rad.append(arm.error_rad())
        assert arm.error_rad() < 3.0 * arm.estimate().sigma_rad
    assert np.median(errors_rad) < math.radians(0.4)
    assert max(errors_rad) < math.radians(1.5)


def test_an_arm_at_rest_shows_no_yaw() -> None:
    arm = Arm(1)
    arm.move(lambda _: rotation.from_azimuth_elevation(0.2, -1.3), 20.0)
    assert arm.estimator.estimate(arm.now_ns) is None


def test_an_arm_that_turns_level_only_shows_no_yaw() -> None:
    arm = Arm(2)
    arm.move(lambda time_s: rotation.from_azimuth_elevation(0.8 * math.sin(2.0 * time_s), 0.0), 8.0)
    estimate = arm.estimator.estimate(arm.now_ns)
    assert estimate is None or estimate.sigma_rad > math.radians(3.0)


@pytest.mark.parametrize("seed", range(6))
def test_body_on_another_arm_than_the_wrist_shows_no_yaw(seed: int) -> None:
    dice = np.random.default_rng(seed)
    estimator = ForearmYaw()
    wrist = pointing(dice)
    other = waving(dice)
    for tick in range(250):
        time_ns = START_NS + tick * NS_PER_S // 50
        estimator.add_body(time_ns, other(tick / 50))
        estimator.add_arm(time_ns, wrist(tick / 50), 0)
        assert estimator.estimate(time_ns) is None


def test_delay_of_the_wrist_is_estimated_and_leaves_the_yaw() -> None:
    arm = Arm(3, delay_s=0.06)
    arm.move(waving(arm.dice), 4.0)
    assert arm.estimate().delay_s == pytest.approx(0.06, abs=0.012)
    assert arm.error_rad() < math.radians(1.5)


def test_the_uncertainty_grows_while_the_arm_rests() -> None:
    arm = Arm(4)
    arm.move(waving(arm.dice), 4.0)
    before = arm.estimate()
    still = waving(arm.dice)(0.0)
    arm.move(lambda _: still, 30.0)
    assert before.sigma_rad < 0.6 * arm.estimate().sigma_rad < math.radians(1.5)
    assert arm.error_rad() < 3.0 * arm.estimate().sigma_rad


def test_another_yaw_origin_begins_anew() -> None:
    arm = Arm(5)
    arm.move(waving(arm.dice), 4.0)
    arm.epoch = 1
    arm.yaw_rad = arm.yaw_rad + 1.5
    arm.move(lambda _: rotation.IDENTITY, 0.1)
    assert arm.estimator.estimate(arm.now_ns) is None
    arm.move(waving(arm.dice), 3.0)
    assert arm.error_rad() < math.radians(1.0)


def test_nothing_is_paired_over_a_gap_of_the_cameras() -> None:
    arm = Arm(6)
    course = waving(arm.dice)
    arm.move(course, 3.0)
    before = arm.estimate()
    arm.move(course, 3.0, cameras=False)
    assert arm.estimate().stamp_ns > before.stamp_ns
    assert arm.estimate().yaw_rad == before.yaw_rad
    arm.move(course, 3.0)
    assert arm.error_rad() < math.radians(1.0)


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.1])
def test_level_turns_without_any_noise_show_no_yaw(yaw_rad: float) -> None:
    estimator = ForearmYaw()
    for tick in range(400):
        time_ns = START_NS + tick * NS_PER_S // 50
        arm = rotation.from_yaw(0.8 * math.sin(tick / 25))
        estimator.add_body(time_ns, rotation.multiply(rotation.from_yaw(yaw_rad), arm))
        estimator.add_arm(time_ns, arm, 0)
        assert estimator.estimate(time_ns) is None


def test_clocks_of_both_that_are_set_back_begin_anew() -> None:
    before = Arm(7)
    after = Arm(8)
    before.time_s = 3600.0
    after.estimator = before.estimator
    before.move(waving(before.dice), 4.0)
    after.move(waving(after.dice), 4.0)
    assert after.error_rad() < math.radians(1.5)


def test_yaw_is_found_after_the_wrists_clock_is_set_back() -> None:
    estimator = ForearmYaw()
    body = (0.0, 0.0, 0.0, 1.0)
    estimator.add_arm(START_NS + 3600 * NS_PER_S, body, 1)
    arm = Arm(5)
    arm.estimator = estimator
    arm.epoch = 1
    arm.move(waving(arm.dice), 5.0)
    assert estimator.estimate(arm.now_ns) is not None


@pytest.mark.parametrize(
    ("make", "duration_s", "arms"), [(waving, 2.0, 20), (pointing, 5.0, 10)], ids=["waving", "pointing"]
)
def test_sigma_holds_for_imus_with_errors_lasting_a_second(
    make: Callable[[np.random.Generator], Course], duration_s: float, arms: int
) -> None:
    normalized: list[float] = []
    for seed in range(300, 300 + arms):
        arm = Arm(seed, delay_s=0.02 * (seed % 3), error_time_s=1.0)
        arm.move(make(arm.dice), duration_s)
        normalized.append(arm.error_rad() / arm.estimate().sigma_rad)
    assert sum(each < 2.0 for each in normalized) >= 0.9 * arms
    assert max(normalized) < 4.0
    assert np.mean(np.square(normalized)) > 0.3  # an honest sigma is not too large either


def test_errors_that_last_are_reported_by_a_larger_sigma() -> None:
    sigmas_rad: list[float] = []
    for error_time_s in (0.0, 1.0):
        arms = [Arm(seed, error_time_s=error_time_s) for seed in range(330, 333)]
        for arm in arms:
            arm.move(pointing(arm.dice), 5.0)
        sigmas_rad.append(float(np.median([arm.estimate().sigma_rad for arm in arms])))
    assert sigmas_rad[1] > 1.4 * sigmas_rad[0]


def test_less_than_a_second_of_movement_shows_no_yaw() -> None:
    arm = Arm(340)
    arm.move(waving(arm.dice), 0.8)
    assert arm.estimator.estimate(arm.now_ns) is None


def test_yaw_is_unknown_with_a_sentence_until_it_is_certain() -> None:
    arm = Arm(341, imu_rad=math.radians(3.0))
    assert arm.estimator.problem("anna", arm.now_ns).startswith("the yaw of anna is not known: move the arm")
    course = small(arm.dice)
    arm.move(course, 3.0)
    uncertain = arm.estimate()
    assert uncertain.sigma_rad > MAX_YAW_SIGMA_RAD
    assert arm.estimator.known(arm.now_ns) is None
    sigma_deg = math.degrees(uncertain.sigma_rad)
    expected = f"the yaw of anna is uncertain by {sigma_deg:.1f}°, limit 1.0°: move the arm"
    assert arm.estimator.problem("anna", arm.now_ns).startswith(expected)


def test_resting_arms_yaw_is_known_until_the_later_limit() -> None:
    arm = Arm(342)
    arm.move(waving(arm.dice), 4.0)
    assert arm.estimator.problem("anna", arm.now_ns) == ""
    later_ns = arm.now_ns + 60 * NS_PER_S
    known = arm.estimator.known(later_ns)
    assert known is not None
    assert MAX_YAW_SIGMA_RAD < known.sigma_rad < MAX_LATER_SIGMA_RAD
    assert arm.estimator.known(arm.now_ns + 300 * NS_PER_S) is None
    assert arm.estimator.known(later_ns) is None  # lost: as certain as at first is needed again


def moving_arm(time_s: float) -> Rotation:
    return Rotation.from_euler(
        "ZYX",
        (
            0.6 * math.sin(1.7 * time_s) + 0.3 * math.sin(0.61 * time_s),
            -0.45 * math.sin(2.3 * time_s + 0.4),
            0.25 * math.sin(1.1 * time_s),
        ),
    )


@pytest.mark.parametrize(
    ("jump_deg", "rate_hz", "rests"),
    [(-70, 60, False), (30, 120, False), (4, 60, False), (30, 60, True), (6, 60, True)],
)
def test_yaw_jump_ends_the_yaw_or_is_within_its_sigma(*, jump_deg: float, rate_hz: int, rests: bool) -> None:
    estimator = ForearmYaw()
    mount = Rotation.from_quat((0.2, 0.5, 0.26, 0.8))
    jump_s = 8
    sentences: set[str] = set()
    time_ns = START_NS
    for tick in range(14 * rate_hz):
        time_s = tick / rate_hz
        time_ns = START_NS + tick * NS_PER_S // rate_hz
        true_deg = 50.0 if time_s < jump_s else 50.0 + jump_deg
        arm = moving_arm(min(time_s, jump_s - 3) if rests else time_s)
        x, y, z, w = (arm * mount).as_quat()
        estimator.add_body(time_ns, (x, y, z, w))
        x, y, z, w = (Rotation.from_euler("z", -true_deg, degrees=True) * arm).as_quat()
        estimator.add_arm(time_ns, (x, y, z, w), 0)
        known = estimator.known(time_ns)
        if known is not None and (time_s < jump_s or time_s > jump_s + 2):
            error_rad = abs(math.remainder(known.yaw_rad - math.radians(true_deg), math.tau))
            assert error_rad < 3.0 * known.sigma_rad, time_s
        if known is None and time_s > jump_s:
            sentences.add(estimator.problem("anna", time_ns))

    assert all("turned by" in each and "against each other: move the arm" in each for each in sentences)
    assert sentences or abs(jump_deg) < 6
    assert rests or estimator.known(time_ns) is not None, "known again by the new turns"


def test_a_yaw_that_is_lost_is_stated_once_as_any() -> None:
    arm = Arm(9)
    arm.move(waving(arm.dice), 4.0)
    assert arm.estimator.stated(arm.now_ns) == arm.estimator.known(arm.now_ns)
    arm.epoch = 1
    arm.move(lambda _: rotation.IDENTITY, 0.1)
    last = arm.estimator.stated(arm.now_ns)
    assert last is not None
    assert last.sigma_rad > math.radians(90.0)
    assert arm.estimator.stated(arm.now_ns) is None


@pytest.mark.parametrize("seed", range(2))
def test_noise_a_few_flipped_frames_and_rest_end_no_yaw(seed: int) -> None:
    arm = Arm(seed, delay_s=0.04, error_time_s=1.0)
    course = pointing(arm.dice)
    arm.move(course, 5.0)
    for duration_s in (0.3, 3.0, 0.3, 8.0):
        if duration_s < 1.0:
            mount = arm.mount
            arm.mount = rotation.multiply(arm.mount, (1.0, 0.0, 0.0, 0.0))
            arm.move(course, duration_s)
            arm.mount = mount
            continue
        arm.move(course, duration_s)
        assert arm.estimator.problem("anna", arm.now_ns) == ""
        assert arm.error_rad() < 4.0 * arm.estimate().sigma_rad


NOW_NS = 1000 * NS_PER_S


def tracked(kind: str, name: str = "anna", x: float = 1.0, *, yaw_rad: float | None = 3.0) -> TrackedObjects:
    each = TrackedObject(id=name, kind=kind, position_m=(x, 2.0, 1.7), yaw_rad=yaw_rad)
    return TrackedObjects(stamp_ns=NOW_NS, objects=(each,))


def localized(stamp_ns: int = NOW_NS, method: str = "static_targets") -> UserPose:
    fields = {"stamp_ns": stamp_ns, "position_m": (1.3, 2.4, 0.0), "yaw_rad": -3.0, "method": method}
    return UserPose.model_validate(fields)


def test_only_people_have_true_poses_and_ones_with_yaw_win() -> None:
    position = tracked("person", x=5.0)
    frame = tracked("person_frame")
    expected = {"anna": TruePose(NOW_NS, (1.0, 2.0, 1.7), 3.0)}
    cup = tracked("red", "cup")
    assert find_true_poses({"a": position, "b": frame, "c": cup}) == expected
    assert find_true_poses({"a": frame, "b": position, "c": cup}) == expected


def test_azimuth_of_a_face_is_not_the_frames_yaw() -> None:
    assert find_true_poses({"a": tracked("person")})["anna"].yaw_rad is None


def test_yaw_error_is_the_shorter_turn_and_height_is_ignored() -> None:
    error = TruePose(NOW_NS, (1.0, 2.0, 1.7), 3.0).error_of(localized())
    assert error is not None
    assert (error.position_m, error.yaw_rad) == pytest.approx((0.5, 0.283185), abs=1e-6)
    assert TruePose(NOW_NS, (1.0, 2.0, 1.7), None).error_of(localized()) == PoseError(error.position_m, None)


def test_later_or_external_poses_have_no_error() -> None:
    true_pose = TruePose(NOW_NS, (1.0, 2.0, 1.7), 3.0)
    assert true_pose.error_of(localized(NOW_NS - 600 * NS_PER_S)) is not None
    assert true_pose.error_of(localized(NOW_NS + NS_PER_S)) is None
    assert true_pose.error_of(localized(method="external")) is None
