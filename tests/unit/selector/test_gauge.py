"""Gauges by themselves: filling, draining, firing once, latching, gaps."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.selector.methods.gauge import Gauges

MS = 1_000_000


def new() -> Gauges:
    """Return empty gauges, full after 0.8 s, that drain at half the rate."""
    return Gauges(drain_share=0.5, leave_s=0.3, longest_gap_s=0.25, full_s=0.8)


def run(
    gauges: Gauges, times_ms: list[int], hovered: str | None, *, full_s: float = 0.8, fills: bool = True
) -> list[int]:
    """Hover at `times_ms`; return when it fired."""
    fired: list[int] = []
    for time_ms in times_ms:
        near = (hovered,) if hovered else ()
        if gauges.step(time_ms * MS, hovered, fills=fills, full_s=full_s, near=near):
            fired.append(time_ms)
    return fired


def every(step_ms: int, start_ms: int, end_ms: int) -> list[int]:
    return list(range(start_ms, end_ms + 1, step_ms))


@pytest.mark.parametrize("step_ms", [5, 10, 20, 40, 100])
def test_a_gauge_is_full_after_its_time_and_fires_once(step_ms: int) -> None:
    assert run(new(), every(step_ms, 0, 5000), "a") == [800]


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


def test_a_gap_is_not_leaving() -> None:
    gauges = new()
    assert run(gauges, every(10, 0, 1000), "a") == [800]
    run(gauges, [1500], None)
    assert run(gauges, every(10, 1510, 4000), "a") == []


def test_time_without_cursors_is_not_leaving_even_between_times_away() -> None:
    gauges = new()
    assert run(gauges, every(10, 0, 1000), "a") == [800]
    run(gauges, every(10, 1010, 1100), None)
    run(gauges, every(10, 1500, 1590), None)  # away for 0.09 s, twice
    assert run(gauges, every(10, 1600, 4000), "a") == []


def test_latched_by_hand_it_does_not_fill() -> None:
    gauges = new()
    run(gauges, every(10, 0, 700), "a")
    gauges.latch("a")
    assert run(gauges, every(10, 710, 4000), "a") == []
    assert gauges.fill("a") == 0.0


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
        fired = gauges.step(time_ms * MS, hovered, fills=fills, full_s=0.5, near=near)
        for object_id in ("a", "b"):
            assert 0.0 <= gauges.fill(object_id) < 1.0
        if fired is not None:
            assert fired == hovered
            # between two firings lie the time to leave and the time to fill
            assert time_ms - last.get(fired, -10_000) >= 700
            last[fired] = time_ms
