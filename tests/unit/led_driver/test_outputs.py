"""Outputs get the strips of their segments, when one of them has changed."""

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from pointit.errors import ConfigError
from pointit.runtime.clock import WallClock
from pointit.runtime.service import plugin_guard
from pointit.runtime.service.plugin_guard import NullHealth, PluginGuard, Surroundings
from pointit.schemas import Cursor, Environment, Lamp, SetLamp, StripFrame, StripsFrame, UserProfile
from pointit.schemas.base import Rgb
from pointit.schemas.topics import CURSOR, MAP, PROFILE, SET_LAMP
from pointit.services.led_driver import outputs
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.output.expander import ExpanderConfig
from pointit.services.led_driver.outputs import GuardedOutput, LedOutput, OutputConfig, make_outputs
from pointit.services.led_driver.service import LedDriver
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.led_driver.driving import FAST, MAP_MESSAGE, cursor, driven, next_frame

A = StripFrame(id="a", rgb=bytes(60))
B = StripFrame(id="b", rgb=bytes(60))
LIT = bytes(57) + b"\1\2\3"


class Strips:
    """Records the strips of its frames. Its `show` raises if `is_stuck`."""

    def __init__(self) -> None:
        self.light_s = 0.0
        self.shown: list[tuple[StripFrame, ...]] = []
        self.strips: Sequence[object] = ()
        self.is_stuck = False
        self.ended = asyncio.Event()

    def set_strips(self, strips: Sequence[object]) -> None:
        self.strips = strips

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        if self.is_stuck:
            raise ConnectionError("gone")
        assert age_s >= 0.0
        self.shown.append(frame.strips)

    async def run(self) -> None:
        await self.ended.wait()


def guarded(make: Callable[[], Strips], *strip_ids: str) -> GuardedOutput:
    output = GuardedOutput(make, PluginGuard("mine", NullHealth()), strip_ids)
    output.set_map(MAP_MESSAGE)
    return output


def frame(*strips: StripFrame) -> StripsFrame:
    return StripsFrame(stamp_ns=1, strips=strips)


def test_output_gets_its_own_strips_when_one_has_changed() -> None:
    mine = Strips()
    every = Strips()
    outputs = guarded(lambda: mine, "b"), guarded(lambda: every)
    lit_a = StripFrame(id="a", rgb=LIT)
    lit_b = StripFrame(id="b", rgb=LIT)
    frames = frame(A, B), frame(lit_a, B), frame(lit_a, lit_b), frame(lit_a, lit_b.model_copy())
    sent = [tuple(output.show(each, 0.01) for output in outputs) for each in frames]
    assert sent == [(True, True), (False, True), (True, True), (False, False)]
    assert mine.shown == [(B,), (lit_b,)]
    assert every.shown == [(A, B), (lit_a, B), (lit_a, lit_b)]


def test_output_is_dark_when_frames_lack_its_strips() -> None:
    mine = Strips()
    output = guarded(lambda: mine, "b")
    output.show(frame(A, B))
    output.show(frame(A))
    output.show(frame())
    assert mine.shown == [(B,), ()]


def test_new_map_shows_unchanged_strips_again() -> None:
    mine = Strips()
    output = guarded(lambda: mine, "b")
    output.show(frame(A, B))
    output.set_map(MAP_MESSAGE)
    output.show(frame(A, B))
    assert mine.shown == [(B,), (B,)]


def test_frame_that_failed_is_shown_by_the_next_attempt() -> None:
    mine = Strips()
    mine.is_stuck = True
    output = guarded(lambda: mine, "b")
    assert not output.show(frame(A, B))
    mine.is_stuck = False
    assert output.show(frame(A, B))
    assert mine.shown == [(B,)]


async def test_output_that_is_made_again_shows_what_does_not_change(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugin_guard, "FIRST_WAIT_S", 0.001)
    made: list[Strips] = []

    def make() -> Strips:
        made.append(Strips())
        return made[-1]

    output = guarded(make, "b")
    output.show(frame(A, B))
    work = asyncio.create_task(output.run())
    made[0].ended.set()
    await until(lambda: len(made) > 1 and made[1].shown == [(B,)])
    assert made[1].strips == MAP_MESSAGE.strips
    work.cancel()
    await asyncio.wait({work})


@pytest.mark.parametrize(
    ("config", "strip_ids"),
    [
        (OutputConfig(), set[str]()),
        (OutputConfig.model_validate({"segments": [{"strip": "a"}, {"strip": "a", "first": 3}]}), {"a"}),
        (ExpanderConfig(), set[str]()),
        (ExpanderConfig.model_validate({"segments": [{"strip": "b", "universe": 0}]}), {"b"}),
    ],
)
def test_strips_of_an_output_are_those_of_its_parameters(config: OutputConfig, strip_ids: set[str]) -> None:
    assert config.strip_ids() == strip_ids


async def test_latency_is_that_of_outputs_that_have_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    at_a = Strips()
    at_b = Strips()
    made = [guarded(lambda: at_a, "a"), guarded(lambda: at_b, "b")]

    def make_outputs(*_arguments: object) -> list[GuardedOutput]:
        return made

    monkeypatch.setattr("pointit.services.led_driver.service.make_outputs", make_outputs)
    async with driven() as (bench, clock, frames):
        at_a.light_s = 0.01
        at_b.light_s = 0.3
        bench.put(CURSOR, cursor(clock, 0.3, "b"), "ben")
        assert (await next_frame(frames)).light_s == 0.3, "the frame before was new to both"
        bench.put(CURSOR, cursor(clock, 0.3), "anna")
        assert (await next_frame(frames)).light_s == 0.3
        for place_m in (0.8, 1.3):
            bench.put(CURSOR, cursor(clock, place_m), "anna")
            light_s = (await next_frame(frames)).light_s
            assert light_s == 0.01, "b has not changed"


ROOM = MAP_MESSAGE.model_copy(update={"lamps": (Lamp(id="one", position_m=(1, 0, 0)),)})


class Lights:
    """Lamps and a beam, without strips."""

    def __init__(self) -> None:
        self.lamps: Sequence[Lamp] = ()
        self.colors: list[tuple[str, Rgb]] = []
        self.map: Environment | None = None
        self.cursors: list[tuple[str, Cursor | None, Rgb]] = []

    def set_lamps(self, lamps: Sequence[Lamp]) -> None:
        self.lamps = lamps

    def show_lamp(self, lamp_id: str, color: Rgb) -> None:
        self.colors.append((lamp_id, color))

    def set_map(self, environment: Environment) -> None:
        self.map = environment

    def show_cursor(self, user: str, cursor: Cursor | None, color: Rgb) -> None:
        self.cursors.append((user, cursor, color))

    async def run(self) -> None:
        await asyncio.Event().wait()


async def test_lamps_and_cursors_reach_outputs_that_have_them(monkeypatch: pytest.MonkeyPatch) -> None:
    lights = Lights()
    row = LedOutput(summary="", config=OutputConfig, make=lambda _config, _around: lights)

    def get(_group: object, _name: str) -> LedOutput:
        return row

    monkeypatch.setattr(type(outputs.OUTPUTS), "get", get)
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        output = OutputConfig(kind="expander")
        bench.start(LedDriver, FAST.model_copy(update={"outputs": (output,)}))
        await bench.settle()
        bench.put(MAP, ROOM)
        bench.put(PROFILE, UserProfile(stamp_ns=1, cursor_color=(1, 2, 3)), "anna")
        await until(lambda: lights.map == ROOM and lights.lamps == ROOM.lamps)

        await bench.bus.call(SET_LAMP, SetLamp(color=(9, 8, 7)), "one")
        await until(lambda: lights.colors[-1:] == [("one", (9, 8, 7))])
        cursor = Cursor(stamp_ns=clock.now_ns(), point_m=(1, 2, 0), solid="plane", surface_id="wall")
        bench.put(CURSOR, cursor, "anna")
        await until(lambda: lights.cursors == [("anna", cursor, (1, 2, 3))])

        clock.advance(FAST.cursor_timeout_s)
        await until(lambda: lights.cursors[1:] == [("anna", None, (1, 2, 3))])


async def test_lights_that_are_made_again_get_map_and_colors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugin_guard, "FIRST_WAIT_S", 0.001)
    made: list[Lights] = []

    class Failing(Lights):
        async def run(self) -> None:
            if len(made) > 1:
                await super().run()

    def make() -> Lights:
        made.append(Failing())
        return made[-1]

    output = GuardedOutput(make, plugin_guard.PluginGuard("mine", NullHealth()))
    output.set_map(ROOM)
    output.show_lamp("one", (9, 8, 7))
    work = asyncio.create_task(output.run())
    await until(lambda: len(made) > 1 and bool(made[1].colors))
    work.cancel()
    await asyncio.wait({work})
    assert (made[1].map, made[1].lamps, made[1].colors) == (ROOM, ROOM.lamps, [("one", (9, 8, 7))])


AROUND = Surroundings(clock=WallClock(), health=NullHealth(), folder=Path("unused"))


def names(*outputs: dict[str, Any]) -> list[str]:
    given: list[str] = []

    def surroundings(_kind: str, _name: str, _user: str, which: str) -> Surroundings:
        given.append(which)
        return AROUND

    make_outputs(LedDriverConfig.model_validate({"outputs": outputs}).outputs, surroundings, NullHealth())
    return given


@pytest.mark.parametrize(
    ("kind", "key", "values"),
    [
        *((kind, "universe", (2, 3)) for kind in ("e131", "artnet", "spotlight")),
        ("ddp", "port", (4048, 4049)),
    ],
)
def test_outputs_at_one_address_have_a_universe_or_port_each(
    kind: str, key: str, values: tuple[int, int]
) -> None:
    first, second = ({"kind": kind, "host": "10.0.0.5", key: value} for value in values)
    assert names(first, second) == [f"10.0.0.5 {key} {value}" for value in values]
    with pytest.raises(ConfigError, match=rf"outputs.1.host: 10.0.0.5 {key} {values[0]} is used .* `{key}`"):
        names(first, first)


def test_address_that_nothing_divides_has_one_output() -> None:
    port = {"kind": "adalight", "port": "/dev/x"}
    with pytest.raises(ConfigError, match=r"outputs.1.port: /dev/x is used by two outputs: remove one$"):
        names(port, port)
    with pytest.raises(ConfigError, match=r"outputs.0.port: is missing; `--output adalight:PORT` sets it"):
        names({"kind": "adalight"})
