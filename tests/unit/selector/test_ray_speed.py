"""The speed of a ray: right for steady turns, blind to tremor and to single wrong samples."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.services.selector.methods.ray_speed import RaySpeedEstimator

S = 1_000_000_000


def speed_deg_s(steadiness: RaySpeedEstimator) -> float:
    rate = steadiness.rate()
    assert rate is not None
    return math.degrees(math.hypot(*rate))


@given(
    st.floats(-180, 180),
    st.floats(-60, 60),
    st.floats(-100, 100),
    st.floats(-50, 50),
    st.sampled_from([10, 25, 50, 200]),
)
def test_a_ray_that_turns_evenly_has_that_speed(
    azimuth_deg: float, elevation_deg: float, turned_deg_s: float, raised_deg_s: float, rate_hz: int
) -> None:
    steadiness = RaySpeedEstimator(0.15)
    for index in range(rate_hz):
        time_s = index / rate_hz - 1.0
        ray = vector.direction(
            math.radians(azimuth_deg + turned_deg_s * time_s),
            math.radians(elevation_deg + 0.5 * raised_deg_s * time_s),
        )
        steadiness.add(10 * S + round(time_s * S), ray)
    rate = steadiness.rate()
    assert rate is not None
    level = math.cos(math.radians(elevation_deg - 0.5 * raised_deg_s / rate_hz))
    assert math.degrees(rate[0]) == pytest.approx(turned_deg_s * level, abs=1e-6)
    assert math.degrees(rate[1]) == pytest.approx(0.5 * raised_deg_s, abs=1e-6)


@given(st.lists(st.integers(1, 60), min_size=3, max_size=12), st.floats(-40, 40), st.floats(-40, 40))
def test_it_has_that_speed_at_whatever_times_the_rays_come(
    gaps_ms: list[int], turned_deg_s: float, raised_deg_s: float
) -> None:
    steadiness = RaySpeedEstimator(0.15)
    time_ms, elevation = 0, 0.0
    for gap_ms in gaps_ms:
        time_ms += gap_ms
        elevation = math.radians(raised_deg_s * time_ms / 1000)
        steadiness.add(
            time_ms * 1_000_000, vector.direction(math.radians(turned_deg_s * time_ms / 1000), elevation)
        )
    rate = steadiness.rate()
    assert rate is not None
    assert math.degrees(rate[0]) == pytest.approx(turned_deg_s * math.cos(elevation), abs=1e-6)
    assert math.degrees(rate[1]) == pytest.approx(raised_deg_s, abs=1e-6)


@pytest.mark.parametrize("frequency_hz", [6.0, 7.5, 9.0, 10.5, 12.0])
def test_tremor_of_its_highest_rms_is_steady(frequency_hz: float) -> None:
    steadiness = RaySpeedEstimator(0.15)
    highest = 0.0
    for index in range(400):
        time_s = index / 100
        wiggle_deg = 0.1 * math.sqrt(2.0) * math.sin(2 * math.pi * frequency_hz * time_s)
        steadiness.add(round(time_s * S), vector.direction(math.radians(wiggle_deg), -0.3))
        if index > 20:
            highest = max(highest, speed_deg_s(steadiness))
    assert highest < 4.0  # the momentary speed goes up to 10.7 degrees/s


def test_a_single_wrong_sample_changes_little() -> None:
    steadiness = RaySpeedEstimator(0.15)
    for index in range(100):
        wrong = 0.3 if index == 95 else 0.0
        steadiness.add(index * S // 100, vector.direction(wrong, -0.3))
        if index > 1:
            assert speed_deg_s(steadiness) < 1e-9


def test_one_ray_has_no_speed_and_two_have_whatever_the_rate() -> None:
    steadiness = RaySpeedEstimator(0.15)
    assert steadiness.rate() is None
    steadiness.add(0, (1.0, 0.0, 0.0))
    assert steadiness.rate() is None
    steadiness.add(S // 5, vector.direction(math.radians(1.0), 0.0))
    assert speed_deg_s(steadiness) == pytest.approx(5.0)
    steadiness.clear()
    assert steadiness.rate() is None


def test_rays_a_nanosecond_apart_have_a_speed() -> None:
    steadiness = RaySpeedEstimator(0.15)
    for index in range(4):
        steadiness.add(1_700_000_000 * S + index, vector.direction(math.radians(1e-6 * index), 0.0))
    assert speed_deg_s(steadiness) == pytest.approx(1000.0, rel=1e-6)


@pytest.mark.parametrize("turned_deg_s", [10.0, -10.0])
def test_speed_does_not_jump_where_the_azimuth_does(turned_deg_s: float) -> None:
    steadiness = RaySpeedEstimator(0.15)
    for index in range(11):
        turned_deg = 180.0 + turned_deg_s * (index - 5) / 100
        steadiness.add(index * S // 100, vector.direction(math.radians(turned_deg), 0.0))
    rate = steadiness.rate()
    assert rate is not None
    assert math.degrees(rate[0]) == pytest.approx(turned_deg_s)
