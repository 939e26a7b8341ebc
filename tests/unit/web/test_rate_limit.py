"""Token bucket."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.web.pages.rate_limit import TokenBucket


def test_a_bucket_lets_a_burst_pass_and_then_its_rate() -> None:
    bucket = TokenBucket(20.0, 40.0)
    assert sum(bucket.take(5.0) for _ in range(100)) == 40
    assert bucket.wait_s(5.0) == pytest.approx(1 / 20)
    assert sum(bucket.take(5.0 + k / 1000) for k in range(1, 1001)) == 20


@given(st.lists(st.floats(0, 10), max_size=200), st.floats(0.5, 50), st.integers(1, 50))
def test_no_more_passes_than_rate_and_burst_allow(times: list[float], rate_hz: float, burst: int) -> None:
    bucket = TokenBucket(rate_hz, float(burst))
    passed = sum(bucket.take(now_s) for now_s in sorted(times))
    assert passed <= burst + 10.0 * rate_hz + 1e-6
    assert passed >= min(len(times), burst)


def test_waiting_as_long_as_told_is_enough() -> None:
    bucket = TokenBucket(7.0, 1.0)
    now_s = 0.0
    for _ in range(100):
        now_s += bucket.wait_s(now_s) + 1e-9
        assert bucket.take(now_s)


def test_a_clock_that_goes_back_gives_nothing() -> None:
    bucket = TokenBucket(10.0, 1.0)
    assert bucket.take(100.0)
    assert not bucket.take(0.0)
    assert not bucket.take(100.0)
