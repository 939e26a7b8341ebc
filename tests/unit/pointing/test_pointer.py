"""Model, offset and filter in a row."""

import math

import pytest

from pointit.geometry import rotation, vector
from pointit.geometry.one_euro import OneEuro
from pointit.schemas import ImuSample, PointingOffset, UserProfile
from pointit.services.pointing.pointer import Pointer
from tests.support.known import known

MS = 1_000_000
UP = PointingOffset(rung="pitch", elevation=(math.radians(3.0), 0.0, 0.0, 0.0, 0.0, 0.0), sigma_rad=0.02)


def sample(azimuth_rad: float, stamp_ns: int, device_time_ns: int | None = None) -> ImuSample:
    return ImuSample(
        stamp_ns=stamp_ns,
        orientation_xyzw=rotation.from_azimuth_elevation(azimuth_rad, -0.1),
        device_time_ns=device_time_ns,
    )


def test_uncalibrated_and_unfiltered_the_ray_is_the_models() -> None:
    ray = known(Pointer().ray(sample(0.3, 0), 0))
    assert ray.direction == ray.raw_direction
    assert (ray.azimuth_correction_rad, ray.elevation_correction_rad) == (0.0, 0.0)
    assert ray.elevation_sigma_rad is None


def test_the_offset_is_added_before_the_filter_and_told() -> None:
    pointer = Pointer(UserProfile(stamp_ns=0, offset=UP), smoothing=OneEuro())
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
    pointer = Pointer(smoothing=OneEuro())
    assert pointer.ray(sample(0.0, 0), 0) is not None
    pointer.set_profile(UserProfile(stamp_ns=0, offset=UP))
    ray = known(pointer.ray(sample(0.5, 20 * MS), 20 * MS))
    assert vector.azimuth(ray.direction) == pytest.approx(0.5)


def test_repeats_do_not_hold_the_filter_back() -> None:
    """A repeat is not taken for a halt: the same movement with repeats comes out the same."""
    plain, repeating = Pointer(smoothing=OneEuro()), Pointer(smoothing=OneEuro())
    for index in range(50):
        at = index * 20 * MS
        azimuth = 0.02 * index
        expected = known(plain.ray(sample(azimuth, at, at), at))
        found = repeating.ray(sample(azimuth, at, at), at)
        assert repeating.ray(sample(azimuth, at + 10 * MS, at), at + 10 * MS) is None
        assert repeating.verdict == "repeated"
        assert found == expected


def test_rays_are_numbered_without_gaps() -> None:
    pointer = Pointer()
    rays = [pointer.ray(sample(0.0, 0, at), 0) for at in (1, 1, 2, 3)]
    assert [ray.seq for ray in rays if ray is not None] == [1, 2, 3]
