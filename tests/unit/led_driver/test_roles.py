"""Outputs of lamps and beams get the map, colours and cursors, also when they are started again."""

import asyncio
from collections.abc import Sequence

import pytest

from pointit.runtime.service import plugin_guard
from pointit.runtime.service.surroundings import NullHealth
from pointit.schemas import Cursor, Environment, Lamp, SetLamp, UserProfile
from pointit.schemas.base import Rgb
from pointit.schemas.topics import CURSOR, MAP, PROFILE, SET_LAMP
from pointit.services.led_driver import outputs
from pointit.services.led_driver.guarded_output import GuardedOutput
from pointit.services.led_driver.outputs import LedOutput, OutputConfig
from pointit.services.led_driver.service import LedDriver
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.led_driver.driving import FAST, MAP_MESSAGE

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
