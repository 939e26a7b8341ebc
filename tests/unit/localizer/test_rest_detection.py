"""Poses between localizations, and the drift that resting arms tell."""

import math
from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, Lamp, PointingRay, UserPose
from pointit.services.localizer.drift.rest_detection import RestDetector, RestYawRate
from pointit.services.localizer.estimation.unfiltered_rays import Mean, mean
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.procedure_runner import Anchoring
from pointit.services.localizer.tracking import PoseTracker
from tests.support import there
from tests.unit.localizer.person import START_NS, Person, config, yaw_difference

S = NS_PER_S
LAMP = Lamp(id="led", position_m=(4.0, 1.0, 1.2))
RATE = math.radians(0.3)
"""The yaw of {H} drifts by so much in a second."""
DEGREE = math.radians(1.0)


def at(t_s: float) -> int:
    return START_NS + round(t_s * S)


def person(t_s: float, bias_rad: float = 0.0) -> Person:
    return Person(0.5, -0.5, 0.4 + RATE * t_s, bias_rad)


def found(t_s: float = 0.0, bias_rad: float = 0.0) -> UserPose:
    sigma = (0.1**2, 0.0, 0.0, 0.0, 0.1**2, 0.0, 0.0, 0.0, (1.5 * DEGREE) ** 2)
    return UserPose(
        stamp_ns=at(t_s),
        position_m=(0.5, -0.5, 0.0),
        yaw_rad=person(t_s).yaw_rad,
        covariance=sigma,
        method="static_targets",
        elevation_bias_rad=bias_rad,
        samples=200,
    )


def pointing(t_s: float, bias_rad: float = 0.0, off_rad: float = 0.0) -> Mean:
    now = person(t_s, bias_rad)
    turned = Person(now.x, now.y, now.yaw_rad - off_rad, now.bias_rad)
    return there(mean([turned.ray(LAMP.position_m, at(t_s) + tick * S // 50) for tick in range(-25, 26)]))


def localized(*, follow: bool | None = None) -> PoseTracker:
    tracking = PoseTracker(follow=follow)
    tracking.set_localized(found(), at(-8.0), at(0.0), at(0.0))
    return tracking


def test_the_pose_is_followed_at_a_sensible_pace() -> None:
    tracking = localized()
    tracking.anchor(LAMP, pointing(10.0))
    tracking.anchor(LAMP, pointing(30.0))
    published: list[UserPose] = []
    now_ns = at(31.0)
    while now_ns < at(61.0):
        pose = tracking.due(now_ns)
        if pose is not None:
            published.append(pose)
        now_ns += round(tracking.wait_s(now_ns) * S)
    gaps = np.diff([pose.stamp_ns for pose in published]) / S

    assert gaps.min() >= 0.2
    assert gaps.max() <= 2.0
    steps = np.abs(np.diff([pose.yaw_rad for pose in published]))
    assert steps.max() < 0.4 * DEGREE  # 0.1° and a period

    sigmas = [pose.covariance[8] for pose in published]
    assert sigmas == sorted(sigmas)  # it becomes less certain
    assert {pose.method for pose in published} == {"static_targets"}
    assert published[-1].anchored_ns == at(30.0)
    assert published[-1].yaw_rate_radps == pytest.approx(RATE, abs=0.15 * DEGREE)
    assert published[-1].yaw_rate_sigma_radps is not None


def test_rejected_anchor_is_measured_and_changes_nothing() -> None:
    tracking = localized()
    before = there(tracking.pose(at(10.0)))
    anchor = tracking.anchor(LAMP, pointing(10.0), "the arm wandered").anchor
    assert (anchor.accepted, anchor.reason) == (False, "the arm wandered")
    assert anchor.azimuth_error_rad == pytest.approx(3.0 * DEGREE, abs=0.1 * DEGREE)
    after = there(tracking.pose(at(10.0)))
    assert after.yaw_rad == before.yaw_rad
    assert PoseTracker().anchor(LAMP, pointing(0.0)).anchor.reason.startswith("no pose is known")


@pytest.mark.parametrize("follow", [True, False])
def test_following_can_be_asked_for_or_ruled_out(*, follow: bool) -> None:
    tracking = PoseTracker(follow=follow)
    given = found().model_copy(update={"method": "fixed", "covariance": (0.0,) * 9})
    tracking.set_exact(given, at(0.0))
    assert (tracking.due(at(5.0)) is not None) is follow
    tracking.set_localized(found(6.0), at(0.0), at(3.0), at(6.0))
    assert (tracking.due(at(10.0)) is not None) is follow
    assert tracking.anchor(LAMP, pointing(12.0)).anchor.accepted
    assert (tracking.due(at(20.0)) is not None) is follow


def test_yaw_of_a_long_localization_is_that_of_its_middle() -> None:
    tracking = localized()
    for t_s in (20.0, 40.0, 60.0):
        tracking.anchor(LAMP, pointing(t_s))  # the drift is known by now
    mean_yaw = found(66.0).model_copy(update={"stamp_ns": at(70.0)})
    published = tracking.set_localized(mean_yaw, at(62.0), at(66.0), at(70.0))
    assert published.stamp_ns == at(70.0)
    assert abs(yaw_difference(published.yaw_rad, person(70.0).yaw_rad)) < 0.3 * DEGREE


def test_every_pose_is_newer_than_the_ones_before() -> None:
    tracking = localized()
    later = there(tracking.due(at(5.0)))
    # a solution of rays that are older than what was published meanwhile
    again = tracking.set_localized(found(4.5), at(0.0), at(2.0), at(5.0))
    assert again.stamp_ns > later.stamp_ns
    tracking.set_external(found(5.8).model_copy(update={"method": "external"}))  # its clock is 0.6 s ahead
    ours = tracking.set_localized(found(5.2), at(0.0), at(2.0), at(5.2))
    assert ours.stamp_ns > at(5.8)
    back = tracking.set_localized(found(-3600.0), at(-3610.0), at(-3605.0), at(-3600.0))
    assert back.stamp_ns == at(-3600.0)


def ray(t_s: float, correction_rad: float = 0.0, sigma_rad: float | None = None) -> PointingRay:
    return PointingRay(
        stamp_ns=at(t_s),
        origin_m=(0.0, 0.0, 1.64),
        direction=(1.0, 0.0, 0.0),
        elevation_correction_rad=correction_rad,
        elevation_sigma_rad=sigma_rad,
    )


def test_a_calibration_takes_the_bias_over_and_gives_it_back() -> None:
    """Else an offset of -8° and a bias of 8°, which are the same thing, would both be taken out."""
    tracking = PoseTracker()
    tracking.on_ray(ray(0.0), at(0.0))
    tracking.set_localized(found(0.0, 8.0 * DEGREE), at(-8.0), at(0.0), at(0.0))
    assert tracking.on_ray(ray(1.0), at(1.0)) is None
    calibrated = there(tracking.on_ray(ray(2.0, -8.0 * DEGREE, DEGREE), at(2.0)))
    assert calibrated.elevation_bias_rad == 0.0
    assert tracking.on_ray(ray(3.0, -8.0 * DEGREE, DEGREE), at(3.0)) is None
    erased = there(tracking.on_ray(ray(4.0), at(4.0)))
    assert erased.elevation_bias_rad == pytest.approx(8.0 * DEGREE)
    fixed = PoseTracker()
    fixed.set_exact(found().model_copy(update={"method": "fixed"}), at(0.0))
    assert fixed.on_ray(ray(1.0, -8.0 * DEGREE, DEGREE), at(1.0)) is None
    assert fixed.on_ray(ray(2.0), at(2.0)) is None


def anchoring(tracking: PoseTracker, off_deg: float = 0.0, wander_deg: float = 0.0) -> list[Output]:
    procedure = Anchoring(LAMP, tracking.anchor, config(), occupies=("other",))
    assert procedure.lamp_ids == ("led", "other")
    outputs = procedure.start(at(30.0))
    for tick in range(50 * 12):
        t_s = 30.0 + tick / 50.0
        now = person(t_s)
        wander = math.radians(off_deg + wander_deg * math.sin(t_s * 3.0))
        procedure.on_ray(Person(now.x, now.y, now.yaw_rad - wander).ray(LAMP.position_m, at(t_s)))
        outputs += procedure.step(at(t_s))
    assert not procedure.running
    return outputs


@pytest.mark.parametrize(
    ("off_deg", "wander_deg", "reason"),
    [(80.0, 0.0, "point at that target again"), (0.0, 12.0, "the arm wandered by")],
)
def test_a_bad_anchor_is_told_too_and_refused(off_deg: float, wander_deg: float, reason: str) -> None:
    outputs = anchoring(localized(), off_deg, wander_deg)
    anchor, progress = outputs[-2:]
    assert type(anchor).__name__ == "Anchor"
    assert reason in anchor.reason  # pyrefly: ignore[missing-attribute]  # checked above
    assert not anchor.accepted  # pyrefly: ignore[missing-attribute]  # checked above
    assert progress.phase == "refused"  # pyrefly: ignore[missing-attribute]  # the last is always progress
    assert progress.reason == anchor.reason  # pyrefly: ignore[missing-attribute]  # as above


def test_a_rest_counts_until_a_cursor_appears() -> None:
    tracking = localized()
    for tick in range(25 * 9):  # shorter than what is measured by itself
        tracking.on_orientation(
            rotation.from_azimuth_elevation(1.0 - RATE * tick / 25.0, -1.2), at(tick / 25.0)
        )
    tracking.end_rest()
    pose = there(tracking.pose(at(9.0)))
    assert pose.yaw_rate_radps == pytest.approx(RATE, rel=0.2)


@pytest.mark.parametrize("restarted", [False, True])
@pytest.mark.parametrize("follow", [None, False])
def test_yaw_is_unknown_after_a_new_origin_until_measured_again(
    *, restarted: bool, follow: bool | None
) -> None:
    tracking = localized(follow=follow)
    before = there(tracking.pose(at(5.0)))
    lost = there(tracking.on_yaw_origin_changed(at(5.0), is_restarted=restarted))
    assert math.sqrt(lost.covariance[8]) >= math.pi / 2
    assert lost.position_m == before.position_m
    assert lost.covariance[0] == pytest.approx(before.covariance[0], rel=0.1)
    assert tracking.has_lost_yaw

    refused = tracking.anchor(LAMP, pointing(6.0), "the arm wandered").anchor
    assert not refused.accepted
    assert tracking.has_lost_yaw
    # 2.5 rad from what it was
    assert tracking.anchor(LAMP, pointing(7.0, off_rad=-2.5)).anchor.accepted
    assert not tracking.has_lost_yaw

    told = there(tracking.pose(at(7.0)))
    assert abs(yaw_difference(told.yaw_rad, person(7.0).yaw_rad + 2.5)) < 2.0 * DEGREE
    tracking.on_yaw_origin_changed(at(8.0), is_restarted=restarted)
    tracking.set_localized(found(20.0), at(12.0), at(16.0), at(20.0))
    assert not tracking.has_lost_yaw
    assert tracking.yaw_sigma_rad(at(20.0)) < 3.0 * DEGREE


def test_exact_and_external_poses_keep_their_yaw_with_another_origin() -> None:
    tracking = PoseTracker()
    assert tracking.on_yaw_origin_changed(at(0.0), is_restarted=True) is None
    tracking.set_exact(found().model_copy(update={"method": "fixed", "covariance": (0.0,) * 9}), at(0.0))
    assert tracking.on_yaw_origin_changed(at(1.0), is_restarted=True) is None
    tracking.set_external(found(2.0).model_copy(update={"method": "external"}))
    assert tracking.on_yaw_origin_changed(at(3.0), is_restarted=False) is None
    assert not tracking.has_lost_yaw
    set_right = PoseTracker()
    set_right.set_exact(found().model_copy(update={"method": "fixed", "covariance": (0.0,) * 9}), at(0.0))
    assert set_right.anchor(LAMP, pointing(5.0)).anchor.accepted
    assert set_right.on_yaw_origin_changed(at(6.0), is_restarted=False) is not None


HANGING = -1.45
LEVEL = -0.3
DRIFT_RADPS = math.radians(0.4)
HZ = 50.0


def wander(count: int, sigma_deg: float, rng: np.random.Generator, hz: float = HZ) -> NDArray[np.float64]:
    """Return the tremor of a held arm (pointing.md §7)."""
    stays = math.exp(-1.0 / (hz * 0.3))
    kicks = rng.normal(0.0, math.radians(sigma_deg) * math.sqrt(1.0 - stays**2), count)
    out = np.zeros(count)
    for i in range(1, count):
        out[i] = stays * out[i - 1] + kicks[i]
    return out


def stream(
    azimuth: Callable[[float], float],
    elevation: Callable[[float], float],
    seconds: float,
    *,
    seed: int = 0,
    start_s: float = 100.0,
    hz: float = HZ,
) -> list[tuple[Quaternion, int]]:
    rng = np.random.default_rng(seed)
    count = round(seconds * hz)
    sideways = wander(count, 0.25, rng, hz)
    upwards = wander(count, 0.16, rng, hz)
    return [
        (
            rotation.from_azimuth_elevation(
                azimuth(i / hz) + float(sideways[i]), elevation(i / hz) + float(upwards[i]), 0.7
            ),
            round((start_s + i / hz) * NS_PER_S),
        )
        for i in range(count)
    ]


def fed(stillness: RestDetector, samples: Iterable[tuple[Quaternion, int]]) -> list[RestYawRate]:
    told = [stillness.add(*sample) for sample in samples]
    return [one for one in (*told, stillness.end()) if one is not None]


@pytest.mark.parametrize("elevation", [HANGING, -math.pi / 2, LEVEL, 0.0])
def test_a_resting_arm_tells_the_drift(elevation: float) -> None:
    told = fed(RestDetector(), stream(lambda t: 1.0 + DRIFT_RADPS * t, lambda _: elevation, 60.0))
    assert len(told) >= 4
    for rate in told:
        assert abs(rate.yaw_rate_radps + DRIFT_RADPS) < 3.5 * rate.sigma_radps
        assert rate.is_raised == (elevation > -1.0)
    longest = max(told, key=lambda rate: rate.span_s)
    assert longest.sigma_radps < math.radians(0.2 if longest.is_raised else 0.06)


def test_rest_samples_count_once() -> None:
    told = fed(RestDetector(), stream(lambda t: DRIFT_RADPS * t, lambda _: HANGING, 120.0))
    ends = [(rate.stamp_ns - rate.span_s * 5e8, rate.stamp_ns + rate.span_s * 5e8) for rate in told]
    assert all(a[1] <= b[0] for a, b in pairwise(ends))
    assert sum(rate.span_s for rate in told) <= 120.0


Turn = Callable[[float], float]

FOLLOWED: list[tuple[Turn, Turn]] = [
    (lambda t: 0.05 * t, lambda _: LEVEL),  # a parcel at 3 °/s
    (lambda t: math.radians(2.5) * math.sin(0.5 * t), lambda _: LEVEL),
    (lambda t: math.radians(1.5) * t, lambda _: LEVEL),
    (lambda t: 0.0 * t, lambda t: LEVEL + math.radians(0.6) * t),  # upwards: never drift
    (lambda t: math.radians(5.0) * math.sin(t), lambda _: LEVEL),
    (lambda t: math.radians(20.0) * math.sin(0.3 * t), lambda t: LEVEL + 0.1 * math.cos(0.3 * t)),
]


@pytest.mark.parametrize(("azimuth", "elevation"), FOLLOWED)
def test_an_arm_that_follows_something_slowly_does_not_rest(azimuth: Turn, elevation: Turn) -> None:
    assert fed(RestDetector(), stream(azimuth, elevation, 40.0)) == []


def test_a_movement_that_begins_gently_is_left_out() -> None:
    def azimuth(t: float) -> float:
        return 0.05 * max(0.0, t - 5.0) ** 2

    told = fed(RestDetector(), stream(azimuth, lambda _: HANGING, 7.0))
    assert len(told) == 1
    assert told[0].stamp_ns + told[0].span_s * 5e8 <= 105.4 * NS_PER_S
    assert abs(told[0].yaw_rate_radps) < 3.0 * told[0].sigma_radps


def test_short_rest_has_no_rate() -> None:
    assert fed(RestDetector(), stream(lambda _: 0.0, lambda _: HANGING, 2.5)) == []


def test_gaps_and_clock_steps_restart_rests_and_repeats_are_ignored() -> None:
    samples = stream(lambda t: DRIFT_RADPS * t, lambda _: HANGING, 6.0)
    twice = [sample for sample in samples for _ in range(2)]
    assert fed(RestDetector(), twice) == fed(RestDetector(), samples)
    holed = [s for s in samples if not 102.5 * NS_PER_S < s[1] < 103.5 * NS_PER_S]
    assert all(rate.span_s < 3.0 for rate in fed(RestDetector(), holed))
    stillness = RestDetector()
    for sample in samples:
        stillness.add(*sample)
    back = [(q, stamp - 90 * NS_PER_S) for q, stamp in samples]
    assert [round(rate.stamp_ns / NS_PER_S) for rate in fed(stillness, back)] == [13]


def test_the_sign_of_a_quaternion_means_nothing() -> None:
    samples = stream(lambda t: DRIFT_RADPS * t, lambda _: HANGING, 8.0)
    flipped = [((-q[0], -q[1], -q[2], -q[3]) if i % 3 else q, stamp) for i, (q, stamp) in enumerate(samples)]
    plain = fed(RestDetector(), samples)
    other = fed(RestDetector(), flipped)
    assert len(plain) == 1
    assert other[0].yaw_rate_radps == pytest.approx(plain[0].yaw_rate_radps, abs=1e-12)
