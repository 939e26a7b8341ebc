"""Rate limit of a route."""

from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.routing.rate_limit import RateLimiter


def test_without_a_rate_nothing_waits() -> None:
    pace = RateLimiter(None)
    for now_s in (0.0, 0.0, 1.0):
        assert pace.wait_s(now_s) == 0.0
        pace.sent(now_s)


def test_what_comes_too_soon_waits_for_the_rest_of_the_period() -> None:
    pace = RateLimiter(10.0)
    pace.sent(5.0)
    assert 0.06 < pace.wait_s(5.01) < 0.09


def test_a_source_of_the_same_rate_is_never_held_up() -> None:
    pace = RateLimiter(50.0)
    for count in range(1000):
        now_s = 7.0 + count * 0.02 + (0.002 if count % 2 else -0.002)  # jitter of a tenth
        assert pace.wait_s(now_s) == 0.0
        pace.sent(now_s)


@given(st.lists(st.floats(0.0, 0.05), min_size=200, max_size=400))
def test_no_more_than_the_rate_in_the_long_run(gaps_s: list[float]) -> None:
    pace, now_s, sent = RateLimiter(20.0), 100.0, 0
    for gap_s in gaps_s:
        now_s += gap_s
        if pace.wait_s(now_s) == 0.0:
            pace.sent(now_s)
            sent += 1
    assert sent <= (now_s - 100.0) * 20.0 + 2.0
