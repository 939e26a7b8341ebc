"""The gauge: filling, draining, firing once, latching, gaps; and the speed of the ray that fills it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.services.selector.methods.gauge import Gauges, RaySpeedEstimator
from tests.support import there

MS = 1_000_000


def new() -> Gauges:
    """Return empty gauges, full after 0.8 s, that drain at half the rate."""
    return Gauges(longest_gap_s=0.25, full_s=0.8)


def run(
    gauges: Gauges, times_ms: list[int], hovered: str | None, *, full_s: float = 0.8, fills: bool = True
) -> list[int]:
    fired: list[int] = []
    for time_ms in times_ms:
        near = (hovered,) if hovered else ()
        if gauges.step(time_ms * MS, hovered, fills=fills, full_s=full_s, not_left=near):
            fired.append(time_ms)
    return fired


def every(step_ms: int, start_ms: int, end_ms: int) -> list[int]:
    return list(range(start_ms, end_ms + 1, step_ms))


@given(st.integers(1, 240), st.integers(50, 3000))
def test_any_rate_fires_at_the_first_cursor_from_its_time_on(step_ms: int, full_ms: int) -> None:
    fired = run(new(), every(step_ms, 0, 5000), "a", full_s=full_ms / 1000)
    assert len(fired) == 1
    assert full_ms <= fired[0] < full_ms + step_ms


def test_it_stays_as_it_is_while_the_ray_moves_fast() -> None:
    gauges = new()
    run(gauges, every(10, 0, 400), "a")
    run(gauges, every(10, 410, 2000), "a", fills=False)
    assert gauges.fill("a") == pytest.approx(0.5)
    assert run(gauges, every(10, 2010, 3000), "a") == [2400]


def test_others_drain_at_half_the_rate() -> None:
    gauges = new()
    run(gauges, every(10, 0, 400), "a")
    run(gauges, every(10, 410, 800), "b")
    assert gauges.fill("a") == pytest.approx(0.25)
    assert gauges.filled_s("a") == pytest.approx(0.2)
    assert gauges.fill("b") == pytest.approx(0.5)
    run(gauges, every(10, 810, 1200), None)
    assert gauges.fill("a") == pytest.approx(0.0)
    assert gauges.fill("b") == pytest.approx(0.25)


def test_nothing_fills_in_a_gap_and_everything_drains() -> None:
    gauges = new()
    run(gauges, every(10, 0, 400), "a")
    assert run(gauges, [800], "a") == []
    assert gauges.fill("a") == pytest.approx(0.25)


def test_a_fired_gauge_fills_again_once_it_was_left_long_enough() -> None:
    gauges = new()
    assert run(gauges, every(10, 0, 1000), "a") == [800]
    run(gauges, every(10, 1010, 1300), None)
    assert run(gauges, every(10, 1310, 3000), "a") == []  # left for 0.29 s
    run(gauges, every(10, 3010, 3310), None)
    assert run(gauges, every(10, 3320, 5000), "a") == [4110]


def test_time_without_cursors_is_not_leaving_even_between_times_away() -> None:
    gauges = new()
    assert run(gauges, every(10, 0, 1000), "a") == [800]
    run(gauges, every(10, 1010, 1100), None)
    run(gauges, every(10, 1500, 1590), None)  # away for 0.09 s, twice
    assert run(gauges, every(10, 1600, 4000), "a") == []


@given(
    st.lists(st.tuples(st.integers(1, 400), st.sampled_from(["a", "b", None]), st.booleans()), max_size=200)
)
def test_no_sequence_breaks_its_bounds(steps: list[tuple[int, str | None, bool]]) -> None:
    gauges = new()
    time_ms = 0
    last: dict[str, int] = {}
    for passed_ms, hovered, fills in steps:
        time_ms += passed_ms
        near = (hovered,) if hovered else ()
        fired = gauges.step(time_ms * MS, hovered, fills=fills, full_s=0.5, not_left=near)
        for object_id in ("a", "b"):
            assert 0.0 <= gauges.fill(object_id) < 1.0
        if fired is not None:
            assert fired == hovered
            # between two firings lie the time to leave and the time to fill
            assert time_ms - last.get(fired, -10_000) >= 700
            last[fired] = time_ms


S = 1_000_000_000


def speed_deg_s(steadiness: RaySpeedEstimator) -> float:
    return math.degrees(math.hypot(*there(steadiness.rate())))


@given(st.lists(st.integers(1, 60), min_size=3, max_size=12), st.floats(-40, 40), st.floats(-40, 40))
def test_it_has_that_speed_at_whatever_times_the_rays_come(
    gaps_ms: list[int], turned_deg_s: float, raised_deg_s: float
) -> None:
    steadiness = RaySpeedEstimator(0.15)
    time_ms = 0
    elevation = 0.0
    for gap_ms in gaps_ms:
        time_ms += gap_ms
        elevation = math.radians(raised_deg_s * time_ms / 1000)
        steadiness.add(
            time_ms * 1_000_000, vector.direction(math.radians(turned_deg_s * time_ms / 1000), elevation)
        )
    rate = there(steadiness.rate())
    assert math.degrees(rate[0]) == pytest.approx(turned_deg_s * math.cos(elevation), abs=1e-6)
    assert math.degrees(rate[1]) == pytest.approx(raised_deg_s, abs=1e-6)


@pytest.mark.parametrize("frequency_hz", [6.0, 12.0])
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
    assert math.degrees(there(steadiness.rate())[0]) == pytest.approx(turned_deg_s)
