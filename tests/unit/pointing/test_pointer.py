"""Model, offset and filter in a row; samples that are stale, out of order, from the future, repeated."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.geometry.one_euro import OneEuro
from pointit.schemas import ImuSample, PointingOffset, UserProfile
from pointit.services.pointing.pointer import Freshness, Pointer
from tests.support.known import known
from tests.unit.schemas.strategies import messages

MS = 1_000_000
UP = PointingOffset(rung="pitch", elevation=(math.radians(3.0), 0.0, 0.0, 0.0, 0.0, 0.0), sigma_rad=0.02)


def sample(azimuth_rad: float, stamp_ns: int, device_time_ns: int | None = None) -> ImuSample:
    return ImuSample(
        stamp_ns=stamp_ns,
        orientation_xyzw=rotation.from_azimuth_elevation(azimuth_rad, -0.1),
        device_time_ns=device_time_ns,
    )


def test_the_offset_is_added_before_the_filter_and_told() -> None:
    pointer = Pointer(UserProfile(stamp_ns=0, offset=UP), one_euro=OneEuro())
    rays = [pointer.ray(sample(azimuth, at), at) for azimuth, at in ((0.3, 0), (0.4, 20 * MS))]
    first, second = rays
    assert first is not None
    assert second is not None
    assert first.raw_direction is not None
    assert vector.elevation(first.direction) == pytest.approx(
        vector.elevation(first.raw_direction) + math.radians(3.0)
    )
    assert first.elevation_correction_rad == pytest.approx(math.radians(3.0))
    assert first.elevation_sigma_rad == 0.02
    assert 0.3 < vector.azimuth(second.direction) < 0.4
    # filtered after it was corrected: both ends of the filter's step lie as high
    assert vector.elevation(second.direction) == pytest.approx(vector.elevation(first.direction), abs=1e-3)


def test_new_profile_resets_the_filter() -> None:
    pointer = Pointer(one_euro=OneEuro())
    assert pointer.ray(sample(0.0, 0), 0) is not None
    pointer.set_profile(UserProfile(stamp_ns=0, offset=UP))
    ray = known(pointer.ray(sample(0.5, 20 * MS), 20 * MS))
    assert vector.azimuth(ray.direction) == pytest.approx(0.5)


def test_repeats_do_not_hold_the_filter_back() -> None:
    """A repeat is not taken for a halt: the same movement with repeats comes out the same."""
    plain, repeating = Pointer(one_euro=OneEuro()), Pointer(one_euro=OneEuro())
    for index in range(50):
        at = index * 20 * MS
        azimuth = 0.02 * index
        expected = known(plain.ray(sample(azimuth, at, at), at))
        found = repeating.ray(sample(azimuth, at, at), at)
        assert repeating.ray(sample(azimuth, at + 10 * MS, at), at + 10 * MS) is None
        assert (repeating.verdict, found) == ("repeated", expected)


def test_rays_are_numbered_without_gaps() -> None:
    pointer = Pointer()
    rays = [pointer.ray(sample(0.0, 0, at), 0) for at in (1, 1, 2, 3)]
    assert [ray.seq for ray in rays if ray is not None] == [1, 2, 3]


S = 1_000_000_000
NOW_NS = 1_700_000_000 * S


def still(stamp_ns: int, device_time_ns: int | None = None) -> ImuSample:
    return ImuSample(stamp_ns=stamp_ns, orientation_xyzw=rotation.IDENTITY, device_time_ns=device_time_ns)


def test_stale_and_older_samples_are_refused() -> None:
    freshness = Freshness(0.2)
    assert freshness.classify(still(1_000_000_000), 1_300_000_000) == "stale"
    assert freshness.classify(still(1_000_000_000), 1_100_000_000) == "fresh"
    assert freshness.classify(still(900_000_000), 1_000_000_000) == "stale"
    assert (freshness.count, freshness.stale) == (3, 2)


def test_one_sample_from_the_future_is_refused_and_spoils_none() -> None:
    freshness = Freshness(0.2)
    assert freshness.classify(still(NOW_NS), NOW_NS) == "fresh"
    assert freshness.classify(still(NOW_NS + 3600 * S), NOW_NS) == "stale"
    assert freshness.classify(still(2**63 - 1), NOW_NS) == "stale"
    assert freshness.classify(still(NOW_NS + S // 50), NOW_NS + S // 50) == "fresh"
    assert freshness.stale == 2


def test_only_the_device_time_proves_a_repeat() -> None:
    freshness = Freshness(0.2)
    same = [freshness.classify(still(NOW_NS + k), NOW_NS + k) for k in range(5)]  # the same orientation
    assert same == ["fresh"] * 5
    told = [freshness.classify(still(NOW_NS + 9, 77), NOW_NS + 9) for _ in range(3)]
    assert told == ["fresh", "repeated", "repeated"]
    assert (freshness.repeated, freshness.stale, freshness.restarts) == (2, 0, 0)


def test_a_repeat_with_a_newer_stamp_does_not_make_the_next_sample_old() -> None:
    freshness = Freshness(0.2)
    assert freshness.classify(still(NOW_NS, 0), NOW_NS) == "fresh"
    assert freshness.classify(still(NOW_NS + 30, 0), NOW_NS + 30) == "repeated"
    assert freshness.classify(still(NOW_NS + 20, 20), NOW_NS + 30) == "fresh"


def test_a_restarted_device_is_taken_and_counted() -> None:
    freshness = Freshness(0.2)
    times = (60 * S, 60 * S + 20, 5, 25, 25, 45)
    verdicts = [freshness.classify(still(NOW_NS + k, at), NOW_NS + k) for k, at in enumerate(times)]
    assert (verdicts, freshness.restarts) == (["fresh", "fresh", "fresh", "fresh", "repeated", "fresh"], 1)


def test_samples_that_overtook_each_other_are_no_restart() -> None:
    freshness = Freshness(0.2)
    times = (S, S + 40_000_000, S + 20_000_000, S + 60_000_000)
    verdicts = [freshness.classify(still(NOW_NS + k, at), NOW_NS + k) for k, at in enumerate(times)]
    assert (verdicts, freshness.restarts, freshness.stale) == (["fresh", "fresh", "stale", "fresh"], 0, 1)


@given(st.lists(st.integers(1, S), max_size=30), st.lists(st.integers(0, 29), max_size=30))
def test_every_news_is_fresh_once_however_often_it_is_said(steps: list[int], again: list[int]) -> None:
    freshness = Freshness(0.2)
    device_ns = 0
    for index, step in enumerate(steps):
        device_ns += step
        now_ns = NOW_NS + device_ns
        said = 1 + again.count(index)
        verdicts = [freshness.classify(still(now_ns, device_ns), now_ns) for _ in range(said)]
        assert verdicts == ["fresh", *["repeated"] * (said - 1)]
    assert freshness.count == len(steps) + freshness.repeated


@given(messages(UserProfile), st.lists(messages(ImuSample), min_size=1, max_size=3), st.floats(-10.0, 10.0))
def test_any_profile_and_samples_give_valid_rays(
    profile: UserProfile, samples: list[ImuSample], yaw_rad: float
) -> None:
    """Nobody else checks them: in tests they are validated."""
    pointer = Pointer(profile, one_euro=OneEuro())
    pointer.set_yaw(yaw_rad)
    for each in samples:
        assert pointer.ray(each, each.stamp_ns) is not None or pointer.verdict != "fresh"
