"""An LED output of another package that fails in every call: named, and frames and other outputs go on."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from pointit.schemas.topics import CURSOR, HEALTH, MAP, STRIPS_FRAME
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.service import LedDriver
from tests.support import strangers
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.led_driver.driving import MAP_MESSAGE, cursor

MODULE = """
import asyncio

from pointit.plugins import LedOutput, OutputConfig

class Broken:
    light_s = "soon"

    def __init__(self, config, surroundings):
        pass

    def set_strips(self, strips):
        raise KeyError("0")

    def show(self, frame, age_s=0.0):
        raise ConnectionError("gone")

    async def run(self):
        return

class Counting(Broken):
    light_s = 0.0

    def __init__(self, config, surroundings):
        self.health, self.frames = surroundings.health, 0

    def set_strips(self, strips):
        pass

    def show(self, frame, age_s=0.0):
        self.frames += 1
        self.health.set_metric("shown", self.frames)

    async def run(self):
        await asyncio.Event().wait()

BROKEN = LedOutput(summary="", config=OutputConfig, make=Broken)
COUNTING = LedOutput(summary="", config=OutputConfig, make=Counting)
"""


@pytest.fixture(autouse=True)
def _installed(tmp_path: Path) -> Iterator[None]:  # pyright: ignore[reportUnusedFunction]
    entries = "broken = strangers_outputs:BROKEN\ncounting = strangers_outputs:COUNTING"
    with strangers.installed(tmp_path, "strangers_outputs", MODULE, led_outputs=entries):
        yield


async def test_output_that_fails_is_named_and_costs_frames_and_other_outputs_nothing() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames, health = bench.collect(STRIPS_FRAME), bench.collect(HEALTH, "led-driver")
        outputs = [{"kind": "broken"}, {"kind": "counting"}]
        bench.start(LedDriver, LedDriverConfig.model_validate({"outputs": outputs}))
        await bench.settle()
        bench.put(MAP, MAP_MESSAGE)
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        await until(lambda: len(frames) >= 1)
        await until(lambda: any(figure.name == "shown" for figure in health[-1].figures) if health else False)
        label = "LED output 'broken' of strangers-parts"
        said = [each for each in health[-1].warnings if each.startswith(label)]
        for problem in (
            r" ended by itself.*; it is started again after \d+ s",
            r": light_s failed \(ValueError: could not convert .*\): update or remove it",
            r": set_strips failed \(KeyError: '0'\): .*",
            r": show failed \(ConnectionError: gone\): .*",
        ):
            assert any(re.fullmatch(re.escape(label) + problem, each) for each in said), problem
