"""When frames are drawn: fresh cursors at once, no more than the cap, nobody waits for ever."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.led_driver.pacing import FrameLimiter


def test_the_pacer_draws_cursors_as_they_come_and_the_rest_with_them() -> None:
    pacer = FrameLimiter(50.0, 0.03)
    assert pacer.request_frame(10.0, fresh=True) == 0.0
    pacer.drawn(10.0)
    assert pacer.request_frame(10.005, fresh=False) == pytest.approx(0.03)
    assert pacer.request_frame(10.010, fresh=True) is None  # too early: waits for the next one
    assert pacer.request_frame(10.016, fresh=True) == 0.0  # early within the slack
    pacer.drawn(10.016)
    assert pacer.request_frame(10.030, fresh=True) == pytest.approx(
        0.03
    )  # no next one comes: drawn all the same
    pacer.drawn(10.060)
    assert pacer.request_frame(10.2, fresh=True) == 0.0


@given(
    st.lists(st.tuples(st.floats(0.0, 0.05), st.booleans()), min_size=1, max_size=200),
    st.floats(10, 200),
    st.floats(0, 0.05),
)
def test_frames_stay_below_the_cap_and_no_wish_waits_longer_than_patience(
    wishes: list[tuple[float, bool]], rate_hz: float, patience_s: float
) -> None:
    pacer = FrameLimiter(rate_hz, patience_s)
    period_s = 1.0 / rate_hz
    now_s, due_s = 0.0, None
    drawn: list[float] = []

    def draw(at_s: float) -> None:
        pacer.drawn(at_s)
        drawn.append(at_s)
        for back in range(1, len(drawn)):
            assert drawn[-1] - drawn[-1 - back] >= (back - 0.5) * period_s - 1e-9

    for gap, fresh in wishes:
        now_s += gap
        if due_s is not None and due_s <= now_s:
            draw(due_s)
            due_s = None
        wait_s = pacer.request_frame(now_s, fresh=fresh)
        if wait_s == 0.0:
            draw(now_s)
            due_s = None
        elif wait_s is not None:
            assert wait_s <= max(patience_s, 1.25 * period_s) + 1e-9
            due_s = now_s + wait_s
        else:
            assert due_s is not None
