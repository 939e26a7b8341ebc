"""The conveyor is killed or ended, and another one goes on with its packages."""

import asyncio
import contextlib
import signal
import sqlite3
import subprocess
import sys
from contextlib import AbstractAsyncContextManager
from pathlib import Path

import pytest

from pointit.runtime.host.state_file import site_folder
from pointit.runtime.host.store import RETRY_EVERY_NS, Store, read_rows
from pointit.schemas import Environment, SelectionEvent, SetSpeed
from pointit.schemas.topics import SET_SPEED
from pointit.services.conveyor_sim.persistence import FILE, LAYOUT, read
from pointit.services.conveyor_sim.service import ConveyorSim
from tests.support.bench import START_NS, ManualClock, until
from tests.unit.conveyor_sim.rooms import CHAIN, FORK, S
from tests.unit.conveyor_sim.shift import Shift
from tests.unit.conveyor_sim.shift import shift as running_shift

pytestmark = pytest.mark.wall_time

FEEDER = {"interval_s": 0.5, "length_m": 0.2}
STEP_S = 0.2
SITE = "memory"
"""Site name of the bench's bus."""


def stored() -> Path:
    return site_folder(SITE, "conveyor-sim") / FILE


def shift(
    clock: ManualClock, room: Environment = FORK, **changes: object
) -> AbstractAsyncContextManager[Shift]:
    return running_shift(clock, room, **{"rate_hz": 200.0, "feeder": FEEDER, **changes})


async def test_conveyor_continues_with_the_same_packages_after_a_clean_end() -> None:
    clock = ManualClock()
    async with shift(clock) as first:
        await first.go(8.0, STEP_S)
        await first.bus.call(SET_SPEED, SetSpeed(speed_mps=1.0, belts=("main",)))
        await first.go(8.0, STEP_S)
        told = [event.seq for event in first.events]
    assert first.states[-1].left > 0

    clock.advance(30.0)
    async with shift(clock) as second:
        assert second.ids == first.ids
        last = first.lists[-1].objects
        assert [t.surface_position_m for t in second.lists[0].objects] == [t.surface_position_m for t in last]
        assert second.states[-1].model_copy(update={"stamp_ns": 0, "seq": 0}) == first.states[-1].model_copy(
            update={"stamp_ns": 0, "seq": 0}
        )

        await second.go(20.0, STEP_S)
        gone = [event.object_id for event in (*first.events, *second.events)]
        assert len(gone) == len(set(gone)) == second.states[-1].left
        assert set(gone).isdisjoint(second.ids)
        assert second.states[-1].fed == len(gone) + len(second.ids)

        seqs = told + [event.seq for event in second.events]
        assert seqs == list(range(1, len(seqs) + 1))


@pytest.mark.parametrize(("later_s", "room"), [(61.0, FORK), (1.0, CHAIN), (-10.0, FORK)])
async def test_old_snapshot_or_one_of_another_map_is_not_restored(later_s: float, room: Environment) -> None:
    clock = ManualClock()
    async with shift(clock) as first:
        await first.go(3.0, STEP_S)
    clock.advance(later_s)
    async with shift(clock, room) as second:
        assert set(first.ids).isdisjoint(second.ids)
        assert second.states[-1].fed == 1


async def test_conveyor_with_discarded_state_starts_empty() -> None:
    clock = ManualClock()
    ConveyorSim.discard_saved_state(SITE, clock.now_ns())
    assert not stored().parent.exists()
    async with shift(clock) as first:
        await first.go(3.0, STEP_S)
        ConveyorSim.discard_saved_state(SITE, clock.now_ns())  # it is in use, and stays
        assert list(read_rows(stored(), "SELECT seq FROM plant", (), len)) == [1]
    ConveyorSim.discard_saved_state(SITE, clock.now_ns())
    clock.advance(1.0)
    async with shift(clock) as second:
        assert set(first.ids).isdisjoint(second.ids)


async def test_unpublished_event_is_published_after_a_restart() -> None:
    clock = ManualClock()
    async with shift(clock) as first:
        await first.go(3.0, STEP_S)
    event = SelectionEvent(stamp_ns=START_NS, seq=1, event="dispatched", object_id="x", bay="3")
    with contextlib.closing(sqlite3.connect(stored())) as db, db:
        db.execute("PRAGMA user_version = 0")  # of a file without a version
        db.execute("UPDATE plant SET seq = 1")
        db.execute("INSERT INTO outbox VALUES (1, ?)", (event.model_dump_json(exclude_defaults=True),))
    async with shift(clock) as second:
        await until(lambda: second.events == [event])
        await second.go(14.0, STEP_S)
        assert [e.seq for e in second.events[1:3]] == [2, 3]
    async with shift(clock) as third:
        await third.bench.settle()
        assert third.events == []


async def test_second_conveyor_says_that_it_keeps_nothing_and_runs() -> None:
    clock = ManualClock()
    first = Store(stored(), LAYOUT)
    first.open(clock.now_ns(), read)
    async with shift(clock) as second:
        await until(lambda: any("another conveyor" in w for h in second.health for w in h.warnings))
        await second.go(2.0, STEP_S)
        assert len(second.ids) > 2
    first.close()


async def test_failed_write_is_a_warning_until_the_next_one_succeeds() -> None:
    async with shift(ManualClock()) as one:
        await one.go(1.0, STEP_S)
        with contextlib.closing(sqlite3.connect(stored(), isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            await one.go(1.0, STEP_S)
            await until(lambda: one.warns("cannot be written"))
        await one.go(RETRY_EVERY_NS / S + 1.0, STEP_S)
        await until(lambda: not one.health[-1].warnings)


LIFE = """
import asyncio, sys
from pointit.runtime.clock import SimulatedClock
from pointit.schemas.topics import MAP, OBJECTS, SELECTION_EVENTS
from pointit.services.conveyor_sim.service import ConveyorSim
from tests.support.bench import memory_bench
from tests.unit.conveyor_sim.shift import Shift, shift as running_shift
from tests.unit.conveyor_sim.rooms import FORK, config

async def main():
    async with memory_bench(SimulatedClock(10.0)) as bench:
        # told while it is put: a subscriber hears of it in the next turn of the loop, which may never come
        bench.bus.tap(SELECTION_EVENTS, lambda e, _: print("event", e.seq, e.object_id, flush=True))
        bench.bus.subscribe(
            OBJECTS, lambda m, _: print("objects", *(t.id for t in m.objects), flush=True)
        )
        bench.start(ConveyorSim, config(rate_hz=100.0, feeder={"interval_s": 0.5, "length_m": 0.2}))
        bench.put(MAP, FORK)
        await asyncio.sleep(60)

asyncio.run(main())
"""


async def test_killed_without_a_word_it_loses_and_doubles_nothing() -> None:
    life = subprocess.Popen(  # noqa: ASYNC220 - it is killed below
        [sys.executable, "-c", LIFE], stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[3]
    )
    assert life.stdout is not None
    told: list[str] = []
    there: set[str] = set()
    for line in life.stdout:
        word, *rest = line.split()
        if word == "event":
            told.append(rest[1])
        else:
            there = set(rest)
        if len(told) >= 8:
            life.send_signal(signal.SIGKILL)
            break
    for line in life.stdout:  # what it said before it was dead
        word, *rest = line.split()
        if word == "event" and len(rest) == 2:
            told.append(rest[1])
    life.wait(5)
    life.stdout.close()
    saved_ns = next(read_rows(stored(), "SELECT stamp_ns FROM plant", (), lambda row: int(row[0])))
    async with shift(ManualClock(saved_ns + S), rate_hz=100.0) as second:
        await second.bench.settle()
        again = [event.object_id for event in second.events]
        assert second.states[-1].left == len(set(told) | set(again))
        assert set(told).isdisjoint(second.ids), "one that came out is there again"
        assert there - set(told) - set(again) <= set(second.ids), "one that was there is lost"
        assert second.states[-1].fed == second.states[-1].left + len(second.ids)

        await second.go(3.0, STEP_S)
        await asyncio.sleep(0)
        assert len(second.ids) == len(set(second.ids))
