"""Pixels that a request shows instead of the picture, for a while."""

import pytest

from pointit.runtime.errors import RequestError
from pointit.schemas import LitPixels, ShowPixels
from pointit.schemas import topics as at
from tests.unit.led_driver.driving import MAP_MESSAGE, cursor, driven, next_frame, pixels

MARK = LitPixels(id="a", pixels=(3,), color=(0, 128, 0))


async def test_shown_pixels_replace_cursors_until_their_time_is_over() -> None:
    async with driven() as (bench, clock, frames):
        bench.put(at.CURSOR, cursor(clock, 0.55, "b"), "anna")
        assert pixels(await next_frame(frames), "b")
        count = len(frames)
        await bench.bus.call(at.SHOW_PIXELS, ShowPixels(lit=(MARK,), for_s=0.2))
        shown = frames[count]
        assert pixels(shown, "a") == {3: (0, 128, 0)}
        assert not pixels(shown, "b")
        clock.advance(0.21)
        bench.put(at.CURSOR, cursor(clock, 0.55, "b"), "anna")
        after = await next_frame(frames)
        assert not pixels(after, "a")
        assert pixels(after, "b")


async def test_strips_are_given_back_without_another_message() -> None:
    async with driven() as (bench, clock, frames):
        await bench.bus.call(at.SHOW_PIXELS, ShowPixels(lit=(MARK,), for_s=0.05))
        assert pixels(frames[-1], "a")
        clock.advance(0.05)
        assert not pixels(await next_frame(frames), "a")


async def test_new_map_ends_what_was_shown() -> None:
    async with driven() as (bench, _clock, frames):
        await bench.bus.call(at.SHOW_PIXELS, ShowPixels(lit=(MARK,), for_s=60))
        bench.put(at.MAP, MAP_MESSAGE.model_copy(update={"stamp_ns": 2}))
        assert not pixels(await next_frame(frames), "a")


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (LitPixels(id="c", pixels=(), color=(1, 2, 3)), "there is no strip 'c'; there are a, b"),
        (LitPixels(id="a", pixels=(0, 20), color=(1, 2, 3)), "a has no pixel 20; its pixels are 0 to 19"),
    ],
)
async def test_pixels_that_do_not_fit_the_map_are_refused(wrong: LitPixels, sentence: str) -> None:
    async with driven() as (bench, _clock, _frames):
        with pytest.raises(RequestError, match=sentence):
            await bench.bus.call(at.SHOW_PIXELS, ShowPixels(lit=(wrong,)))
