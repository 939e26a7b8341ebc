"""Rates, by hand and by property."""

import math
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.cli.inspect.hz import RateMeter


def test_a_regular_stream() -> None:
    meter = RateMeter("objects", 25)
    for k in range(51):
        meter.add(100 + k * 0.04, 30)
    rate = meter.take(102.02, 2.02)
    assert rate.key == "objects"
    assert rate.nominal_hz == 25
    assert rate.messages == 51
    assert rate.rate_hz == pytest.approx(25)
    assert rate.period_min_s == pytest.approx(0.04)
    assert rate.period_max_s == pytest.approx(0.04)
    assert rate.jitter_s == pytest.approx(0, abs=1e-6)
    assert rate.bytes_per_s == pytest.approx(51 * 30 / 2.02)


def test_one_message_has_no_rate() -> None:
    meter = RateMeter("map")
    meter.add(1.0, 10)
    rate = meter.take(6.0, 5.0)
    assert (rate.messages, rate.rate_hz, rate.period_max_s, rate.jitter_s) == (1, None, None, None)
    assert meter.take(11.0, 5.0).messages == 0


def test_a_stream_that_stops_shows_its_silence() -> None:
    meter = RateMeter("objects")
    for k in range(10):
        meter.add(k * 0.1, 1)
    assert meter.take(5.0, 5.0).period_max_s == pytest.approx(4.1)


def test_the_period_across_two_windows_counts_in_the_second() -> None:
    meter = RateMeter("objects")
    for time_s in (0.0, 1.0):
        meter.add(time_s, 1)
    meter.take(1.5, 1.5)
    meter.add(3.0, 1)
    rate = meter.take(3.0, 1.5)
    assert rate.messages == 1
    assert rate.period_max_s == pytest.approx(2.0)


@given(st.lists(st.floats(1e-3, 10), min_size=1, max_size=50))
def test_the_account_is_that_of_all_periods(periods_s: list[float]) -> None:
    meter = RateMeter("objects")
    now_s = 1e3
    meter.add(now_s, 0)
    for period_s in periods_s:
        now_s += period_s
        meter.add(now_s, 0)
    rate = meter.take(now_s, 1.0)
    assert rate.rate_hz is not None
    assert rate.jitter_s is not None
    assert math.isclose(rate.rate_hz, len(periods_s) / sum(periods_s), rel_tol=1e-6)
    assert math.isclose(rate.jitter_s, statistics.pstdev(periods_s), rel_tol=1e-6, abs_tol=1e-6)
