"""The service: what makes it draw, how often, what vanishes when, and what it asks of a frame's stamp."""

import asyncio

import pytest

from pointit.runtime.errors import RequestError
from pointit.schemas import (
    FARTHEST,
    Cursor,
    Environment,
    Hover,
    Lamp,
    LampMiss,
    Localization,
    SelectedObject,
    Selection,
    SetBrightness,
    Strip,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.schemas import topics as at
from pointit.services.led_driver.lamps import DARK
from pointit.services.led_driver.render import Layout
from pointit.services.led_driver.service import LedDriver
from pointit.services.led_driver.strip_content import StripContent
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.led_driver.driving import (
    FAST,
    MAP_MESSAGE,
    cursor,
    driven,
    next_frame,
    package,
    pixels,
    started,
)

MAP_WITH_LAMP = MAP_MESSAGE.model_copy(update={"lamps": (Lamp(id="a", position_m=(0.0, 0.0, 1.0)),)})


async def test_cursor_is_drawn_at_once_with_its_own_stamp() -> None:
    async with driven() as (bench, clock, frames):
        assert frames[0].stamp_ns == clock.now_ns()
        await asyncio.sleep(0.005)
        bench.put(at.PROFILE, UserProfile(stamp_ns=1, cursor_color=(1, 2, 3), cursor_width_m=0.3), "anna")
        await next_frame(frames)
        newest = cursor(clock, 0.55)
        bench.put(at.CURSOR, newest, "anna")
        frame = await next_frame(frames)
        assert pixels(frame, "a") == {4: (1, 2, 3), 5: (1, 2, 3), 6: (1, 2, 3)}
        assert frame.stamp_ns == newest.stamp_ns
        bench.put(at.CURSOR, cursor(clock, 0.55, "b"), "anna")
        assert set(pixels(await next_frame(frames), "b")) == {13, 14, 15}


def test_cursor_without_a_point_requests_one_dark_frame_only() -> None:
    """Else who rests takes the place in time of who points: their light came a period late."""
    scene = StripContent(FAST)
    nowhere = Cursor(stamp_ns=1)
    on_strip = Cursor(stamp_ns=2, surface="strip", surface_id="a", point_m=(0.0, 0.0, 0.0))
    assert not scene.set_cursor("anna", nowhere, 1)
    assert scene.set_cursor("anna", on_strip, 2)
    assert not scene.set_cursor("ben", nowhere, 2)
    assert scene.set_cursor("anna", nowhere, 3)  # it goes dark
    assert not scene.set_cursor("anna", nowhere, 4)


async def test_cursor_gives_its_stamp_to_one_frame_only() -> None:
    """Else a wrist that fell silent looks like latency as long as its cursor is lit."""
    async with driven() as (bench, clock, frames):
        bench.put(at.CURSOR, cursor(clock, 0.55), "anna")
        assert (await next_frame(frames)).stamp_ns == clock.now_ns() - 5_000_000
        clock.advance(0.3)
        bench.put(at.PROFILE, UserProfile(stamp_ns=1, cursor_color=(1, 2, 3)), "anna")
        frame = await next_frame(frames)
        assert pixels(frame, "a")[5] == (1, 2, 3)  # still lit
        assert frame.stamp_ns == clock.now_ns()


async def test_objects_move_on_between_messages_and_show_their_state() -> None:
    async with driven() as (bench, clock, frames):
        bench.put(at.OBJECTS, package(clock, speed_mps=1.0), "conveyor")
        assert set(pixels(await next_frame(frames), "a")) == {3, 4, 5, 6}
        clock.advance(0.2)
        bench.put(
            at.SELECTION, Selection(stamp_ns=1, objects=(SelectedObject(id="p1", user="x", since_ns=1),))
        )
        frame = await next_frame(frames)
        assert pixels(frame, "a") == {5: (255, 255, 255), 6: (200, 0, 0), 7: (200, 0, 0), 8: (255, 255, 255)}
        assert frame.stamp_ns == clock.now_ns()

        bench.put(at.PROFILE, UserProfile(stamp_ns=1, cursor_color=(9, 9, 9)), "anna")
        await next_frame(frames)
        bench.put(at.HOVER, Hover(stamp_ns=1, object_id="p1", progress=0.0), "anna")
        shown = pixels(await next_frame(frames), "a")
        assert (shown[5], shown[8]) == ((255, 255, 255), (9, 9, 9))  # one pixel at each end has to do


async def test_object_of_a_slow_tracker_moves_on_between_messages() -> None:
    async with driven() as (bench, clock, frames):
        bench.put(at.OBJECTS, package(clock, speed_mps=1.0), "conveyor")
        assert set(pixels(await next_frame(frames), "a")) == {3, 4, 5, 6}
        for _ in range(4):
            clock.advance(0.05)
            await asyncio.sleep(0.05)
        assert set(pixels(frames[-1], "a")) == {5, 6, 7, 8}


async def test_hover_of_no_object_causes_no_frame_when_repeated() -> None:
    async with driven() as (bench, _clock, frames):
        for object_id in ("p1", ""):
            bench.put(at.HOVER, Hover(stamp_ns=1, object_id=object_id), "anna")
            await next_frame(frames)
        count = len(frames)
        for _ in range(10):
            bench.put(at.HOVER, Hover(stamp_ns=1), "anna")
            await asyncio.sleep(0.02)
        assert len(frames) == count


async def test_trackers_do_not_take_each_others_objects_away() -> None:
    async with driven() as (bench, clock, frames):
        bench.put(at.OBJECTS, package(clock), "one")
        await next_frame(frames)
        bench.put(at.OBJECTS, TrackedObjects(stamp_ns=clock.now_ns()), "two")
        assert pixels(await next_frame(frames), "a")
        bench.put(at.OBJECTS, TrackedObjects(stamp_ns=clock.now_ns()), "one")
        assert not pixels(await next_frame(frames), "a")


async def test_silent_cursors_and_objects_vanish_by_themselves() -> None:
    config = FAST.model_copy(update={"cursor_timeout_s": 0.1, "objects_timeout_s": 0.2})
    async with driven(config) as (bench, clock, frames):
        bench.put(at.OBJECTS, package(clock), "conveyor")
        bench.put(at.CURSOR, cursor(clock, 1.5), "anna")
        await until(lambda: {3, 15} <= set(pixels(frames[-1], "a")))
        clock.advance(0.15)
        await until(lambda: max(pixels(frames[-1], "a"), default=0) == 6)
        clock.advance(0.1)
        await until(lambda: not pixels(frames[-1], "a"))


async def test_request_sets_the_brightness() -> None:
    async with driven() as (bench, clock, frames):
        reports = bench.collect(at.HEALTH)

        def shown() -> dict[str, float]:
            return {figure.name: figure.value for figure in reports[-1].figures} if reports else {}

        await until(lambda: shown() == {"brightness": 1.0, "default brightness": 1.0})
        bench.put(at.CURSOR, cursor(clock, 0.5), "anna")
        assert max(pixels(await next_frame(frames), "a").values()) == (255, 255, 255)
        reply = await bench.bus.call(at.SET_BRIGHTNESS, SetBrightness(brightness=0.2))
        assert "20%" in reply.message
        await until(lambda: max(pixels(frames[-1], "a").values()) == (51, 51, 51))
        await until(lambda: shown() == {"brightness": 0.2, "default brightness": 1.0})
        await bench.bus.call(at.SET_BRIGHTNESS, SetBrightness(brightness=1.0, strips=("a",)))
        await until(lambda: max(pixels(frames[-1], "a").values()) == (255, 255, 255))
        with pytest.raises(RequestError, match="there is no strip 'x'"):
            await bench.bus.call(at.SET_BRIGHTNESS, SetBrightness(brightness=1.0, strips=("x",)))


async def test_unknown_colormap_is_said_until_another_is_chosen() -> None:
    async with driven() as (bench, _clock, frames):
        reports = bench.collect(at.HEALTH)
        bench.put(at.PROFILE, UserProfile(stamp_ns=1, cursor_colormap="rainbow"), "anna")
        await until(lambda: bool(reports) and any("no colormap 'rainbow'" in w for w in reports[-1].warnings))
        bench.put(at.PROFILE, UserProfile(stamp_ns=1, cursor_colormap="viridis"), "anna")
        await until(lambda: not reports[-1].warnings)
        assert frames


async def test_lamp_colours_are_published_on_change_and_end_dark() -> None:
    clock = ManualClock()
    told: list[tuple[str, tuple[int, ...]]] = []
    async with memory_bench(clock) as bench:
        bench.bus.subscribe(at.LAMP_COLOR, lambda news, lamp: told.append((lamp, news.color)))
        await started(bench)
        bench.put(at.MAP, MAP_WITH_LAMP)
        near = cursor(clock, 0.5).model_copy(update={"lamps": (LampMiss(id="a", miss_rad=0.0),)})
        bench.put(at.CURSOR, near, "anna")
        await until(lambda: dict(told).get("a", DARK) != DARK)

        count = len(told)
        for _ in range(3):
            bench.put(at.CURSOR, near, "anna")
            await asyncio.sleep(0.06)
        assert len(told) == count  # nothing changed

        bench.put(at.LOCALIZATION, Localization(stamp_ns=1, phase="sampling", target_id="robot"), "ben")
        await until(lambda: dict(told)["a"] == (0, 0, 0), what="darkness")
        count = len(told)
        bench.put(at.CURSOR, cursor(clock, 0.5), "anna")
        await asyncio.sleep(0.06)
        assert len(told) == count

        bench.put(at.CURSOR, near, "anna")
        bench.put(at.LOCALIZATION, Localization(stamp_ns=1, phase="solved"), "ben")
        await until(lambda: "a" in {lamp for lamp, _ in told[count:]}, what="lamp a again")

    assert dict(told) == {"a": (0, 0, 0)}


async def test_lamps_change_twenty_times_a_second_at_most() -> None:
    clock = ManualClock()
    told: list[float] = []
    async with memory_bench(clock) as bench:
        loop = asyncio.get_running_loop()
        bench.bus.subscribe(at.LAMP_COLOR, lambda _news, _lamp: told.append(loop.time()))
        await started(bench)
        bench.put(at.MAP, MAP_WITH_LAMP)
        began_s = loop.time()
        for step in range(200):
            lamps = (LampMiss(id="a", miss_rad=step % 50 / 100),)
            bench.put(at.CURSOR, cursor(clock, 0.5).model_copy(update={"lamps": lamps}), "anna")
            clock.advance(0.002)
            await asyncio.sleep(0.002)
        assert 2 <= len(told) <= (loop.time() - began_s) * 20 + 2


async def test_driver_draws_nothing_without_a_map_and_reports_broken_ones() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames = bench.collect(at.STRIPS_FRAME)
        reports = bench.collect(at.HEALTH)
        bench.start(LedDriver, FAST)
        await bench.settle()
        bench.put(at.CURSOR, cursor(clock, 0.5), "anna")
        broken = Strip(id="a", line_m=((0, 0, 0), (0, 0, 0)), pixels=20)
        bench.put(at.MAP, Environment(stamp_ns=1, name="bad", strips=(broken,)))
        await until(lambda: bool(reports) and any("map bad" in text for text in reports[-1].warnings))
        assert not frames


@pytest.mark.parametrize("value", [FARTHEST, -FARTHEST, 5e-324])
async def test_numbers_nobody_can_calculate_with_blind_nobody(value: float) -> None:
    async with driven() as (bench, clock, frames):
        health = bench.collect(at.HEALTH)
        nonsense = TrackedObject(
            id="evil",
            kind="red",
            position_m=(value, value, value),
            surface="strip",
            surface_id="a",
            surface_position_m=-value * FARTHEST,
            surface_speed_mps=value,
            length_m=abs(value),
        )
        bench.put(at.OBJECTS, TrackedObjects(stamp_ns=clock.now_ns() - 1, objects=(nonsense,)), "x")
        bench.put(at.CURSOR, cursor(clock, value * FARTHEST), "eve")

        bench.put(at.CURSOR, cursor(clock, 0.5), "anna")
        await until(lambda: any(5 in pixels(frame, "a") for frame in frames), what="anna's cursor")
        point = Strip(id="a", line_m=((0.0, 0.0, 0.0), (5e-324, 0.0, 0.0)), pixels=5)
        bench.put(at.MAP, Environment(stamp_ns=0, name="evil", strips=(point,)))
        await until(lambda: any("cannot be drawn" in text for h in health for text in h.warnings))
        assert not any(each.errors for each in health)


def test_clock_that_is_ahead_does_not_move_objects_backwards() -> None:
    clock = ManualClock()
    scene = StripContent(FAST)
    scene.set_layout(Layout(MAP_MESSAGE.strips))
    scene.set_objects("conveyor", package(clock, speed_mps=1.0), clock.now_ns())
    assert scene.segments(clock.now_ns() - 500_000_000).at_m[0] == 0.5
    assert scene.segments(clock.now_ns() + 100_000_000).at_m[0] == pytest.approx(0.6)
