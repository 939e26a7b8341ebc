"""When frames are drawn: fresh cursors at once, no more than the cap, nobody waits for ever."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import NS_PER_S, Cursor, Passed, UserProfile
from pointit.schemas.topics import CURSOR
from pointit.services.led_driver.light_state import FrameLimiter, LightState
from tests.support import there
from tests.unit.led_driver.driving import FAST, MAP_MESSAGE, cursor, driven, next_frame, pixels


def test_limiter_draws_cursors_at_once_and_other_changes_with_them() -> None:
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
def test_limiter_keeps_the_rate_and_no_request_exceeds_the_timeout(
    wishes: list[tuple[float, bool]], rate_hz: float, patience_s: float
) -> None:
    pacer = FrameLimiter(rate_hz, patience_s)
    period_s = 1.0 / rate_hz
    now_s = 0.0
    due_s = None
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


def passing(stamp_ns: int, position_m: float, strip_id: str = "a") -> Cursor:
    passed = Passed(
        surface="strip",
        surface_id=strip_id,
        point_m=(position_m, 0.0, 0.0),
        position_m=position_m,
        right_rad=0.0,
        up_rad=0.3,
    )
    return Cursor(stamp_ns=stamp_ns, passed=passed)


@pytest.mark.parametrize("strip_id", ["a", "b"])
def test_nearest_pixel_blinks_dim_when_a_person_points_past_everything(strip_id: str) -> None:
    lights = LightState(FAST)
    lights.on_map(MAP_MESSAGE)
    lights.content.set_profile("anna", UserProfile(stamp_ns=0, cursor_color=(200, 100, 0)))
    seen: list[dict[int, tuple[int, ...]]] = []
    for step in range(200):
        now_ns = step * NS_PER_S // 100
        assert lights.on_cursor("anna", passing(now_ns, 2.0, strip_id), now_ns) == (step == 0)
        seen.append(pixels(there(lights.frame(now_ns)), strip_id))
    last = 19 if strip_id == "a" else 0  # the other runs backwards
    assert all(each in ({}, {last: (100, 50, 0)}) for each in seen)
    changes = sum(before != after for before, after in pairwise(seen))
    assert changes == 3  # on, off, on, off in 2 s: 1 Hz


async def test_cursor_past_everything_requests_no_immediate_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    wished: list[bool] = []
    wish = FrameLimiter.request_frame

    def noted(pacer: FrameLimiter, now_s: float, *, fresh: bool) -> float | None:
        wished.append(fresh)
        return wish(pacer, now_s, fresh=fresh)

    monkeypatch.setattr(FrameLimiter, "request_frame", noted)
    async with driven() as (bench, clock, frames):
        wished.clear()
        for message in (passing(clock.now_ns(), 1.55), cursor(clock, 1.05)):
            bench.put(CURSOR, message, "anna")
            await next_frame(frames)
        assert wished == [False, True]


def test_frame_is_requested_when_the_nearest_pixel_changes_or_blinks() -> None:
    lights = LightState(FAST)
    lights.on_map(MAP_MESSAGE)
    now_ns = 3 * NS_PER_S + NS_PER_S // 5
    timeout_ns = now_ns + int(FAST.cursor_timeout_s * NS_PER_S)
    assert lights.on_cursor("anna", passing(now_ns, 1.01), now_ns)
    lights.frame(now_ns)
    assert lights.content.next_change_ns() == 3 * NS_PER_S + NS_PER_S // 2
    assert not lights.on_cursor("anna", passing(now_ns, 1.09), now_ns)  # the same pixel
    assert lights.on_cursor("anna", passing(now_ns, 1.11), now_ns)
    assert lights.on_cursor("anna", passing(now_ns, 1.11, "b"), now_ns)
    assert lights.on_cursor("anna", passing(now_ns, 1.11, "of another map"), now_ns)  # none
    lights.frame(now_ns)
    assert lights.content.next_change_ns() == timeout_ns
    assert not lights.on_cursor("anna", passing(now_ns, 1.5, "of another map"), now_ns)
