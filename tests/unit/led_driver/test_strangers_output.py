"""An LED output of another package that fails in every call: named, and frames and other outputs go on."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from pointit.schemas.topics import CURSOR, HEALTH
from pointit.services.led_driver.config import LedDriverConfig
from tests.support import strangers
from tests.support.bench import until
from tests.unit.led_driver.driving import cursor, driven

MODULE = """
import asyncio

from pydantic import BaseModel, Field

from pointit.plugins import LedOutput, OutputConfig

class Broken:
    light_s = 0.0

    def __init__(self, config, surroundings):
        pass

    def set_strips(self, strips):
        raise KeyError("0")

    def show(self, frame, age_s=0.0):
        raise ConnectionError("gone")

    async def run(self):
        return

class Counting(Broken):
    light_s = "soon"

    def __init__(self, config, surroundings):
        self.health, self.frames = surroundings.health, 0

    def set_strips(self, strips):
        pass

    def show(self, frame, age_s=0.0):
        self.frames += 1
        self.health.set_metric("shown", self.frames)

    async def run(self):
        await asyncio.Event().wait()

class NumberedConfig(OutputConfig):
    number: int = Field(default=0, description="its number")

class Kept(BaseModel):
    number: int

class Numbered(Counting):
    light_s = 0.0

    def __init__(self, config, surroundings):
        super().__init__(config, surroundings)
        self.number = config.number
        self.file = surroundings.state_file(Kept)
        self.file.write(Kept(number=self.number))
        if self.number == 1:
            self.health.warn("device", "number 1 is lost")

    def show(self, frame, age_s=0.0):
        self.health.set_metric("number", self.file.read().number)
        if self.number == 1:
            raise ConnectionError("gone")
        self.health.clear("device")

BROKEN = LedOutput(summary="", config=OutputConfig, make=Broken)
COUNTING = LedOutput(summary="", config=OutputConfig, make=Counting)
NUMBERED = LedOutput(summary="", config=NumberedConfig, make=Numbered)
"""


@pytest.fixture(autouse=True)
def _installed(tmp_path: Path) -> Iterator[None]:
    entries = "\n".join(
        f"{name.lower()} = strangers_outputs:{name}" for name in ("BROKEN", "COUNTING", "NUMBERED")
    )
    with strangers.installed(tmp_path, "strangers_outputs", MODULE, led_outputs=entries):
        yield


async def test_output_failure_is_reported_and_costs_other_outputs_nothing() -> None:
    config = LedDriverConfig.model_validate({"outputs": [{"kind": "broken"}, {"kind": "counting"}]})
    async with driven(config) as (bench, clock, _frames):
        health = bench.collect(HEALTH, "led-driver")
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        await until(lambda: any(figure.name == "shown" for figure in health[-1].figures) if health else False)

        bench.put(CURSOR, cursor(clock, 1.0), "anna")  # the next frame reads the latency of the one before
        late = "LED output 'counting' of strangers-parts: light_s failed (ValueError: could not convert "
        await until(lambda: any(each.startswith(late) for each in health[-1].warnings))

        label = "LED output 'broken' of strangers-parts"
        said = [each for each in health[-1].warnings if each.startswith(label)]
        for problem in (
            r" ended by itself.*; it will be restarted in \d+ s",
            r": set_strips failed \(KeyError: '0'\): .*",
            r": show failed \(ConnectionError: gone\): .*",
        ):
            assert any(re.fullmatch(re.escape(label) + problem, each) for each in said), problem


async def test_outputs_of_one_kind_share_no_warnings_metrics_or_state() -> None:
    config = LedDriverConfig.model_validate(
        {"outputs": [{"kind": "numbered", "number": 1}, {"kind": "numbered", "number": 2}]}
    )
    async with driven(config) as (bench, clock, _frames):
        health = bench.collect(HEALTH, "led-driver")
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        await until(
            lambda: any("number" in figure.name for figure in health[-1].figures) if health else False
        )
        numbers = {f.name: f.value for f in health[-1].figures if f.name.startswith("number")}
        assert numbers == {"number of numbered": 1.0, "number of numbered 2": 2.0}
        failure, lost = sorted(health[-1].warnings)
        assert lost == "number 1 is lost"
        assert failure.startswith("LED output 'numbered' of strangers-parts (outputs.0): show failed (Conn")
