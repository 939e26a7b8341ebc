"""The service: what makes it draw, how often, what vanishes when, and what it asks of a frame's stamp."""

import asyncio
from pathlib import Path

import pytest

from pointit.runtime import ConfigError, Context, MemoryBus, WallClock
from pointit.runtime.health import ServiceBus
from pointit.runtime.memory_bus import Exchange
from pointit.schemas import (
    FARTHEST,
    Cursor,
    Environment,
    Hover,
    LampMiss,
    Localization,
    SelectedObject,
    Selection,
    SetBrightness,
    Strip,
    StripsFrame,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.schemas.topics import (
    CURSOR,
    HEALTH,
    HOVER,
    LAMP_COLOR,
    LOCALIZATION,
    MAP,
    OBJECTS,
    PROFILE,
    SELECTION,
    SET_BRIGHTNESS,
    STRIPS_FRAME,
)
from pointit.services.led_driver.config import LedDriverConfig, OutputConfig, StyleConfig
from pointit.services.led_driver.layout import Layout
from pointit.services.led_driver.render import Renderer
from pointit.services.led_driver.scene import Scene
from pointit.services.led_driver.service import LedDriver
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.support.pty_device import Listener, pty_device

FAST = LedDriverConfig(
    max_rate_hz=1000, patience_s=0, style=StyleConfig(kind_colors={"red": (200, 0, 0)}, tail_s=0.0)
)
MAP_MESSAGE = Environment(
    stamp_ns=1,
    name="test",
    strips=(
        Strip(id="a", line_m=((0, 0, 0), (2, 0, 0)), pixels=20),
        Strip(id="b", line_m=((0, 0, 0), (2, 0, 0)), pixels=20, direction=-1),
    ),
)


def cursor(clock: ManualClock, position_m: float, strip_id: str = "a") -> Cursor:
    return Cursor(
        stamp_ns=clock.now_ns() - 5_000_000, surface="strip", surface_id=strip_id, position_m=position_m
    )


def package(clock: ManualClock, *, speed_mps: float = 0.0) -> TrackedObjects:
    item = TrackedObject(
        id="p1",
        kind="red",
        position_m=(0, 0, 0),
        length_m=0.4,
        surface="strip",
        surface_id="a",
        surface_position_m=0.5,
        surface_speed_mps=speed_mps,
    )
    return TrackedObjects(stamp_ns=clock.now_ns(), objects=(item,))


def pixels(frame: StripsFrame, strip_id: str) -> dict[int, tuple[int, ...]]:
    data = next(strip.rgb for strip in frame.strips if strip.id == strip_id)
    return {k: tuple(data[3 * k : 3 * k + 3]) for k in range(20) if any(data[3 * k : 3 * k + 3])}


async def started(bench: Bench, config: LedDriverConfig = FAST) -> list[StripsFrame]:
    frames = bench.collect(STRIPS_FRAME)
    bench.start(LedDriver, config)
    await bench.settle()
    bench.put(MAP, MAP_MESSAGE)
    await until(lambda: len(frames) == 1)
    return frames


async def next_frame(frames: list[StripsFrame]) -> StripsFrame:
    count = len(frames)
    await until(lambda: len(frames) > count)
    return frames[-1]


async def test_a_cursor_is_drawn_at_once_with_its_own_stamp() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames = await started(bench)
        assert frames[0].stamp_ns == clock.now_ns()
        await asyncio.sleep(0.005)
        bench.put(PROFILE, UserProfile(stamp_ns=1, cursor_color=(1, 2, 3), cursor_width_m=0.3), "anna")
        await next_frame(frames)
        newest = cursor(clock, 0.55)
        bench.put(CURSOR, newest, "anna")
        frame = await next_frame(frames)
        assert pixels(frame, "a") == {4: (1, 2, 3), 5: (1, 2, 3), 6: (1, 2, 3)}
        assert frame.stamp_ns == newest.stamp_ns
        bench.put(CURSOR, cursor(clock, 0.55, "b"), "anna")
        assert set(pixels(await next_frame(frames), "b")) == {13, 14, 15}


async def test_a_cursor_gives_its_stamp_to_one_frame_only() -> None:
    """Else a wrist that fell silent looks like latency as long as its cursor is lit."""
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames = await started(bench)
        bench.put(CURSOR, cursor(clock, 0.55), "anna")
        assert (await next_frame(frames)).stamp_ns == clock.now_ns() - 5_000_000
        clock.advance(0.3)
        bench.put(PROFILE, UserProfile(stamp_ns=1, cursor_color=(1, 2, 3)), "anna")
        frame = await next_frame(frames)
        assert pixels(frame, "a")[5] == (1, 2, 3)  # still lit
        assert frame.stamp_ns == clock.now_ns()


def fail(*_: object) -> None:
    raise ZeroDivisionError


async def test_a_fault_in_a_timed_draw_is_counted_and_the_next_is_drawn(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    clock = ManualClock()
    config = FAST.model_copy(update={"patience_s": 0.01})
    async with memory_bench(clock) as bench:
        health = bench.collect(HEALTH)
        frames = await started(bench, config)
        with monkeypatch.context() as broken:
            broken.setattr(Renderer, "render", fail)
            bench.put(OBJECTS, package(clock), "conveyor")  # waits for a cursor, then for the timer
            await until(lambda: "timer of led-driver failed" in caplog.text, what="the log")
        bench.put(CURSOR, cursor(clock, 0.55), "anna")
        assert pixels(await next_frame(frames), "a")
        await until(lambda: health[-1].errors == 1, what="the count in health")


async def test_objects_move_on_between_messages_and_show_their_state() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames = await started(bench)
        bench.put(OBJECTS, package(clock, speed_mps=1.0), "conveyor")
        assert set(pixels(await next_frame(frames), "a")) == {3, 4, 5, 6}
        clock.advance(0.2)
        bench.put(SELECTION, Selection(stamp_ns=1, objects=(SelectedObject(id="p1", user="x", since_ns=1),)))
        frame = await next_frame(frames)
        assert pixels(frame, "a") == {
            5: (255, 255, 255),
            6: (200, 0, 0),
            7: (200, 0, 0),
            8: (255, 255, 255),
        }
        assert frame.stamp_ns == clock.now_ns()
        bench.put(PROFILE, UserProfile(stamp_ns=1, cursor_color=(9, 9, 9)), "anna")
        await next_frame(frames)
        bench.put(HOVER, Hover(stamp_ns=1, object_id="p1", progress=0.0), "anna")
        shown = pixels(await next_frame(frames), "a")
        assert (shown[5], shown[8]) == ((255, 255, 255), (9, 9, 9))  # one pixel at each end has to do


async def test_trackers_do_not_take_each_others_objects_away() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames = await started(bench)
        bench.put(OBJECTS, package(clock), "one")
        await next_frame(frames)
        bench.put(OBJECTS, TrackedObjects(stamp_ns=1), "two")
        assert pixels(await next_frame(frames), "a")
        bench.put(OBJECTS, TrackedObjects(stamp_ns=1), "one")
        assert not pixels(await next_frame(frames), "a")


async def test_silent_cursors_and_objects_vanish_by_themselves() -> None:
    config = FAST.model_copy(update={"cursor_timeout_s": 0.1, "objects_timeout_s": 0.2})
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames = await started(bench, config)
        bench.put(OBJECTS, package(clock), "conveyor")
        bench.put(CURSOR, cursor(clock, 1.5), "anna")
        await until(lambda: {3, 15} <= set(pixels(frames[-1], "a")))
        clock.advance(0.15)
        await until(lambda: max(pixels(frames[-1], "a"), default=0) == 6)
        clock.advance(0.1)
        await until(lambda: not pixels(frames[-1], "a"))


async def test_brightness_by_request() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames = await started(bench)
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        assert max(pixels(await next_frame(frames), "a").values()) == (255, 255, 255)
        reply = await bench.bus.call(SET_BRIGHTNESS, SetBrightness(brightness=0.2))
        assert "20%" in reply.message
        await until(lambda: max(pixels(frames[-1], "a").values()) == (51, 51, 51))


async def test_an_unknown_colormap_is_said_until_another_is_chosen() -> None:
    async with memory_bench() as bench:
        reports = bench.collect(HEALTH)
        frames = await started(bench)
        bench.put(PROFILE, UserProfile(stamp_ns=1, cursor_colormap="rainbow"), "anna")
        await until(lambda: bool(reports) and any("no colormap 'rainbow'" in w for w in reports[-1].warnings))
        bench.put(PROFILE, UserProfile(stamp_ns=1, cursor_colormap="viridis"), "anna")
        await until(lambda: not reports[-1].warnings)
        assert frames


async def test_lamps_are_told_what_changes_and_are_dark_at_the_end() -> None:
    clock = ManualClock()
    told: list[tuple[str, tuple[int, ...]]] = []
    async with memory_bench(clock) as bench:
        bench.bus.subscribe(LAMP_COLOR, lambda news, lamp: told.append((lamp, news.color)))
        await started(bench, FAST.model_copy(update={"state_lamp": "state"}))
        await until(lambda: told == [("state", (40, 40, 40))])
        near = cursor(clock, 0.5).model_copy(update={"lamps": (LampMiss(id="a", miss_rad=0.0),)})
        bench.put(CURSOR, near, "anna")
        await until(lambda: {lamp for lamp, _ in told[1:]} == {"a", "state"})
        count = len(told)
        for _ in range(3):
            bench.put(CURSOR, near, "anna")
            await asyncio.sleep(0.06)
        assert len(told) == count  # nothing changed
        bench.put(LOCALIZATION, Localization(stamp_ns=1, phase="sampling", target_id="a"), "ben")
        await until(lambda: told[-1][1][0] == 0 < told[-1][1][2])  # the state lamp pulses
        count = len(told)
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        await asyncio.sleep(0.06)
        assert all(lamp == "state" for lamp, _ in told[count:])
        bench.put(LOCALIZATION, Localization(stamp_ns=1, phase="solved"), "ben")
        await bench.settle()
        count = len(told)
        clock.advance(0.1)
        await asyncio.sleep(0.06)
        clock.advance(0.2)
        await until(lambda: "a" in {lamp for lamp, _ in told[count:]}, what="lamp a again")
    assert dict(told) == {"a": (0, 0, 0), "state": (0, 0, 0)}


async def test_lamps_change_twenty_times_a_second_at_most() -> None:
    clock = ManualClock()
    told: list[float] = []
    async with memory_bench(clock) as bench:
        loop = asyncio.get_running_loop()
        bench.bus.subscribe(LAMP_COLOR, lambda _news, _lamp: told.append(loop.time()))
        await started(bench)
        began_s = loop.time()
        for step in range(200):
            lamps = (LampMiss(id="a", miss_rad=step % 50 / 100),)
            bench.put(CURSOR, cursor(clock, 0.5).model_copy(update={"lamps": lamps}), "anna")
            clock.advance(0.002)
            await asyncio.sleep(0.002)
        assert 2 <= len(told) <= (loop.time() - began_s) * 20 + 2


async def test_without_a_map_nothing_is_drawn_and_a_broken_one_is_said() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames, reports = bench.collect(STRIPS_FRAME), bench.collect(HEALTH)
        bench.start(LedDriver, FAST)
        await bench.settle()
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        broken = Strip(id="a", line_m=((0, 0, 0), (0, 0, 0)), pixels=20)
        bench.put(MAP, Environment(stamp_ns=1, name="bad", strips=(broken,)))
        await until(lambda: bool(reports) and any("map bad" in text for text in reports[-1].warnings))
        assert not frames


async def test_many_messages_make_few_frames_and_the_newest_wins() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames = await started(bench, FAST.model_copy(update={"max_rate_hz": 50.0}))
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        for sent in range(1, 400):
            bench.put(CURSOR, cursor(clock, sent % 20 / 10 + 0.05), "anna")
            await bench.settle(2)
        await until(lambda: 399 % 20 in pixels(frames[-1], "a"), what="the newest")
        assert len(frames) <= (loop.time() - began_s) * 50 + 3


@pytest.mark.parametrize("value", [FARTHEST, -FARTHEST, 5e-324])
async def test_numbers_nobody_can_calculate_with_blind_nobody(value: float) -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        health = bench.collect(HEALTH)
        frames = await started(bench)
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
        bench.put(OBJECTS, TrackedObjects(stamp_ns=clock.now_ns() - 1, objects=(nonsense,)), "x")
        bench.put(CURSOR, cursor(clock, value * FARTHEST), "eve")
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        await until(lambda: any(5 in pixels(frame, "a") for frame in frames), what="anna's cursor")
        point = Strip(id="a", line_m=((0.0, 0.0, 0.0), (5e-324, 0.0, 0.0)), pixels=5)
        bench.put(MAP, Environment(stamp_ns=0, name="evil", strips=(point,)))
        await until(lambda: any("cannot be drawn" in text for h in health for text in h.warnings))
        assert not any(each.errors for each in health)


def test_a_clock_that_is_set_back_leaves_nothing_lit() -> None:
    clock = ManualClock()
    scene = Scene(FAST)
    scene.set_layout(Layout(MAP_MESSAGE.strips))
    scene.set_cursor("anna", cursor(clock, 0.5), clock.now_ns())
    scene.set_objects("conveyor", package(clock), clock.now_ns())
    clock.advance(-3600.0)
    scene.forget(clock.now_ns())
    assert scene.cursors() == []
    assert not len(scene.segments(clock.now_ns()).lines)
    assert scene.next_change_ns() is None


def test_a_clock_that_is_ahead_does_not_move_objects_backwards() -> None:
    clock = ManualClock()
    scene = Scene(FAST)
    scene.set_layout(Layout(MAP_MESSAGE.strips))
    scene.set_objects("conveyor", package(clock, speed_mps=1.0), clock.now_ns())
    assert scene.segments(clock.now_ns() - 500_000_000).at_m[0] == 0.5
    assert scene.segments(clock.now_ns() + 100_000_000).at_m[0] == pytest.approx(0.6)


@pytest.mark.parametrize(
    "outputs",
    [
        (OutputConfig(kind="expander"),),
        (OutputConfig(kind="expander", port="x"), OutputConfig(kind="expander", port="x")),
    ],
)
async def test_an_output_without_a_port_of_its_own_is_refused(outputs: tuple[OutputConfig, ...]) -> None:
    bus = MemoryBus(Exchange())
    view = ServiceBus(bus, WallClock(), "led-driver", "led-driver")
    with pytest.raises(ConfigError, match=r"outputs\.\d\.port"):
        LedDriver(LedDriverConfig(outputs=outputs), Context(bus=view, clock=WallClock()))
    await bus.close()


MAGIC = b"UPXL"
SET_SIZE = 4 + 6 + 60 + 4
DRAW_SIZE = 10


def expander(path: Path) -> LedDriverConfig:
    return FAST.model_copy(update={"outputs": (OutputConfig(kind="expander", port=str(path)),)})


def colored(stream: bytes) -> list[bool]:
    """Return for each set-channel frame in a stream of whole frames whether it is not dark."""
    frames = stream.split(MAGIC)[1:]
    return [any(frame[6:66]) for frame in frames if frame[1] == 1]


async def test_the_expander_gets_a_throw_away_frame_keep_alives_and_darkness_at_the_end(
    tmp_path: Path,
) -> None:
    stream = bytearray()
    clock = ManualClock()
    with pty_device(tmp_path / "led") as device, Listener(device, stream.extend):
        async with memory_bench(clock) as bench:
            await started(bench, expander(device.path))
            bench.put(CURSOR, cursor(clock, 0.5), "anna")
            await until(lambda: any(colored(bytes(stream))))
            # the standing clock keeps the cursor; nothing changes, and yet it is sent again
            seen = sum(colored(bytes(stream)))
            await until(lambda: sum(colored(bytes(stream))) >= seen + 2)
            began_s = asyncio.get_running_loop().time()
        assert asyncio.get_running_loop().time() - began_s < 2.0
        await until(lambda: colored(bytes(stream))[-4:] == [True, False, False, False])
        one = 2 * SET_SIZE + DRAW_SIZE
        assert stream[:one] == stream[one : 2 * one]  # the first may be swallowed


async def test_what_an_expander_draws_is_shown_and_said_when_it_is_too_much(tmp_path: Path) -> None:
    clock = ManualClock()
    output = OutputConfig(kind="expander", port=str(tmp_path / "led"), max_current_a=0.05)
    async with memory_bench(clock) as bench:
        reports = bench.collect(HEALTH)
        frames = await started(bench, FAST.model_copy(update={"outputs": (output,)}))
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        await next_frame(frames)
        await until(lambda: any("dimmed to 0.05 A" in text for text in reports[-1].warnings))
        figure = next(figure for figure in reports[-1].figures if figure.name.startswith("current"))
        assert figure.unit == "A"
        assert 0.04 < figure.value <= 0.05
        bench.put(CURSOR, cursor(clock, 9.0), "anna")
        await next_frame(frames)
        await until(lambda: any(figure.value == 0.0 for figure in reports[-1].figures))


async def test_the_expander_may_come_late_and_come_back(tmp_path: Path) -> None:
    stream = bytearray()
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        reports = bench.collect(HEALTH)
        await started(bench, expander(tmp_path / "led"))
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        await until(lambda: bool(reports) and any("is not there" in text for text in reports[-1].warnings))
        with pty_device(tmp_path / "led") as device, Listener(device, stream.extend) as listener:
            await until(lambda: any(colored(bytes(stream))))
            await until(lambda: not reports[-1].warnings)
            with listener.lock:
                device.unplug()
            await until(lambda: bool(reports[-1].warnings))
            stream.clear()
            with listener.lock:
                device.plug()
            await until(lambda: any(colored(bytes(stream))))


async def test_a_stuck_controller_is_said_and_holds_nobody_up(tmp_path: Path) -> None:
    clock = ManualClock()
    with pty_device(tmp_path / "led") as device:  # nobody reads it
        async with memory_bench(clock) as bench:
            reports = bench.collect(HEALTH)
            frames = await started(bench, expander(device.path))
            step = 0

            def said() -> bool:
                nonlocal step
                step += 1
                bench.put(CURSOR, cursor(clock, step % 20 / 10 + 0.05), "anna")
                return bool(reports) and any("no more data" in text for text in reports[-1].warnings)

            await until(said, 20)
            await next_frame(frames)
