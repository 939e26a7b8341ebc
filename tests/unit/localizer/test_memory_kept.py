"""The localizer on the bus remembers a person: learns, restarts, recalls, shows and erases."""

import math
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from pointit.geometry.rotation import IDENTITY
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    EraseMemory,
    Health,
    ImuSample,
    LearntPointing,
    ReadMemory,
    ReadMemoryReply,
    StartLocalization,
)
from pointit.schemas.topics import ERASE_MEMORY, HEALTH, IMU, MAP, READ_MEMORY, START_LOCALIZATION
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.service import Localizer
from tests.support.bench import Bench, in_virtual_time, memory_bench, until
from tests.unit.localizer.person import Person
from tests.unit.localizer.test_localizer_service import ROOM, STATIC, USER, Room

PERSON = Person(1.5, 1.2, -2.0, math.radians(6.0))
BAND = "ble metamotion"


@asynccontextmanager
async def localizer(config: LocalizerConfig = STATIC, mounting: str = BAND) -> AsyncGenerator[Room]:
    """Start a localizer, and say how the person's wrist device is worn."""
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        room = Room(bench, clock, PERSON)
        bench.put(MAP, ROOM)
        bench.start(Localizer, config, USER)
        await bench.settle()
        sample = ImuSample(stamp_ns=clock.now_ns(), orientation_xyzw=IDENTITY, mounting=mounting)
        bench.put(IMU, sample, USER)
        await bench.settle()
        yield room


async def localize(room: Room) -> None:
    await room.bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
    async with room.pointing():
        await room.until_phase("solved")


async def remembered(bench: Bench) -> ReadMemoryReply:
    return await bench.bus.call(READ_MEMORY, ReadMemory(), USER)


async def erased(bench: Bench) -> str:
    return (await bench.bus.call(ERASE_MEMORY, EraseMemory(), USER)).message


def bias_deg(learnt: LearntPointing) -> float:
    assert learnt.elevation_bias_rad is not None
    return math.degrees(learnt.elevation_bias_rad.mean)


@in_virtual_time
async def test_it_outlives_a_restart_until_it_is_erased(own_state: Path) -> None:
    path = own_state / "users" / USER / "memory.json"
    async with localizer() as room:
        assert (await remembered(room.bench)).learnt == ()
        await localize(room)
        (learnt,) = (await remembered(room.bench)).learnt
        assert learnt.mounting == BAND
        assert bias_deg(learnt) == pytest.approx(6.0, abs=0.3)
    assert path.stat().st_mode & 0o077 == 0
    async with localizer() as room:
        assert (await remembered(room.bench)).learnt == (learnt,)
        await localize(room)
        (again,) = (await remembered(room.bench)).learnt
        assert again.localizations == 2
        assert await erased(room.bench) == "it is forgotten"
        assert (await remembered(room.bench)).learnt == ()
        assert not path.exists()
        assert await erased(room.bench) == "nothing was remembered"
    assert not path.exists()
    async with localizer() as room:
        assert (await remembered(room.bench)).learnt == ()


@in_virtual_time
async def test_nothing_is_kept_of_an_unknown_device_nor_where_it_is_switched_off(own_state: Path) -> None:
    async with localizer(mounting="") as room:
        await localize(room)
    async with localizer(STATIC.model_copy(update={"remember": False})) as room:
        await localize(room)
        assert (await remembered(room.bench)).learnt == ()
    assert not (own_state / "users" / USER / "memory.json").exists()


@in_virtual_time
async def test_a_spoilt_file_is_a_warning_and_no_memory(own_state: Path) -> None:
    path = own_state / "users" / USER / "memory.json"
    path.parent.mkdir(parents=True)
    path.write_text('{"learnt": 1}', encoding="utf-8")
    async with localizer() as room:
        reports: list[Health] = room.bench.collect(HEALTH)
        await until(lambda: bool(reports and reports[-1].warnings))
        assert "memory.json: cannot be used" in reports[-1].warnings[0]
        await localize(room)
        await until(lambda: not reports[-1].warnings)
        assert len((await remembered(room.bench)).learnt) == 1
